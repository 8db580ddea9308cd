"""What moves an MJCF's robot and no other format can say is a warning, and an error for the USD."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from mjcfs import usd_findings, written
from pxr import Usd as UsdCore
from robot_files import check_inputs, run_step
from tiny import pendulum

from assetbuild.facts.readers._usd import UsdReader
from assetbuild.findings import Finding
from assetbuild.robot.model import MjcfOnly
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.usd import Usd
from assetbuild.targets.usd.unsupported import unsupported


def arms(more: str = "", body: str = "", joint: str = "", head: str = "") -> str:
    """Two arms on a base; `more`: sections."""
    parts = "".join(
        f'''<body name="{n}" pos="0 {y} .3" {body}><joint name="j{n}" axis="0 1 0" {joint}/>
        <geom type="capsule" size=".03" fromto="0 0 0 .3 0 0"/><site name="s{n}"/></body>'''
        for n, y in (("a", 0), ("b", 0.3))
    )
    return f"""<mujoco><compiler angle="radian"/>{head}<worldbody><body name="base">
    <geom size=".1"/>{parts}</body></worldbody>{more}</mujoco>"""


FIXED = (
    '<tendon><fixed name="t" {}><joint joint="ja" coef="1"/><joint joint="jb" coef="2"/>'
    "</fixed></tendon>"
)
MIRROR = FIXED.format("").replace('"2"', '"-1"') + '<equality><tendon tendon1="t"/></equality>'
"""Arms that follow each other: to MuJoCo an equality of joints unless both move the same mass."""
MOVES = {
    "a polynomial": arms(
        '<equality><joint joint1="ja" joint2="jb" polycoef="0 1 .3 0 0"/></equality>'
    ),
    "held at a position": arms('<equality><joint joint1="ja" polycoef=".1 0 0 0 0"/></equality>'),
    "couplings of tendons": arms(FIXED.format("") + '<equality><tendon tendon1="t"/></equality>'),
    "couplings": arms(MIRROR).replace('<body name="base">', '<body name="base"><freejoint/>'),
    "tendons that pull": arms(FIXED.format('stiffness="3"')),
    "tendons that pull, brake or stop": arms(FIXED.format('range="-1 1"')),
    "actuators": arms(FIXED.format("") + '<actuator><motor tendon="t"/></actuator>'),
    "gravity compensation": arms(body='gravcomp=".5"'),
    "medium": arms(head='<option density="1.2"/>'),
    **{
        f"flags that switch something off (`{flag}`)": arms(
            head=f'<option><flag {flag}="disable"/></option>'
        )
        for flag in ("contact", "limit", "actuation", "damper", "clampctrl")
    },
    "groups of actuators that are switched off": arms(head='<option actuatorgroupdisable="2"/>'),
    "surfaces that move what touches them": arms().replace(
        'size=".1"', 'size=".1" surfacevel="1 0 0"'
    ),
    "holds the floating base (`damping` 3, `armature` 0.2;": arms().replace(
        '<body name="base">', '<body name="base"><joint type="free" armature=".2" damping="3"/>'
    ),
    "damping of joints by a polynomial": arms(joint='damping=".1 .2 0"'),
}
STILL = {
    "flags that switch nothing off": arms(
        head='<option><flag contact="enable" warmstart="disable" energy="enable"/></option>'
    ),
    "a constraint that is off": arms(
        '<equality><joint joint1="ja" joint2="jb" polycoef="0 1 .3 0 0" active="false"/></equality>'
    ),
    "a tendon without a force": arms(FIXED.format("")),
    "a coupling by a tendon that is one of joints": arms(MIRROR),
    "a linear coupling": arms('<equality><joint joint1="ja" joint2="jb"/></equality>'),
}


def told(text: str, folder: Path) -> tuple[list[Finding], list[Finding]]:
    """Findings on the source and on the USD, of lost motion."""
    done = written(text, folder)
    return (
        [f for f in done.findings if f.rule == "mjcf.motion"],
        [f for f in usd_findings(done) if f.rule == "usd.motion"],
    )


@pytest.mark.parametrize("what", MOVES)
def test_lost_motion_is_a_warning_and_an_error_for_the_usd(what: str, tmp_path: Path):
    (warning,), (error,) = told(MOVES[what], tmp_path)
    assert (warning.severity, error.severity) == ("warning", "error")
    assert what in warning.message
    assert what in error.message


@pytest.mark.parametrize("what", STILL)
def test_what_moves_nothing_is_neither(what: str, tmp_path: Path):
    assert told(STILL[what], tmp_path) == ([], [])


def test_bodies_without_weight_are_so_in_physx(tmp_path: Path):
    robot = pendulum()
    light = MjcfOnly("body", '<body gravcomp="1"/>', "arm")
    robot = replace(robot, control=replace(robot.control, mjcf_only=(light,)))
    found = list(unsupported(robot.tree, robot.control, UsdOptions()))
    assert [f.severity for f in found if f.rule == "usd.gravity"] == ["info"]
    assert not [f for f in found if f.rule == "usd.motion"]
    inputs = check_inputs(tmp_path, robot, Usd(robot="robot"), "usd")
    reader = UsdReader(robot="robot", options={"usd": UsdOptions().model_dump(mode="json")})
    assert run_step(reader, inputs, tmp_path / "same") == []
    stage = UsdCore.Stage.Open(str(inputs / "usd/robot.usda"))
    stage.GetPrimAtPath("/robot/arm").GetAttribute("physxRigidBody:disableGravity").Set(False)
    stage.Save()
    changed = run_step(reader, inputs, tmp_path / "changed")
    assert ("equal.usd.disablegravity", "body arm") in [(f.rule, f.subject) for f in changed]


def test_a_drive_that_makes_the_compensation_itself_is_lost(tmp_path: Path):
    text = arms(body='gravcomp="1"', joint='actuatorgravcomp="true"')
    _, (error,) = told(text, tmp_path)
    assert "gravity compensation" in error.message
