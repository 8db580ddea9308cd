"""Effective gains are those of closed forms; each rule has a robot that trips it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from robot_files import checked, laid_out, mjcf_inputs, rules
from tiny import TinyRobot, pendulum, with_control

from assetbuild.checks.gains import Gains
from assetbuild.findings import Finding
from assetbuild.robot.model import Actuator, Keyframe, Simulation

ROD = (0.02**2 + 0.5**2) / 12 + 0.25**2
"""kg m2 of the pendulum's arm about its hinge."""


def arm(timestep: float = 0.002, **fields: object) -> TinyRobot:
    """The pendulum at 0.5 rad with a position drive."""
    drive = replace(Actuator("swing_joint", "pd", kp=40.0, kd=2.0, effort=9.0), **fields)
    key = Keyframe("home", (("swing_joint", 0.5),))
    simulation = Simulation(timestep=timestep)
    return with_control(pendulum(), actuators=(drive,), keyframes=(key,), simulation=simulation)


def evaluate(robot: TinyRobot, folder: Path, **said: object) -> tuple[list[Finding], dict]:
    findings, figures = checked(Gains(**said), laid_out(folder / "in", robot), folder / "out")
    return findings, figures["joints"]


def test_figures_of_an_arm_are_those_of_the_textbook(tmp_path: Path) -> None:
    findings, joints = evaluate(arm(damping=0.1, armature=0.05), tmp_path)
    one, inertia = joints["swing_joint"], ROD + 0.05
    assert one["inertia"] == pytest.approx(inertia, rel=2e-4)
    assert one["frequency_hz"] == pytest.approx(math.sqrt(40.0 / inertia) / 2 / math.pi, rel=2e-4)
    assert one["damping_ratio"] == pytest.approx(2.1 / 2 / math.sqrt(40.0 * inertia), rel=2e-4)
    assert one["holding"] == pytest.approx(9.81 * 0.25 * math.sin(0.5), rel=2e-4)
    assert one["sag"] == pytest.approx(one["holding"] / 40.0, rel=2e-4)
    assert rules(findings) == set()


BAD = {
    "gains.torque": arm(effort=1.0),
    "gains.sag": arm(kp=3.0),
    "gains.saturated": arm(kp=400.0, kd=5.0),
    "gains.unstable": arm(model="ideal_pd", timestep=0.02, kp=40.0, kd=12.0, effort=90.0),
    "gains.underdamped": arm(kd=0.1),
    "gains.overdamped": arm(kd=60.0),
    "gains.damped_twice": arm(damping=1.5),
}


@pytest.mark.parametrize("rule", BAD)
def test_each_rule_speaks_on_a_bad_arm(rule: str, tmp_path: Path) -> None:
    findings, _ = evaluate(BAD[rule], tmp_path, inherited=True)
    assert {rule, "gains.inherited"} <= rules(findings)
    assert " to " not in next(f.message for f in findings if f.rule == "gains.inherited")


@pytest.mark.parametrize(
    ("kp", "ratio", "creeps"),
    [(40.0, 2.9, False), (40.0, 3.2, True), (4000.0, 3.2, False), (3.0, 2.0, False)],
)
def test_a_joint_creeps_by_its_damping_and_by_how_long_it_takes(
    kp: float, ratio: float, creeps: bool, tmp_path: Path
) -> None:
    """A ratio of 3.2 at 40 N m/rad lags by 2 * 3.2 * sqrt(I / kp) = 0.29 s, at 4000 by 29 ms."""
    findings, _ = evaluate(arm(kp=kp, kd=2.0 * ratio * math.sqrt(kp * ROD)), tmp_path)
    creeping = [each for each in findings if each.rule == "gains.overdamped"]
    assert bool(creeping) == creeps
    for each in creeping:
        assert each.data["lag_s"] == pytest.approx(2 * ratio * math.sqrt(ROD / kp), rel=1e-3)


@pytest.mark.parametrize(("friction", "rings"), [(0.2, True), (0.8, False)])
def test_dry_friction_stops_a_joint_without_damping(
    friction: float, rings: bool, tmp_path: Path
) -> None:
    """Each half of a swing is shorter by 2 F / kp: 0.1 rad ends after ten of them, or after two."""
    findings, _ = evaluate(arm(kd=0.0, friction=friction), tmp_path)
    assert ("gains.underdamped" in rules(findings)) == rings


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_the_margin_is_where_mujoco_diverges(
    integrator: str, factor: float, tmp_path: Path
) -> None:
    """kp and kd grown to just below and just above the limit, without gravity."""
    soft = arm(timestep=0.01, kp=1000.0, kd=3.0, effort=None)
    _, joints = evaluate(soft, tmp_path / "a", integrator=integrator)
    grow = factor * joints["swing_joint"]["margin"]
    drive = replace(soft.control.actuators[0], kp=1000.0 * grow, kd=3.0 * grow)
    if integrator == "implicitfast":  # the margin counts kp only where kd is implicit
        drive = replace(drive, kd=3.0)
    still = Simulation(timestep=0.01, gravity=(0, 0, 0))
    grown = with_control(soft, actuators=(drive,), keyframes=(), simulation=still)
    file = mjcf_inputs(tmp_path / "b", grown) / "mjcf/robot.xml"
    model = mujoco.MjModel.from_xml_path(str(file))

    model.opt.integrator = {"Euler": 0, "implicitfast": 3}[integrator]
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    data = mujoco.MjData(model)
    data.qpos[0] = 1e-3
    worst = 0.0
    for _ in range(100):
        mujoco.mj_step(model, data)
        worst = max(worst, abs(float(data.qpos[0])))
    assert (worst < 1.0) == (factor < 1)
