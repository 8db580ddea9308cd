"""Meshes that are only seen: read by MuJoCo once, and not with each MJCF that names them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from robot_files import checked, configured, edit, mjcf_inputs, ranked, rules, run_step
from tiny import tiny_quadruped

from assetbuild.checks.mjcf_meshes import MjcfMeshes
from assetbuild.facts.compare import differences
from assetbuild.facts.mjcf_model import MESHES
from assetbuild.facts.readers._mjcf import MjcfFacts
from assetbuild.facts.reference import Reference


def test_files_that_hold_what_was_built_pass(tmp_path: Path) -> None:
    found, figures = checked(MjcfMeshes(), mjcf_inputs(tmp_path, tiny_quadruped()), tmp_path)
    assert (found, figures) == ([], {"meshes": 1})


def moved(text: str) -> str:
    """The first corner a millimetre further out."""
    lines = text.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("v "))
    x, y, z = map(float, lines[at].split()[1:])
    lines[at] = f"v {x + 1e-3} {y} {z}"
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (moved, {"equal.mjcf.mean_corner", "equal.mjcf.area", "equal.mjcf.volume",
                 "equal.mjcf.corner_moments"}),
        (lambda text: text.replace("f ", "# ", 1), {"equal.mjcf.triangles"}),
        (lambda _: "v 0 0 0\n", {"equal.unreadable"}),
    ],
)  # fmt: skip
def test_a_file_that_mujoco_reads_otherwise_is_an_error(
    spoil: Callable[[str], str], expected: set[str], tmp_path: Path
) -> None:
    inputs = mjcf_inputs(tmp_path, tiny_quadruped())
    file = inputs / "meshes/trunk_box.obj"
    file.write_text(spoil(file.read_text()))
    found = run_step(MjcfMeshes(), inputs, tmp_path)
    assert expected <= rules(found)
    assert {severity for _, severity in ranked(found)} == {"error"}


def test_it_is_asked_where_an_mjcf_is_written() -> None:
    assert configured(MjcfMeshes, targets=("mjcf",)) is not None
    assert configured(MjcfMeshes, targets=("urdf",)) is None


def test_an_mjcf_without_these_meshes_is_read_as_with_them(tmp_path: Path) -> None:
    inputs = mjcf_inputs(tmp_path, tiny_quadruped())
    known = Reference.of_ports(inputs, {})
    unknown = replace(known, assets=replace(known.assets, files=()))
    reader, path = MjcfFacts(robot="robot"), inputs / "mjcf/robot.xml"
    assert known.assets.known and not unknown.assets.known
    assert not differences(reader.found(path, unknown), reader.found(path, known), MESHES)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('file="trunk_box.obj"', 'file="trunk_box.obj" scale="1 1 1.01"'),
        ('file="trunk_box.obj"', 'file="trunk_box.obj" refpos="0 0 0.01"'),
        ('mesh="trunk_box"', 'mesh="trunk_box" pos="0 0 0.01"'),
        ('mesh="trunk_box"', 'mesh="other"'),
    ],
)
def test_what_an_mjcf_does_with_a_mesh_is_seen_though_its_file_is_known(
    old: str, new: str, tmp_path: Path
) -> None:
    inputs = mjcf_inputs(tmp_path, tiny_quadruped())
    other = (inputs / "mjcf/assets/trunk_box.obj").read_text()
    (inputs / "mjcf/assets/other.obj").write_text(moved(other))
    edit(inputs / "mjcf/robot.xml", (old, new), ("</asset>", '<mesh file="other.obj"/></asset>'))
    assert "equal.mjcf.corner_moments" in rules(
        run_step(MjcfFacts(robot="robot"), inputs, tmp_path)
    )


def test_a_mesh_file_that_is_not_there_is_what_mujoco_says(tmp_path: Path) -> None:
    inputs = mjcf_inputs(tmp_path, tiny_quadruped())
    (inputs / "mjcf/assets/trunk_box.obj").unlink()
    (found,) = run_step(MjcfFacts(robot="robot"), inputs, tmp_path)
    assert found.rule == "equal.unreadable"
    assert "trunk_box.obj" in found.message
