"""The vocabulary: every quantity of a robot, declared once.

A quantity belongs to a kind of subject, has a name in the field's words, a unit, a way of being
compared, and says what a file means that does not state it. Readers and writers of tables use no
other names; what a format says beyond them is a word of its own (`usd:approximation`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from assetbuild.facts.table import Value
from assetbuild.robot.model import Simulation

Comparison = Literal[
    "number", "vector", "direction", "pose", "tensor", "length", "text", "flag", "names"
]
"""How two values are compared.

number: relative. vector: relative to its norm. direction: a unit vector. pose: position (m) and
quaternion wxyz, whose sign means nothing. tensor: (xx, yy, zz, xy, xz, yz), relative to its norm.
length: numbers in metres to a power, relative to the size of the shape that they belong to.
text, flag, names (a set): equal or not.
"""

Rank = Literal["CRITICAL", "HIGH", "MEDIUM", "LOW"]
"""How much a difference matters: CRITICAL: another robot, or it breaks. HIGH: it moves otherwise.
MEDIUM: it moves a little otherwise, or only in one simulator. LOW: it looks otherwise."""
RANKS: tuple[Rank, ...] = ("CRITICAL", "HIGH", "MEDIUM", "LOW")


@dataclass(frozen=True)
class Required:
    """A subject that exists states this quantity: there is no value that its absence means."""


REQUIRED = Required()


@dataclass(frozen=True)
class Quantity:
    """One quantity of one kind of subject. unstated: what a table means that has no such fact."""

    kind: str
    name: str
    comparison: Comparison
    unit: str
    rank: Rank
    about: str
    unstated: Value | Required = REQUIRED


_ROWS: Mapping[str, tuple[tuple[Any, ...], ...]] = {  # Any: as the fields of a quantity
    "robot": (
        ("base", "text", "", "CRITICAL", "`fixed` to the world or `floating`"),
        ("base pose", "pose", "m", "CRITICAL",
         "where a fixed root is held in the world", (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)),
        ("start pose", "pose", "m", "HIGH",
         "where a trainer puts the root at the start", None),
        ("soft limits", "number", "", "MEDIUM",
         "share of a joint's range beyond which a trainer punishes", 1.0),
        ("articulation root", "text", "", "CRITICAL", "the prim that carries the articulation", ""),
        ("self-collision", "flag", "", "HIGH",
         "whether parts of the robot touch one another", True),
        ("up axis", "text", "", "CRITICAL", "axis of the stage that points up", "Z"),
        ("metres per unit", "number", "m", "CRITICAL", "length of one unit of the file", 1.0),
        ("kilograms per unit", "number", "kg", "CRITICAL", "mass of one unit of the file", 1.0),
    ),
    "body": (
        ("parent", "text", "", "CRITICAL", "the body above it", ""),
        ("pose", "pose", "m", "CRITICAL", "in its parent where every joint is 0"),
        ("mass", "number", "kg", "CRITICAL", "mass", 0.0),
        ("centre of mass", "vector", "m", "HIGH", "in the body's frame", None),
        ("inertia", "tensor", "kg m2", "HIGH",
         "about the centre of mass, in the body's axes", None),
    ),
    "frame": (
        ("body", "text", "", "HIGH", "the body that carries it"),
        ("pose", "pose", "m", "HIGH", "in that body"),
    ),
    "joint": (
        ("type", "text", "", "CRITICAL", "rotary, linear, fixed, planar or floating"),
        ("body", "text", "", "CRITICAL", "the body that it moves"),
        ("parent", "text", "", "CRITICAL", "the body that it moves it against", ""),
        ("anchor", "vector", "m", "CRITICAL",
         "point of the axis, in the frame of the body it moves", (0.0, 0.0, 0.0)),
        ("axis", "direction", "", "CRITICAL",
         "in the axes of the body it moves; its sense counts", None),
        ("lower", "number", "rad or m", "HIGH", "lower limit of the position", None),
        ("upper", "number", "rad or m", "HIGH", "upper limit of the position", None),
        ("effort", "number", "N m or N", "HIGH", "limit of the drive's effort", None),
        ("velocity", "number", "rad/s or m/s", "MEDIUM", "limit of the velocity", None),
        ("damping", "number", "N m s/rad or N s/m", "HIGH", "passive damping of the joint", 0.0),
        ("friction", "number", "N m or N", "HIGH", "dry friction of the joint", 0.0),
        ("armature", "number", "kg m2 or kg", "HIGH", "reflected inertia of the rotor", 0.0),
        ("stiffness", "number", "N m/rad or N/m", "HIGH", "spring of the joint", 0.0),
        ("spring reference", "number", "rad or m", "HIGH", "where that spring rests", 0.0),
        ("mimics", "text", "", "CRITICAL", "the joint that leads it", ""),
        ("mimic multiplier", "number", "", "CRITICAL", "q = multiplier * q(leader) + offset", None),
        ("mimic offset", "number", "rad or m", "CRITICAL", "as above", None),
        ("model", "text", "", "HIGH",
         "kind of drive: pd, ideal_pd, dc_motor, velocity, motor, general, passive", "passive"),
        ("kp", "number", "N m/rad or N/m", "HIGH", "stiffness of the drive", 0.0),
        ("kd", "number", "N m s/rad or N s/m", "HIGH", "damping of the drive", 0.0),
        ("gear", "number", "", "HIGH", "effort on the joint for one unit of the drive's", 1.0),
        ("stall", "number", "N m or N", "MEDIUM", "effort at standstill of a dc motor", None),
        ("command range", "vector", "unit of the model", "MEDIUM", "least and most command", None),
        ("drive parameters", "text", "", "HIGH", "of MuJoCo's general actuator", ""),
        ("drive name", "text", "", "LOW", "where it is not the joint's own", ""),
        ("delay", "vector", "s", "MEDIUM", "least and most delay of the drive", (0.0, 0.0)),
        ("start", "number", "rad or m", "HIGH", "position at which a simulation starts", None),
        ("drive target", "number", "rad or m", "HIGH",
         "position at which the drive aims at the start", None),
    ),
    "loop": (
        ("type", "text", "", "CRITICAL",
         "connect: two points stay together; weld: two frames do"),
        ("body a", "text", "", "CRITICAL", "the body at one end"),
        ("body b", "text", "", "CRITICAL", "the body at the other end"),
        ("end a", "pose", "m", "CRITICAL",
         "what is held, in the frame of body a; of a point without a turn"),
        ("end b", "pose", "m", "CRITICAL", "as above, in body b"),
        ("torque scale", "number", "m", "MEDIUM",
         "weight of a weld's turn in MuJoCo's solver", None),
    ),
    "shape": (
        ("role", "text", "", "HIGH", "visual or collision"),
        ("body", "text", "", "CRITICAL", "the body that carries it"),
        ("geometry", "text", "", "HIGH", "box, sphere, cylinder, capsule or mesh"),
        ("pose", "pose", "m", "HIGH", "of a primitive in its body's frame", None),
        ("size", "vector", "m", "HIGH",
         "box: edges; sphere: radius; cylinder, capsule: radius, length", None),
        ("triangles", "number", "", "MEDIUM", "of a mesh", None),
        ("area", "length", "m2", "HIGH", "of a mesh's triangles", None),
        ("volume", "length", "m3", "HIGH",
         "within a mesh, about the mean of its corners; negative where it is inside out", None),
        ("mean corner", "length", "m", "HIGH",
         "mean of the corners of a mesh's triangles, in its body's frame", None),
        ("corner moments", "length", "m2", "HIGH",
         "mean of xx, yy, zz, xy, xz, yz of these corners", None),
        ("material", "text", "", "LOW", "name of its material", None),
        ("rgba", "vector", "", "LOW", "colour and opacity", None),
        ("texture", "text", "", "LOW", "digest of the pixels of its texture", None),
        ("texture corners", "vector", "", "LOW",
         "mean u, v, uu, vv, uv of the corners' texture coordinates", None),
        ("friction", "vector", "1, m, m", "HIGH", "sliding, torsional, rolling", None),
        ("condim", "number", "", "MEDIUM", "dimensions of a contact", None),
        ("priority", "number", "", "MEDIUM", "the surface with the higher one decides alone", 0.0),
        ("solref", "vector", "", "MEDIUM", "MuJoCo's softness", None),
        ("solimp", "vector", "", "MEDIUM", "MuJoCo's impedance", None),
        ("margin", "number", "m", "MEDIUM", "contacts exist from this distance", 0.0),
        ("gap", "number", "m", "MEDIUM", "part of the margin without force", 0.0),
        ("contype", "number", "", "CRITICAL", "MuJoCo's contype", None),
        ("conaffinity", "number", "", "CRITICAL", "MuJoCo's conaffinity", None),
        ("collides", "flag", "", "CRITICAL", "whether anything can touch it", None),
        ("restitution", "number", "", "MEDIUM", "bounciness", 0.0),
    ),
    "pair": (
        ("filtered", "flag", "", "CRITICAL",
         "two bodies that never collide, though both have collision shapes", False),
    ),
    "sensor": (
        ("type", "text", "", "HIGH", "MJCF's word: gyro, accelerometer, ..."),
        ("object", "text", "", "HIGH", "what it measures"),
        ("reference", "text", "", "HIGH", "in whose frame it measures", ""),
        ("cutoff", "number", "unit of the sensor", "MEDIUM", "largest reading", 0.0),
        ("noise", "number", "unit of the sensor", "LOW", "standard deviation", 0.0),
    ),
    "camera": (
        ("body", "text", "", "MEDIUM", "what carries it"),
        ("pose", "pose", "m", "MEDIUM", "in that body"),
        ("field of view", "number", "rad", "MEDIUM", "vertical"),
        ("resolution", "vector", "pixels", "LOW", "width and height", None),
        ("tracking", "text", "", "LOW", "how it follows", "fixed"),
    ),
    "keyframe": (
        ("base pose", "pose", "m", "HIGH", "of a floating base in the world", None),
        ("position", "number", "rad or m", "HIGH",
         "of a joint: subject `keyframe home/FR_hip_joint`"),
        ("target", "number", "rad or m", "HIGH", "command of that joint's drive", None),
    ),
    "simulation": (
        ("timestep", "number", "s", "HIGH", "of the simulation", None),
        ("decimation", "number", "", "HIGH", "simulation steps for each control step", None),
        ("gravity", "vector", "m/s2", "CRITICAL", "in the world", None),
        ("integrator", "text", "", "HIGH", "MuJoCo's integrator", "Euler"),
        ("cone", "text", "", "MEDIUM", "MuJoCo's friction cone", "pyramidal"),
        ("solver", "text", "", "MEDIUM", "MuJoCo's solver of constraints", "Newton"),
        ("iterations", "number", "", "MEDIUM", "most iterations of that solver", 100.0),
        ("line search iterations", "number", "", "MEDIUM", "most of its line search", 50.0),
        ("impratio", "number", "", "MEDIUM", "frictional to normal impedance", 1.0),
        ("tolerance", "number", "", "MEDIUM", "improvement at which that solver stops", 1e-8),
    ),
    "floor": (
        ("height", "number", "m", "HIGH", "of the scene's floor"),
        ("friction", "vector", "1, m, m", "HIGH",
         "of that floor: sliding, torsional, rolling", None),
    ),
}  # fmt: skip

VOCABULARY: Mapping[tuple[str, str], Quantity] = {
    (kind, row[0]): Quantity(kind, *row) for kind, rows in _ROWS.items() for row in rows
}
"""Every quantity by (kind, name)."""
MUJOCO_OPTIONS = tuple(
    f"simulation {name}"
    for kind, name in VOCABULARY
    if kind == "simulation" and name not in Simulation.model_fields
)
"""`kind name` of what only a simulation in MuJoCo has; the recipe's `simulation` has the rest."""
