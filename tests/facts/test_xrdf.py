"""The reader of facts of the XRDF derives every number again and finds each wrong one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from robot_files import run_step, write_robot_ports
from tiny import TinyRobot, tiny_quadruped, with_mimic

from assetbuild.facts.readers.xrdf import Xrdf as XrdfFacts
from assetbuild.findings import Finding
from assetbuild.targets.urdf import Urdf
from assetbuild.targets.xrdf import Xrdf
from assetbuild.targets.xrdf.covers import XrdfOptions

SAID = XrdfOptions(
    acceleration={"FR_.*": 7.0, ".*": 9.0}, jerk=100, tool_frames=("FR_foot", "imu"), max_spheres=2
)
OPTIONS = {"xrdf": SAID.model_dump(mode="json")}


def laid_out(folder: Path, robot: TinyRobot, said: XrdfOptions = SAID) -> Path:
    ports = write_robot_ports(folder, robot)
    run_step(Urdf(robot="tiny"), ports, ports)
    run_step(Xrdf(robot="tiny", options=said), ports, ports)
    return ports


@pytest.fixture(scope="module")
def ports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return laid_out(tmp_path_factory.mktemp("xrdf"), tiny_quadruped())


def proved(ports: Path, folder: Path, *edits: tuple[str, str]) -> list[Finding]:
    """The XRDF, edited, against the recipe and the robot."""
    path = ports / "xrdf/tiny.xrdf"
    before = text = path.read_text()
    for old, new in edits:
        assert old in text, text
        text = text.replace(old, new, 1)
    try:
        path.write_text(text)
        return run_step(XrdfFacts(robot="tiny", options=OPTIONS), ports, folder)
    finally:
        path.write_text(before)


@pytest.mark.parametrize("joints", [".*", "FR_.*"])
def test_what_we_write_is_the_robot(joints: str, tmp_path: Path):
    """A joint that follows another, and one outside of the pattern, is not planned."""
    said = SAID.model_copy(update={"joints": joints})
    robot = tiny_quadruped()
    tree, links = (
        with_mimic(replace(robot, tree=one), "FR_thigh_joint", "FR_calf_joint", -2.0, 0.1).tree
        for one in (robot.tree, robot.links)
    )
    ports = laid_out(tmp_path / "in", replace(robot, tree=tree, links=links), said)
    step = XrdfFacts(robot="tiny", options={"xrdf": said.model_dump(mode="json")})
    assert run_step(step, ports, tmp_path) == []
    assert '"facts": 0' not in (tmp_path / "figures.json").read_text()


@pytest.mark.parametrize(
    ("subject", "quantity", "old", "new"),
    [
        ("joint FR_hip_joint", "place", "[FR_hip_joint, FR_thigh_joint",
         "[FR_thigh_joint, FR_hip_joint"),
        ("joint FR_hip_joint", "acceleration", "limits: [7.0", "limits: [7.1"),
        ("joint FR_hip_joint", "jerk", "limits: [100.0", "limits: [101.0"),
        ("joint FR_thigh_joint", "default", "FR_thigh_joint: 0.8", "FR_thigh_joint: 0.9"),
        ("pair FR_calf FR_thigh", "ignored", "FR_thigh: [FR_calf", "FR_thigh: [RL_calf"),
        ("pair FR_thigh RL_calf", "ignored", "FR_thigh: [FR_calf", "FR_thigh: [RL_calf"),
    ],
)  # fmt: skip
def test_a_wrong_number_is_named(
    subject: str, quantity: str, old: str, new: str, ports: Path, tmp_path: Path
):
    findings = proved(ports, tmp_path, (old, new))
    named = {(f.rule, s) for f in findings for s in (f.subject, *f.data.get("subjects", ()))}
    assert (f"equal.xrdf.{quantity}", subject) in named


@pytest.mark.parametrize("text", ["[", ""])
def test_what_is_no_yaml_is_one_error(text: str, ports: Path, tmp_path: Path):
    whole = (ports / "xrdf/tiny.xrdf").read_text()
    (found,) = proved(ports, tmp_path, (whole, text))
    assert found.rule == "equal.unreadable"
