"""What PhysX and Newton must hold follows from the robot; what PhysX moves shows what it holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from newton_child import KINDS, plain
from tiny import TinyRobot, pendulum, tiny_quadruped, with_control, with_mimic

from assetbuild.facts.compare import differences, equality_findings
from assetbuild.facts.held import (
    HELD_BY_NEWTON,
    HELD_BY_PHYSX,
    PHYSX,
    _motion,
    newton_expected,
    newton_table,
    physx_expected,
)
from assetbuild.facts.reference import Assets, Reference
from assetbuild.facts.table import Key, Table
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.report.summary import WITHHELD, public_message
from assetbuild.robot.model import Actuator
from assetbuild.robot.pose import Pose, quat_of
from assetbuild.robot.shapes import Shapes
from assetbuild.simulators.experiments import Motion, Outcome
from assetbuild.simulators.physx.couplings import experiments, measured
from assetbuild.simulators.stages import TURN

LED = with_mimic(tiny_quadruped(), "FR_calf_joint", "FR_thigh_joint", -1.0, -0.8)


def reference(robot: TinyRobot) -> Reference:
    solid = replace(robot.shapes, shapes=tuple(robot.shapes.of("collision")))
    return Reference(robot.links, robot.tree, solid, robot.control, Assets(), {})


def expected(robot: TinyRobot, drive_type: str = "force", mimics: bool = True) -> Table:
    return physx_expected(reference(robot), drive_type=drive_type, mimics=mimics)


def newton(robot: TinyRobot) -> Table:
    return newton_expected(reference(robot), Shapes(), coupled=lambda joint: True, usd=True)


@pytest.mark.parametrize(
    ("held", "make"), [(HELD_BY_PHYSX, expected), (HELD_BY_NEWTON, newton)], ids=["physx", "newton"]
)
def test_what_a_simulator_tells_is_expected(
    held: Mapping[str, frozenset[str]], make: Callable[[TinyRobot], Table]
) -> None:
    tables = [make(robot) for robot in (pendulum(), LED)]
    stated = {(key.kind, key.quantity) for table in tables for key in table.facts}
    told = {(kind, quantity) for kind, of in held.items() for quantity in of}
    assert told <= VOCABULARY.keys()
    absent = {("joint", "anchor")}  # 0, where a joint is no other
    assert {pair for pair in told - stated if pair[0] != "shape"} <= absent


@pytest.mark.parametrize(
    ("model", "gains", "drive"),
    [("pd", True, "force"), ("ideal_pd", False, "force"), ("passive", False, "none")],
)
def test_physx_has_gains_where_it_integrates_the_drive(model: str, gains: bool, drive: str) -> None:
    row = Actuator("swing_joint", model, kp=8.0, kd=1.0, effort=5.0)
    moved = with_control(pendulum(), actuators=(row,))
    facts = expected(moved).of("joint", "swing_joint")
    assert (facts["kp"], facts["kd"]) == ((8.0, 1.0) if gains else (0.0, 0.0))
    assert facts["physx:drive"] == drive
    assert facts["effort"] == (None if model == "passive" else 5.0)


def test_mimics_are_expected_where_the_recipe_couples_them() -> None:
    key = Key("joint", "FR_calf_joint", "mimic multiplier")
    assert expected(LED).facts[key] == -1.0
    assert key not in expected(LED, mimics=False).facts


def test_a_motion_shows_kind_axis_and_anchor() -> None:
    half = TURN / 2
    turn = (math.cos(half), 0.0, 0.0, -math.sin(half))
    assert _motion(Pose((0.0, 0.0, 0.0), turn)) == {
        "type": "rotary", "axis": pytest.approx((0.0, 0.0, -1.0)),
    }  # fmt: skip
    slid = _motion(Pose((0.0, -TURN, 0.0)))
    assert slid == {"type": "linear", "axis": (0.0, -1.0, 0.0)}
    about = Pose((0.1, 0.0, 0.0)) @ Pose((0.0, 0.0, 0.0), turn) @ Pose((-0.1, 0.0, 0.0))
    assert _motion(about)["anchor"] == pytest.approx((0.1, 0.0, 0.0))
    assert quat_of(about.rotation) == pytest.approx(turn)


def coupled(multiplier: float, offset: float) -> dict[str, Outcome]:
    """What the experiment shows under a coupling."""
    (experiment,) = experiments(LED.tree, LED.control)
    positions, _ = experiment.sine.commands(2, 0.05)
    lead = np.array([experiment.sine.middle["FR_thigh_joint"], *positions["FR_thigh_joint"]])
    joints = {"FR_thigh_joint": lead, "FR_calf_joint": multiplier * lead + offset}
    zeros = np.zeros((3, 3))
    motion = Motion(np.arange(3.0), joints, zeros, np.zeros((3, 4)), zeros)
    return {experiment.name: Outcome(None, motion)}


def test_a_coupling_is_measured_as_physx_moves_it() -> None:
    found = measured(LED.tree, coupled(0.5, -1.0))["FR_calf_joint"]
    assert found.pop("mimics") == "FR_thigh_joint"
    assert found == pytest.approx({"mimic multiplier": 0.5, "mimic offset": -1.0})
    exact = measured(LED.tree, coupled(2.0, 1e-6))["FR_calf_joint"]
    assert (exact["mimic multiplier"], exact["mimic offset"]) == (pytest.approx(2.0), 0.0)


def test_figures_of_physx_stay_out_of_public_pages() -> None:
    table = expected(pendulum())
    heavier = Table({k: 3.0 if k.quantity == "mass" else v for k, v in table.facts.items()})
    (found,) = equality_findings(differences(table, heavier, PHYSX), "physx", "PhysX", {})
    assert found.rule == "equal.physx.mass"
    assert public_message(found) == WITHHELD


TENDON = """<mujoco><worldbody>
  <body><joint name="left" type="hinge"/><geom size="0.1"/></body>
  <body><joint name="right" type="hinge"/><geom size="0.1"/></body>
  <body><joint name="other" type="hinge"/><geom size="0.1"/></body>
</worldbody>
<equality><joint joint1="right" joint2="left" polycoef="0 {share} 0 0 0"/></equality>
<tendon><fixed name="split">
  <joint joint="right" coef="0.5"/><joint joint="{one}" coef="0.5"/>
</fixed></tendon>
<actuator>
  <position tendon="split" gear="4" kp="10" kv="1" forcerange="-5 5"/>
</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("share", "one", "left"),
    [
        (1.0, "left", (160.0, 16.0, 20.0)),
        (3.0, "left", (640.0, 64.0, 40.0)),
        (1.0, "other", (0.0, 0.0, None)),
    ],
    ids=["both", "right thrice as far", "two free joints"],
)
def test_newton_holds_a_tendon_s_drive_at_the_joint_that_the_others_follow(
    share: float, one: str, left: tuple[float, float, float | None]
) -> None:
    model = mujoco.MjModel.from_xml_string(TENDON.format(share=share, one=one))
    names = {
        kind: [getattr(model, kind)(i).name for i in range(len(getattr(model, array)))]
        for kind, array in KINDS.items()
    }
    held = plain(model) | {"opt": plain(model.opt), "names": names, "laws": {}}
    row = newton_table(held).of("joint", "left")
    assert (row.get("kp", 0.0), row.get("kd", 0.0), row.get("effort")) == left
