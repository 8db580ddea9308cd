"""The UR10e from its xacro against the hand-made model of MuJoCo Menagerie, number by number.

Where the two differ the xacro is the newer: it carries the masses, centres and tensors of the
maker's article on dynamics (`physical_parameters.yaml`), which `test_..._of_its_yaml` holds us to.
The hand-made model has older masses and takes each link for a solid cylinder about the middle of
its bone, which `test_..._are_cylinders` shows of every number in it. The base, which has no such
data, is the same cylinder in both.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from assetbuild.init.look import InspectedRobot, look
from assetbuild.init.source import find_source
from assetbuild.robot.inertia import matrix_of, principal_moments
from assetbuild.robot.pose import Array

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
RADIUS_LENGTH = {
    "base": (0.075, 0.038),
    "shoulder_link": (0.075, 0.178),
    "upper_arm_link": (0.075, 0.613),
    "forearm_link": (0.075, 0.571),
    "wrist_1_link": (0.075, 0.12),
    "wrist_2_link": (0.075, 0.12),
    "wrist_3_link": (0.045, 0.05),
}
"""m, of the hand-made model's cylinders: the bones' lengths to the millimetre."""
MASS_DIFFERENCE_KG = {
    "shoulder_link": -0.409,
    "upper_arm_link": 0.121,
    "forearm_link": 0.119,
    "wrist_1_link": 0.14,
    "wrist_2_link": 0.02,
    "wrist_3_link": 0.413,
}
"""Ours less the hand-made model's: the maker's article against older numbers."""


@pytest.fixture(scope="module")
def shared() -> Path:
    named = os.environ.get("ASSETBUILD_SHARED")
    if not named or not (Path(named) / "data/ur_description").is_dir():
        pytest.skip("needs UR's xacro: set ASSETBUILD_SHARED (docs/contributing.md)")
    return Path(named)


@pytest.fixture(scope="module")
def ours(shared: Path) -> InspectedRobot:
    xacro = shared / "data/ur_description/urdf/ur.urdf.xacro"
    return look(find_source(xacro, {}, {"name": "ur10e", "ur_type": "ur10e"}))


@pytest.fixture(scope="module")
def gold(shared: Path) -> dict[str, Any]:
    return json.loads((shared / "gold/universal_robots_ur10e.json").read_text())


def body(gold: dict[str, Any], name: str) -> dict[str, Any]:
    return next(entry for entry in gold["bodies"] if entry["name"] == name)


def cylinder(mass: float, radius: float, length: float) -> list[float]:
    """Principal moments of a solid cylinder, rising, kg m2."""
    across = mass * (3 * radius**2 + length**2) / 12
    return sorted([across, across, mass * radius**2 / 2])


def test_ranges_are_those_of_the_hand_made_model(ours: InspectedRobot, gold: dict[str, Any]):
    """But for its rounding: 6.28319 for 2 pi, 3.1415 for pi."""
    assert len(gold["joints"]) == len(ours.tree.moving_joints) == 6
    for joint in gold["joints"]:
        limits = ours.tree.by_joint[joint["name"]].limits
        assert (limits.lower, limits.upper) == pytest.approx(joint["range"], abs=1e-4)


def test_the_base_is_the_same_cylinder(ours: InspectedRobot, gold: dict[str, Any]):
    theirs = body(gold, "base")
    base = ours.tree.bodies[0].inertial
    assert base is not None
    assert base.mass_kg == theirs["mass"] == 4.0
    moments = principal_moments(base.inertia_com_kg_m2)
    assert moments == pytest.approx(sorted(theirs["principal_inertia"]), rel=1e-6)


def test_masses_differ_by_what_the_article_changed(ours: InspectedRobot, gold: dict[str, Any]):
    for name, difference in MASS_DIFFERENCE_KG.items():
        inertial = ours.tree.by_body[name].inertial
        assert inertial is not None
        assert inertial.mass_kg - body(gold, name)["mass"] == pytest.approx(difference, abs=1e-9)
    total = sum(b.inertial.mass_kg for b in ours.tree.bodies if b.inertial)
    assert total - gold["total_mass"] == pytest.approx(sum(MASS_DIFFERENCE_KG.values()), abs=1e-9)


def test_the_hand_made_inertias_are_cylinders(gold: dict[str, Any]):
    for name, (radius, length) in RADIUS_LENGTH.items():
        theirs = body(gold, name)
        expected = cylinder(theirs["mass"], radius, length)
        assert sorted(theirs["principal_inertia"]) == pytest.approx(expected, rel=2e-5)


def test_bones_are_as_long_as_in_the_hand_made_model(ours: InspectedRobot, gold: dict[str, Any]):
    """To its rounding: it has 0.181, 0.613, 0.571, 0.12 m."""
    for joint, name, axis in (
        ("shoulder_pan_joint", "shoulder_link", 2),
        ("elbow_joint", "forearm_link", 2),
        ("wrist_1_joint", "wrist_1_link", 2),
        ("wrist_2_joint", "wrist_3_link", 2),  # its bodies begin one bend later
    ):
        offset = ours.tree.by_joint[joint].X_parent_joint.xyz
        assert max(map(abs, offset)) == pytest.approx(body(gold, name)["pos"][axis], abs=1e-3)


def test_masses_centres_and_tensors_are_those_of_its_yaml(ours: InspectedRobot, shared: Path):
    """The tensor stands in turned axes there: R I R^T, with R from roll, pitch, yaw."""
    path = shared / "data/ur_description/config/ur10e/physical_parameters.yaml"
    stated = yaml.safe_load(path.read_text().replace("!degrees ", ""))["inertia_parameters"]
    for link in LINKS:
        inertial = ours.tree.by_body[f"{link}_link"].inertial
        assert inertial is not None
        assert inertial.mass_kg == stated[f"{link}_mass"]
        centre, tensor = stated["center_of_mass"][f"{link}_cog"], stated["tensor"][link]
        assert inertial.com_m == pytest.approx([centre[axis] for axis in "xyz"], abs=1e-12)
        turn = turned(**stated["rotation"][link])
        words = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        matrix = turn @ matrix_of(tuple(tensor[word] for word in words)) @ turn.T  # type: ignore[arg-type] # six numbers
        assert matrix_of(inertial.inertia_com_kg_m2) == pytest.approx(matrix, abs=1e-12)


def turned(roll: float, pitch: float, yaw: float) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(v), math.sin(v)) for v in (roll, pitch, yaw))
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return z @ y @ x
