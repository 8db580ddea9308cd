"""The reader of facts of the XRDF derives every number again and finds each wrong one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from robot_files import about, edit, laid_out, run_step
from tiny import TinyRobot, tiny_quadruped, with_mimic

from assetbuild.facts.readers.xrdf import Xrdf as XrdfFacts
from assetbuild.findings import Finding
from assetbuild.targets.urdf import Urdf
from assetbuild.targets.xrdf import Xrdf
from assetbuild.targets.xrdf.covers import XrdfOptions

SAID = XrdfOptions(
    acceleration={"FR_.*": 7.0, ".*": 9.0}, jerk=100, tool_frames=("FR_foot", "imu"), max_spheres=2
)


def written(folder: Path, robot: TinyRobot, said: XrdfOptions = SAID) -> Path:
    targets = (Urdf(robot="tiny"), "urdf"), (Xrdf(robot="tiny", options=said), "xrdf")
    return laid_out(folder / "in", robot, *targets)


def proved(ports: Path, said: XrdfOptions = SAID) -> list[Finding]:
    """The XRDF against the recipe and the robot."""
    step = XrdfFacts(robot="tiny", options={"xrdf": said.model_dump(mode="json")})
    return run_step(step, ports, ports.parent)


@pytest.mark.parametrize("joints", [".*", "FR_.*"])
def test_what_we_write_is_the_robot(joints: str, tmp_path: Path):
    """A joint that follows another, and one outside of the pattern, is not planned."""
    said = SAID.model_copy(update={"joints": joints})
    robot = tiny_quadruped()
    tree, links = (
        with_mimic(replace(robot, tree=one), "FR_thigh_joint", "FR_calf_joint", -2.0, 0.1).tree
        for one in (robot.tree, robot.links)
    )
    robot = replace(robot, tree=tree, links=links)
    assert proved(written(tmp_path, robot, said), said) == []
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
def test_a_wrong_number_is_named(subject: str, quantity: str, old: str, new: str, tmp_path: Path):
    ports = written(tmp_path, tiny_quadruped())
    edit(ports / "xrdf/tiny.xrdf", (old, new))
    assert (f"equal.xrdf.{quantity}", subject) in about(proved(ports))


@pytest.mark.parametrize("text", ["[", ""])
def test_what_is_no_yaml_is_one_error(text: str, tmp_path: Path):
    ports = written(tmp_path, tiny_quadruped())
    (ports / "xrdf/tiny.xrdf").write_text(text)
    assert [found.rule for found in proved(ports)] == ["equal.unreadable"]
