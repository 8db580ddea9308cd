"""A gripper as model values: what a quadruped lacks."""

from __future__ import annotations

from io import BytesIO

import numpy as np
from PIL import Image
from tiny import TinyRobot, box_inertial, box_obj

from assetbuild.robot.model import (
    Actuator,
    Body,
    Contact,
    Control,
    Joint,
    Keyframe,
    Limits,
    Mimic,
    Tree,
)
from assetbuild.robot.pose import Pose, normalised_quat
from assetbuild.robot.shapes import Cylinder, Material, Mesh, MeshAsset, Shape, Shapes, Sphere


def gripper() -> TinyRobot:
    """A fixed base, a kept tool body on a slide, and two fingers: one drives, one mimics it.

    Meshes are collider and picture, one of them with a texture and normals at its corners.
    """
    names = ("base", "slide", "tool", "a", "b")
    bodies = [Body(name, box_inertial(1.0, (0.1, 0.2, 0.3))) for name in names]
    turned = normalised_quat((0.9, 0.1, -0.3, 0.2))
    joints = (
        Joint("lift", "prismatic", "base", "slide", Pose((0.0, 0.0, 0.5)), (0.0, 0.0, -1.0),
              Limits(-0.02, 0.04, 70.0, 0.2)),
        Joint("hold", "fixed", "slide", "tool", Pose((0.1, 0.0, 0.2), turned)),
        Joint("a_joint", "revolute", "tool", "a", Pose((0.0, 0.1, 0.0), turned), (0.0, 0.6, 0.8),
              Limits(-1.0, 2.0, 5.0, 10.0)),
        Joint("b_joint", "revolute", "tool", "b", Pose((0.0, -0.1, 0.0)), (-1.0, 0.0, 0.0),
              Limits(-2.0, 2.0, 5.0, 10.0), mimic=Mimic("a_joint", -1.5, 0.25)),
    )  # fmt: skip
    tree = Tree("gripper", "fixed", tuple(bodies), joints, (), Pose((0.0, 0.3, 0.2), turned))
    place = Pose((0.01, 0.02, 0.03), turned)
    shapes = [Shape("skin", "tool", "visual", Mesh("tile"), place, material="wood"),
              Shape("b_skin", "b", "visual", Sphere(0.05), place, material="red")]  # fmt: skip
    shapes += [Shape(f"{n}_hull", n, "collision", Mesh("block"), place) for n in names]
    shapes.append(Shape("a_pad", "a", "collision", Cylinder(0.02, 0.05), place))
    materials = (
        Material("wood", (0.9, 0.8, 0.7, 1.0), "wood.png"),
        Material("red", (1, 0, 0, 0.5)),
    )
    assets = (
        MeshAsset("tile", "tile.obj", 4, 2),
        MeshAsset("block", "block.obj", 8, 12, convex=True),
    )
    rows = (
        Actuator("lift", "pd", kp=3500.0, kd=175.0, armature=0.3, effort=70.0, velocity=0.2),
        Actuator("a_joint", "velocity", kd=2.0, damping=0.3, friction=0.1, effort=5.0),
        Actuator("b_joint", "passive", damping=0.4),
    )
    home = Keyframe("home", (("lift", 0.03), ("a_joint", 0.5), ("b_joint", -0.5)))
    pads = Contact(friction=(1.5, 0.02, 0.01), contype=2, conaffinity=2)
    control = Control(rows, (home,), (("a", "b"), ("base", "slide")), contacts=(("a_pad", pads),))
    return TinyRobot(tree, tree, Shapes(tuple(shapes), materials, assets), control, {
        "tile.obj": TILE, "block.obj": box_obj((0.02, 0.04, 0.06)), "wood.png": picture(),
    })  # fmt: skip


TILE = b"""v 0 0 0
v 0.1 0 0
v 0.1 0.1 0
v 0 0.1 0.01
vt 0 0
vt 2 0
vt 2 1
vt 0 1
vn 0 0 1
vn 0 0.6 0.8
f 1/1/1 2/2/1 3/3/2
f 1/1/1 3/3/2 4/4/2
"""


def picture(value: int = 200) -> bytes:
    """A PNG of six grey pixels."""
    held = BytesIO()
    Image.fromarray(np.full((2, 3, 3), value, dtype=np.uint8)).save(held, "PNG")
    return held.getvalue()
