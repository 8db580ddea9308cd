"""Robots that cannot stand, each for one reason."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from checks.engines import needs_newton, needs_physx
from pxr import Usd, UsdPhysics
from robot_files import check_inputs, checked, figures, mjcf_inputs, models, run_step, spoil_stage
from tiny import TinyRobot, pendulum, tiny_quadruped, with_base, with_control, with_drives

from assetbuild.checks._mujoco import Slope
from assetbuild.checks._newton import NewtonSlope
from assetbuild.checks._physx import PhysxSlope
from assetbuild.checks.stand import Stand
from assetbuild.findings import Finding
from assetbuild.robot.model import Actuator, Keyframe
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Shape
from assetbuild.simulators.mujoco.slope import SLOW, creep
from assetbuild.simulators.mujoco.stand import Stand as Stood
from assetbuild.simulators.mujoco.stand import outcome, outcome_figures
from assetbuild.targets.mjcf import Mjcf, MjcfOptions

FEET = ".*_foot"
LEGS = ("FR", "FL", "RR", "RL")
DOG = tiny_quadruped()


def check(robot: TinyRobot, folder: Path, **fields: object) -> list[Finding]:
    step = Stand.model_validate({"feet": FEET} | fields)
    return run_step(step, mjcf_inputs(folder, robot), folder / "out")


def rules(found: list[Finding]) -> set[tuple[str, str]]:
    return {(f.rule, f.severity) for f in found}


@pytest.mark.parametrize("model", ["pd", "ideal_pd"])
def test_quadruped_stands_on_its_four_feet(model: str, tmp_path: Path) -> None:
    """Whoever applies the law: the simulator, or a controller outside."""
    assert check(with_drives(DOG, model=model), tmp_path) == []
    numbers = figures(tmp_path / "out")
    assert numbers["touching"] == [f"{leg}_foot_collision" for leg in ("FL", "FR", "RL", "RR")]
    assert abs(float(numbers["height_change_m"])) < 0.02
    assert numbers["stood"]["outcome"] == "stands"
    assert 0.0 < float(numbers["max_load"]) < 0.5


@pytest.mark.parametrize(
    ("drives", "rule", "severity"),
    [
        ({"kp": 1.0, "kd": 0.1}, "stand.fall", "error"),
        ({"kp": 1.0, "kd": 0.1}, "stand.contact", "error"),
        ({"model": "passive"}, "stand.fall", "error"),
        ({"kp": 25.0}, "stand.sag", "warning"),
        ({"effort": 2.0, "kp": 500.0}, "stand.torque", "warning"),
        # Without damping, at a stiffness far beyond what the timestep bears.
        ({"kp": 1e12, "kd": 0.0, "effort": None}, "stand.finite", "error"),
    ],
)
def test_drives_that_do_not_hold_it_are_found(
    tmp_path: Path, drives: dict[str, object], rule: str, severity: str
) -> None:
    found = rules(check(with_drives(DOG, **drives), tmp_path))
    assert (rule, severity) in found
    assert rule != "stand.sag" or ("stand.fall", "error") not in found
    assert figures(tmp_path / "out")["finite"] is (rule != "stand.finite")


@pytest.mark.parametrize(
    ("lift", "severity", "said"),
    [(0.05, "error", "50 mm above"), (-0.003, "warning", "3 mm inside"), (0.0009, "", "")],
)
def test_a_start_off_the_floor_is_found_in_millimetres(
    tmp_path: Path, lift: float, severity: str, said: str
) -> None:
    found = check(with_base(DOG, lift), tmp_path)
    starts = [f for f in found if f.rule == "stand.sole_gap"]
    feet = {f"link {leg}_foot" for leg in LEGS} if severity else set()
    assert {f.subject for f in starts} == feet
    assert all(f.severity == severity and said in f.message for f in starts)


def with_shapes(robot: TinyRobot, *more: Shape) -> TinyRobot:
    return replace(robot, shapes=replace(robot.shapes, shapes=(*robot.shapes.shapes, *more)))


CUBE = Box((0.02, 0.02, 0.02))
SHOES = [Shape(f"{leg}_shoe", f"{leg}_calf", "collision", CUBE) for leg in LEGS]
TAIL = Shape("tail", "trunk", "collision", Box((0.02, 0.02, 0.6)), Pose((-0.3, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("robot", "fields", "found"),
    [
        # A foot of several links stands on the lowest of them.
        (with_shapes(DOG, *SHOES), {"feet": ".*_(foot|calf)"}, set()),
        (with_shapes(DOG, TAIL), {}, {("stand.contact", "error", "link trunk")}),
        # Without a pattern anything may touch, and the lowest point counts.
        (DOG, {"feet": None}, set()),
        (with_base(DOG, 0.05), {"feet": None}, {("stand.sole_gap", "error", "link FL_foot")}),
        (DOG, {"max_drift": 1e-6, "max_tilt": 1e-6},
         {("stand.drift", "warning", "robot"), ("stand.tilt", "warning", "robot")}),
    ],
    ids=["feet of two links", "a tail", "no feet", "no feet, lifted", "own limits"],
)  # fmt: skip
def test_what_may_touch_and_how_far_it_may_move_is_the_recipe_s(
    robot: TinyRobot, fields: dict[str, object], found: set[tuple[str, str, str]], tmp_path: Path
) -> None:
    said = {(f.rule, f.severity, f.subject) for f in check(robot, tmp_path, **fields)}
    assert said == found if not found else found <= said


def test_a_fixed_robot_whose_drive_lets_go_falls(tmp_path: Path) -> None:
    """Held out sideways by a drive of 0.1 N m/rad, a pendulum swings down."""
    drive = Actuator("swing_joint", "pd", 0.1, 1.0, effort=5.0)
    out = Keyframe("home", (("swing_joint", 1.5),))
    robot = with_control(pendulum(), actuators=(drive,), keyframes=(out,))
    (fall,) = check(robot, tmp_path, feet=None)
    assert rules([fall]) == {("stand.fall", "error")} and fall.subject == "actuator swing_joint"
    assert figures(tmp_path / "out")["stood"]["outcome"] == "falls"


def stood(**values: object) -> Stood:
    """A robot of 0.5 m whose centre of mass is at 0.4 m, as it stood for 2 s."""
    base: dict[str, object] = {
        **dict.fromkeys(("sag_m", "tilt_rad", "drift_m", "com_sag_m"), 0.0),
        **{name: {} for name in ("gap_m", "overlapping", "load")},
        "joint_sag": {"hip": 0.1},
        **dict.fromkeys(("warnings", "touching", "touched"), ()),
        **{"seconds": 2.0, "finite": True, "floats": True, "driven": True},
        **{"worst_held": ("hip", 0.1, "rad"), "height_m": 0.5, "com_height_m": 0.4},
    }
    return Stood(**(base | values))  # type: ignore[arg-type] # each has its own type


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({}, "stands"),
        ({"driven": False}, "rests"),
        ({"floats": False, "worst_held": ("", 0.0, "rad")}, "rests"),
        ({"floats": False}, "holds"),
        ({"tilt_rad": 0.6}, "falls"),
        ({"finite": False}, "unstable"),
        # A base frame on the ground neither makes a fall nor hides one.
        ({"height_m": 0.0, "sag_m": 0.001}, "stands"),
        ({"height_m": 0.0, "com_sag_m": 0.3}, "falls"),
        ({"com_sag_m": -0.4}, "stands"),
        ({"com_sag_m": -0.6}, "falls"),  # thrown up
        ({"height_m": -0.002, "com_height_m": -0.002, "sag_m": 4e-5, "com_sag_m": 4e-5}, "stands"),
        ({"height_m": -0.002, "com_height_m": -0.002, "com_sag_m": -0.02}, "falls"),
    ],
)
def test_what_a_robot_does_is_one_of_five_words(values: dict[str, object], word: str) -> None:
    assert outcome(stood(**values), 0.5) == word


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"height_m": -5.55e-17, "sag_m": 0.001}, "base height 0 m at the start, -0.001 m at"),
        ({"floats": False, "worst_held": ("hip", 2.6e-20, "rad")}, "moves furthest, by 0 rad"),
    ],
)
def test_what_is_left_of_rounding_is_0(values: dict[str, object], words: str) -> None:
    assert words in str(outcome_figures(stood(**values), 0.5)["sentence"])


@pytest.mark.parametrize(
    ("words", "rule"), [({"keyframe": "sit"}, "stand.load"), ({"feet": "paw"}, "stand.feet")]
)
def test_a_keyframe_or_feet_that_are_not_there_are_an_error(
    words: dict[str, str], rule: str, tmp_path: Path
) -> None:
    assert (rule, "error") in rules(check(DOG, tmp_path, **words))


# --- slope ---------------------------------------------------------------------------------------


def evaluate(
    folder: Path, robot: TinyRobot = DOG, **options: str
) -> tuple[list[Finding], dict[str, dict]]:
    target = Mjcf(robot="robot", options=MjcfOptions.model_validate(options))
    inputs = check_inputs(folder, robot, target, "mjcf")
    return checked(Slope(robot="robot"), inputs, folder / "out")


def test_a_pyramidal_cone_without_impratio_lets_them_slide(tmp_path: Path) -> None:
    (found,), measured = evaluate(tmp_path, cone="pyramidal")
    assert found.rule == "slope.creep"
    assert measured["mjcf"]["speed_m_s"] > 1e-3


TOWER = """<mujoco><option cone="elliptic" impratio="10" timestep="0.002"/><worldbody>
<geom type="plane" size="0 0 1"/><body name="foot" pos="0 0 .02"><freejoint/>
<geom type="box" size=".15 .15 .02" mass="2" friction=".8"/><body name="tower">
<joint name="ankle" axis="0 1 0" damping="20"/><geom size=".05" pos="0 0 .8" mass="20"/></body>
</body></worldbody><actuator><position joint="ankle" kp="250"/></actuator>
<keyframe><key qpos="0 0 .02 1 0 0 0 0"/></keyframe></mujoco>"""


def test_a_tall_robot_that_rocks_when_the_ground_tilts_does_not_creep():
    """It swings at 0.4 Hz on its ankle, by which its foot slips at first."""
    slope = creep(mujoco.MjModel.from_xml_string(TOWER))
    assert not isinstance(slope, str)
    assert slope.speed < SLOW


def test_a_robot_at_the_edge_of_its_feet_is_not_judged():
    """On a slope of 5 mrad its rocking, scaled up a hundredfold, looked like metres a second."""
    edge = TOWER.replace('pos="0 0 .8"', 'pos=".155 0 .8"')
    assert "it tips over on 0.01" in str(creep(mujoco.MjModel.from_xml_string(edge)))


def test_feet_without_friction_are_not_judged(tmp_path: Path) -> None:
    contact = DOG.control.contact.model_copy(update={"condim": 1, "priority": 1})
    findings, measured = evaluate(tmp_path, with_control(DOG, contact=contact))
    assert findings == []
    assert measured["mjcf"]["skipped"] == "its feet have no friction"


def test_feet_stay_on_a_slope_that_friction_holds_flatter_where_drives_give_way(
    tmp_path: Path,
) -> None:
    angles = []
    for kp, kd in ((100.0, 3.0), (25.0, 1.0)):
        findings, measured = evaluate(tmp_path / str(kp), with_drives(DOG, kp=kp, kd=kd))
        assert findings == []
        row = measured["mjcf"]
        assert row["speed_m_s"] < 1e-3
        assert row["angle_rad"] == pytest.approx(0.8 * math.atan(row["friction"]), rel=1e-3)
        angles.append(row["angle_rad"])
    assert angles[1] <= angles[0] / 2.0


def slippery(stage: Usd.Stage) -> None:
    """Feet whose friction is lost, and that no longer win over the floor's."""
    for prim in stage.Traverse():
        if prim.HasAPI(UsdPhysics.MaterialAPI):
            prim.GetAttribute("physics:staticFriction").Set(0.05)
            prim.GetAttribute("physics:dynamicFriction").Set(0.05)
            prim.GetAttribute("physxMaterial:frictionCombineMode").Set("average")


@needs_physx
def test_feet_that_lost_their_friction_slide_in_physx(tmp_path: Path) -> None:
    inputs = models(tmp_path, DOG)
    assert run_step(PhysxSlope(robot="robot"), inputs, tmp_path / "good") == []
    spoil_stage(inputs / "usd/robot.usda", slippery)
    (found,) = run_step(PhysxSlope(robot="robot"), inputs, tmp_path / "bad")
    assert found.rule == "physx.slope"


@pytest.mark.slow
@needs_newton
def test_a_pyramidal_cone_slides_in_newton_too(tmp_path: Path) -> None:
    check, inputs = NewtonSlope(robot="robot", environment=""), models(tmp_path, DOG)
    assert run_step(check, inputs, tmp_path / "good") == []
    cone = Mjcf(robot="robot", options=MjcfOptions(cone="pyramidal"))
    run_step(cone, inputs, tmp_path / "pyramidal")
    shutil.copytree(tmp_path / "pyramidal/mjcf", inputs / "mjcf", dirs_exist_ok=True)
    (found,) = run_step(check, inputs, tmp_path / "bad")
    assert found.rule == "newton.slope"
