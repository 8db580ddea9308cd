"""A robot of a bundle that tells one thing in two ways, or names what is not there."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from gripper import gripper
from tiny import write_robot_ports

from assetbuild.errors import UsageError
from assetbuild.facts.coherence import incoherent
from assetbuild.facts.reference import Reference


def changed(folder: Path, change: Callable[[Any], object]) -> Reference:
    """The gripper of a bundle whose `robot.json` somebody changed."""
    reference = Reference.of_ports(write_robot_ports(folder / "ports", gripper()), {})
    raw = json.loads(reference.to_json())
    change(raw)
    (folder / "report").mkdir()
    (folder / "report/robot.json").write_text(json.dumps(raw))
    return Reference.of_bundle(folder)


def test_an_untouched_robot_agrees_with_itself(tmp_path: Path):
    assert list(incoherent(changed(tmp_path, lambda raw: None))) == []


@pytest.mark.parametrize(
    ("quantity", "subject", "change"),
    [
        ("mass", "body slide", lambda r: r["links"]["bodies"][1]["inertial"].update(mass_kg=3.0)),
        ("axis", "joint lift", lambda r: r["links"]["joints"][0].update(axis=[0.0, 0.0, 1.0])),
        ("source's_damping", "joint a_joint", lambda r: r["tree"]["joints"][2].update(damping=9.0)),
        ("triangles", "mesh block", lambda r: r["shapes"]["meshes"][1].update(faces=13)),
    ],
)
def test_links_and_bodies_that_differ_are_found(
    quantity: str, subject: str, change: Callable[[Any], object], tmp_path: Path
):
    found = {(f.rule, f.subject) for f in incoherent(changed(tmp_path, change))}
    assert found == {(f"equal.robot.{quantity}", subject)}


@pytest.mark.parametrize(
    "change",
    [
        lambda r: r["tree"]["joints"][0].update(parent="nobody"),
        lambda r: r["links"]["bodies"].pop(),
        lambda r: r["shapes"]["shapes"][0].update(link="nobody"),
        lambda r: r["control"]["actuators"][0].update(joint="nobody"),
        lambda r: r["assets"]["surfaces"][0][1].update(mean=[0.0, 0.0]),
        lambda r: r.pop("options"),
    ],
)
def test_a_robot_with_a_dangling_name_is_refused(change: Callable[[Any], object], tmp_path: Path):
    with pytest.raises(UsageError, match=r"robot\.json"):
        changed(tmp_path, change)
