"""Robots that cannot stand, each for one reason."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from tiny import TinyRobot, check_inputs, pendulum, run_step, tiny_quadruped

from assetbuild.checks.stand import Stand
from assetbuild.findings import Finding
from assetbuild.pipeline.recipes import whole_model
from assetbuild.robot.model import Actuator, Control, Keyframe
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Shape
from assetbuild.simulators.mujoco.stand import Stand as Stood
from assetbuild.simulators.mujoco.stand import outcome
from assetbuild.targets.mjcf import Mjcf

FEET = ".*_foot"


def check(robot: TinyRobot, folder: Path, **fields: object) -> list[Finding]:
    inputs = check_inputs(folder, robot, Mjcf(robot="robot"), "mjcf")
    step = Stand.model_validate({"feet": FEET} | fields)
    return run_step(step, inputs, folder / "out")


def figures(folder: Path) -> dict[str, object]:
    return json.loads((folder / "out/figures.json").read_text())


def rules(found: list[Finding]) -> set[tuple[str, str]]:
    return {(f.rule, f.severity) for f in found}


def with_drives(robot: TinyRobot, **changes: object) -> TinyRobot:
    actuators = tuple(replace(a, **changes) for a in robot.control.actuators)
    return replace(robot, control=replace(robot.control, actuators=actuators))


def with_base(robot: TinyRobot, lift: float) -> TinyRobot:
    """All keyframes higher by `lift`, m."""
    keys = []
    for key in robot.control.keyframes:
        assert key.base
        x, y, z = key.base.xyz
        keys.append(replace(key, base=Pose((x, y, z + lift), key.base.quat)))
    return replace(robot, control=replace(robot.control, keyframes=tuple(keys)))


def test_quadruped_stands_on_its_four_feet(tmp_path: Path) -> None:
    assert check(tiny_quadruped(), tmp_path) == []
    numbers = figures(tmp_path)
    assert numbers["touching"] == [f"{leg}_foot_collision" for leg in ("FL", "FR", "RL", "RR")]
    assert abs(float(numbers["height_change_m"])) < 0.02
    assert numbers["stood"]["outcome"] == "stands"
    assert 0.0 < float(numbers["max_load"]) < 0.5


def test_gains_outside_the_simulator_hold_it_too(tmp_path: Path) -> None:
    assert check(with_drives(tiny_quadruped(), model="ideal_pd"), tmp_path) == []


def test_tiny_gains_collapse(tmp_path: Path) -> None:
    found = rules(check(with_drives(tiny_quadruped(), kp=1.0, kd=0.1), tmp_path))
    assert ("stand.fall", "error") in found
    assert ("stand.sag", "warning") in found
    assert ("stand.contact", "error") in found


def test_passive_legs_collapse(tmp_path: Path) -> None:
    assert ("stand.fall", "error") in rules(
        check(with_drives(tiny_quadruped(), model="passive"), tmp_path)
    )


def test_soft_gains_sag_without_falling(tmp_path: Path) -> None:
    found = rules(check(with_drives(tiny_quadruped(), kp=25.0), tmp_path))
    assert ("stand.sag", "warning") in found
    assert "stand.fall" not in {rule for rule, _ in found}


def test_weak_motors_are_saturated(tmp_path: Path) -> None:
    found = rules(check(with_drives(tiny_quadruped(), effort=2.0, kp=500.0), tmp_path))
    assert ("stand.torque", "warning") in found


def test_floating_start_is_found_in_millimetres(tmp_path: Path) -> None:
    found = [
        f for f in check(with_base(tiny_quadruped(), 0.05), tmp_path) if f.rule == "stand.start"
    ]
    assert {(f.severity, f.subject) for f in found} == {
        ("error", f"link {leg}_foot") for leg in ("FR", "FL", "RR", "RL")
    }
    assert "50 mm above the floor" in found[0].message


def test_start_inside_the_floor_is_found(tmp_path: Path) -> None:
    found = check(with_base(tiny_quadruped(), -0.003), tmp_path)
    assert ("stand.start", "warning") in rules(found)
    assert any("3 mm inside the floor" in f.message for f in found)


def test_a_millimetre_is_good_enough(tmp_path: Path) -> None:
    assert check(with_base(tiny_quadruped(), 0.0009), tmp_path) == []


def test_a_foot_of_several_links_stands_on_the_lowest_of_them(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    shoes = [
        Shape(f"{leg}_shoe", f"{leg}_calf", "collision", Box((0.02, 0.02, 0.02)))
        for leg in ("FR", "FL", "RR", "RL")
    ]
    robot = replace(robot, shapes=replace(robot.shapes, shapes=(*robot.shapes.shapes, *shoes)))
    assert check(robot, tmp_path, feet=".*_(foot|calf)") == []


def test_what_is_no_foot_may_not_touch_the_floor(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    tail = Shape("tail", "trunk", "collision", Box((0.02, 0.02, 0.6)), Pose((-0.3, 0.0, 0.0)))
    robot = replace(robot, shapes=replace(robot.shapes, shapes=(*robot.shapes.shapes, tail)))
    found = check(robot, tmp_path)
    assert ("stand.contact", "error", "link trunk") in {
        (f.rule, f.severity, f.subject) for f in found
    }


def test_feet_without_shapes_are_found(tmp_path: Path) -> None:
    assert ("stand.feet", "error") in rules(check(tiny_quadruped(), tmp_path, feet="paw"))


def test_without_a_pattern_anything_may_touch_and_the_lowest_point_counts(tmp_path: Path) -> None:
    assert check(tiny_quadruped(), tmp_path / "a", feet=None) == []
    found = check(with_base(tiny_quadruped(), 0.05), tmp_path / "b", feet=None)
    assert sum(f.rule == "stand.start" for f in found) == 1


def test_drift_and_tilt_have_their_own_limits(tmp_path: Path) -> None:
    found = check(tiny_quadruped(), tmp_path, max_drift=1e-6, max_tilt=1e-6)
    assert rules(found) == {("stand.drift", "warning"), ("stand.tilt", "warning")}


def test_explosion_is_told_from_standing(tmp_path: Path) -> None:
    """A torque loop far beyond its stability limit 2 I / dt."""
    wild = with_drives(tiny_quadruped(), model="ideal_pd", kp=1e9, kd=1e9, effort=None)
    found = check(wild, tmp_path)
    assert rules(found) == {("stand.finite", "error")}
    assert figures(tmp_path)["finite"] is False


def test_shapes_inside_one_another_are_found(tmp_path: Path) -> None:
    robot = tiny_quadruped()
    horn = Shape("horn", "FR_thigh", "collision", Box((0.02, 0.3, 0.02)), Pose((0.0, 0.0, 0.0)))
    robot = replace(robot, shapes=replace(robot.shapes, shapes=(*robot.shapes.shapes, horn)))
    assert ("stand.overlap", "warning") in rules(check(robot, tmp_path))


def test_fixed_base_is_judged_by_its_joints_only(tmp_path: Path) -> None:
    robot = pendulum()
    drive = Actuator("swing_joint", "pd", 50.0, 2.0, effort=5.0)
    control = Control((drive,), robot.control.keyframes)
    assert check(replace(robot, control=control), tmp_path, feet=None) == []
    assert abs(float(figures(tmp_path)["max_joint_sag"])) < 1e-6


def test_a_fixed_robot_whose_drive_lets_go_falls(tmp_path: Path) -> None:
    """Held out sideways by a drive of 0.1 N m/rad, a pendulum swings down."""
    robot = pendulum()
    drive = Actuator("swing_joint", "pd", 0.1, 1.0, effort=5.0)
    control = Control((drive,), (Keyframe("home", (("swing_joint", 1.5),)),))
    (fall,) = check(replace(robot, control=control), tmp_path, feet=None)
    assert (fall.rule, fall.severity, fall.subject) == (
        "stand.fall",
        "error",
        "actuator swing_joint",
    )
    assert figures(tmp_path)["stood"]["outcome"] == "falls"


def test_a_fall_is_told_with_the_heights_before_and_after(tmp_path: Path) -> None:
    limp = with_drives(tiny_quadruped(), model="passive")
    found = [f for f in check(limp, tmp_path) if f.rule == "stand.fall"]
    assert found[0].message.startswith("fell within 2 s: its base went from ")


def stood(**values: object) -> Stood:
    """A robot of 0.5 m whose centre of mass is at 0.4 m, as it stood for 2 s."""
    base: dict[str, object] = {
        **dict.fromkeys(("sag_m", "tilt_rad", "drift_m", "com_sag_m"), 0.0),
        **{name: {} for name in ("gap_m", "overlapping", "load")},
        "joint_sag": {"hip": 0.1},
        **dict.fromkeys(("warnings", "touching", "touched", "slides"), ()),
        **{"seconds": 2.0, "finite": True, "floats": True, "driven": True, "held": ("hip",)},
        **{"height_m": 0.5, "com_height_m": 0.4},
    }
    return Stood(**(base | values))  # type: ignore[arg-type] # each has its own type


def test_what_a_robot_does_is_one_of_five_words() -> None:
    assert outcome(stood(), 0.5) == "stands"
    assert outcome(stood(driven=False), 0.5) == "rests"
    assert outcome(stood(floats=False, held=()), 0.5) == "rests"
    assert outcome(stood(floats=False), 0.5) == "holds"
    assert outcome(stood(tilt_rad=0.6), 0.5) == "falls"
    assert outcome(stood(finite=False), 0.5) == "unstable"


def test_a_base_frame_on_the_ground_neither_makes_a_fall_nor_hides_one() -> None:
    assert outcome(stood(height_m=0.0, sag_m=0.001), 0.5) == "stands"
    assert outcome(stood(height_m=0.0, com_sag_m=0.3), 0.5) == "falls"


def test_missing_keyframe_is_an_error(tmp_path: Path) -> None:
    found = check(tiny_quadruped(), tmp_path, keyframe="sit")
    assert rules(found) == {("stand.load", "error")}


def test_recipe_decides() -> None:
    base = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": ".", "urdf": "r.urdf"}}
    asked = base | {"validate": {"stand": {"keyframe": "home", "feet": FEET}}}
    assert Stand.configure(whole_model().model_validate(base)) is None
    assert Stand.configure(whole_model().model_validate(asked)) == Stand(keyframe="home", feet=FEET)
