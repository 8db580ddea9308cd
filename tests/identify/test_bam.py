"""BAM's parameters become a motor as far as a joint can hold them, and the rest is named."""

import json

import pytest

from assetbuild.errors import UsageError
from assetbuild.identify.for_recipe import read_bam
from assetbuild.robot.actuator_table import Motor

M1 = {
    "kt": 1.2, "R": 3.0, "armature": 0.028, "q_offset": -0.05, "friction_base": 0.05,
    "friction_viscous": 0.06, "model": "m1", "actuator": "servo",
}  # fmt: skip


def test_m1_is_held_exactly():
    found = read_bam(json.dumps(M1), "m1.json", 12.0)
    motor = Motor(**found.motor)
    assert (motor.armature, motor.friction, motor.damping) == (0.028, 0.05, 0.06)
    assert motor.stall == pytest.approx(1.2 * 12.0 / 3.0)
    assert motor.velocity == pytest.approx(12.0 / 1.2)
    assert found.kd == pytest.approx(1.2**2 / 3.0)
    assert not found.lost and motor.source == "measured: BAM m1, m1.json"


def test_terms_of_stribeck_and_load_are_named():
    more = {"friction_stribeck": 0.01, "dtheta_stribeck": 2.0, "load_friction_motor": 0.2}
    found = read_bam(json.dumps(M1 | more | {"model": "m6"}), "m6.json", None)
    assert {name for name, _ in found.lost} == set(more)


def test_the_shape_of_a_term_that_is_nothing_is_nothing():
    more = {"friction_stribeck": 7.5e-17, "dtheta_stribeck": 2.0, "alpha": 1.3}
    assert not read_bam(json.dumps(M1 | more), "m2.json", None).lost


@pytest.mark.parametrize("text", ["", "[]", '{"kt": 1}', json.dumps(M1 | {"armature": -1})])
def test_another_file_is_refused(text):
    with pytest.raises(UsageError, match=r"x\.json"):
        read_bam(text, "x.json", None)
