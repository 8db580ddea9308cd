"""The fit begins near the truth, also where a stiff drive's two terms nearly cancel."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from logs import ARMATURE, DAMPING, FRICTION, JOINTS, RATE_HZ, TWO_LINKS, arm, chirps, recorded

from assetbuild.identify.plant import Plant
from assetbuild.identify.record import Drive, Record
from assetbuild.identify.start import first_guess
from assetbuild.robot.model import Actuator, Control

WANTED = frozenset({"armature", "damping", "friction"})
DOWN = (0.0, 0.0, -9.81)


@pytest.mark.parametrize(("kp", "kd"), [(30.0, 1.0), (500.0, 50.0)])
def test_the_start_predicts_the_log(kp, kd):
    """kp times the error of the stiff one is six times its effort; kd takes nearly all away."""
    text = TWO_LINKS.format(dt=0.0002, a=ARMATURE, d=DAMPING, f=FRICTION, kp=kp, kd=kd)
    target = chirps(6.0)
    position, torque = recorded(mujoco.MjModel.from_xml_string(text), target, delay=0.0)
    assert np.abs(torque).max() < 50.0
    assert (kp * np.abs(target - position).max() > 50.0) == (kp > 100.0)
    rows = tuple(Actuator(joint, "pd", kp, kd, effort=50.0) for joint in JOINTS)
    plant = Plant(arm(), Control(actuators=rows), JOINTS, DOWN)
    record = Record(1.0 / RATE_HZ, position, target).from_rest()
    drives = [Drive(kp, kd, 0.01, 0.1, 0.0, 50.0) for _ in JOINTS]
    guess = first_guess(plant, [record], drives, [WANTED, WANTED])
    assert all(abs(drive.offset) < 1.0 for drive in guess)
    simulated, _ = plant.in_steps(plant.longest_for(guess)).simulate(record, [guess])
    assert np.sqrt(np.mean((simulated[0] - record.position) ** 2)) < 0.01
