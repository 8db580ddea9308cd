"""What the report adds to the findings of the steps."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from robot_files import run_step, write_robot_ports
from tiny import pendulum
from urdfs import link, robot

from assetbuild.checks.full_effort import FullEffort
from assetbuild.cli import main
from assetbuild.engine.graph import Node
from assetbuild.engine.make import NodeResult
from assetbuild.facts.readers._mjcf import MjcfFacts
from assetbuild.pipeline.judging import _not_compared, _result, licence_findings
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.plan import Outline
from assetbuild.plan.asked import asked
from assetbuild.targets.mjcf import Mjcf


def test_a_target_without_a_reader_keeps_the_robot_from_being_ready():
    """As that of another package may be."""
    written, read = (Node("n", step, {}) for step in (Mjcf(robot="r"), MjcfFacts(robot="r")))
    outline = Outline(targets={"mjcf": written, "sdf": written}, checks={"mjcf_equal": read})
    (finding,) = _not_compared(outline)
    assert (finding.rule, finding.subject) == ("formats.not_compared", "recipe targets sdf")
    assert finding.unready


def test_a_check_that_another_engine_could_run_says_which_target_its_own_lacks(tmp_path: Path):
    """PhysX could fall with the USD, but the recipe simulates in MuJoCo alone."""
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text(
        "schema: assetbuild/v1\nrobot: r\nbase: fixed\nsource: {path: ., urdf: r.urdf}\n"
        "targets: [usd]\nvalidate: {free_fall: {}}\n"
    )
    (one,) = asked(load_recipe(recipe).recipe)
    assert one.lack == "`targets` lacks `mjcf`"


def test_a_check_that_cannot_read_its_file_did_not_run(tmp_path: Path):
    inputs = write_robot_ports(tmp_path / "in", pendulum())
    (inputs / "mjcf").mkdir()
    (inputs / "mjcf/robot.xml").write_text("<mujoco>")
    assert run_step(FullEffort(robot="robot"), inputs, tmp_path / "out") == []
    figures = json.loads((tmp_path / "out/figures.json").read_text())
    result = _result(NodeResult("check full_effort", "ran"), figures)
    assert (result.status, result.note) == ("skip", "its file does not load")
    assert _result(NodeResult("check full_effort", "ran"), {"mjcf": {}}).status == "pass"


URDF = robot(link("cube"), name="cube")


TOLD = {
    "MIT": {},
    None: {"license.unstated": "warning"},
    "CC-BY-4.0": {},
    "CC-BY-SA-4.0": {"license.share_alike": "info"},
    "CC-BY-NC-ND-4.0": {"license.no_derivatives": "warning", "license.non_commercial": "info"},
    "Apache-2.0 AND CC-BY-ND-3.0": {"license.no_derivatives": "warning"},
    "BSD-3-Clause-No-Nuclear-License": {},
    "LicenseRef-ND": {},
}


def test_the_terms_of_a_licence_are_reported():
    said = {licence: licence_findings(licence, texts=1) for licence in TOLD}
    assert {k: {f.rule: f.severity for f in found} for k, found in said.items()} == TOLD
    assert [finding.rule for finding in licence_findings("MIT", texts=0)] == ["license.no_text"]


def test_the_texts_and_the_origin_go_into_the_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "cache"))
    for path, text in (
        ("src/LICENSE", "of everything"),
        ("src/robots/LICENCE.txt", "of the robots"),
        ("src/robots/cube/cube.urdf", URDF),
        ("src/other/LICENSE", "of something else"),
    ):
        file = tmp_path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    (tmp_path / "cube.yaml").write_text(
        "schema: assetbuild/v1\nrobot: cube\nbase: floating\ntargets: [urdf]\n"
        "source: {path: src, urdf: robots/cube/cube.urdf, license: CC-BY-ND-4.0}\n"
        "edits: [{set_mass: {link: cube, mass: 2}}]\n"
    )
    out = tmp_path / "out"
    assert main(["build", str(tmp_path / "cube.yaml"), "-o", str(out)]) == 0
    texts = {p.relative_to(out).as_posix(): p.read_text() for p in out.glob("LICENSES/**/LICEN*")}
    assert texts == {
        "LICENSES/LICENSE": "of everything",
        "LICENSES/robots/LICENCE.txt": "of the robots",
    }
    notice = (out / "NOTICE").read_text()
    for words in ("from src", "robots/cube/cube.urdf", "CC-BY-ND-4.0", "set_mass"):
        assert words in notice
    assert "license.no_derivatives" in (out / "report/report.json").read_text()
