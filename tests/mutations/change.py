"""What a mutation is, and how one value becomes another."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

ENOUGH = 1e-6
"""Relative: two numbers closer than this count as one, and no mutation makes one of the other."""
FROM_ZERO = 0.01
"""What a zero becomes, which has no percentage: SI units."""
RESIDUE = 1e-12
"""What rounding leaves of a zero, SI units: of a number below it no share is a change."""

WORDS = (
    ("Euler", "implicitfast", "implicit", "RK4"),
    ("pyramidal", "elliptic"),
    ("Newton", "CG", "PGS"),
    ("radian", "degree"),
    ("true", "false"),
    ("box", "sphere", "capsule", "cylinder"),
    ("position", "velocity", "motor"),
    ("hinge", "slide"),
    ("revolute", "continuous", "prismatic", "fixed"),
    ("X", "Y", "Z"),
    ("floating", "fixed"),
    ("acceleration", "force"),
    ("vertex", "faceVarying", "uniform"),
    ("guide", "default", "render", "proxy"),
    ("none", "catmullClark", "loop"),
    ("convexHull", "convexDecomposition", "boundingCube", "meshSimplification"),
    ("pd", "ideal_pd", "motor", "velocity"),
    ("rotY", "rotX", "rotZ"),
    ("abs", "scale", "add"),
    ("startup", "reset", "interval"),
    ("mjcf", "urdf"),
    ("float", "double"),
    ("point3f", "vector3f"),
    ("quatf", "quatd"),
    ("double3", "float3"),
    ("Xform", "Scope"),
    ("PhysicsRevoluteJoint", "PhysicsPrismaticJoint"),
    ("Cube", "Sphere", "Cylinder", "Capsule"),
)
"""Words that stand for one another, where a file has only one of them."""


@dataclass(frozen=True)
class Mutation:
    """One change of one place of one file.

    file: relative to the bundle. where: for people. what: the kind of change. before, after: the
    value as it stands there. key: how the walker finds the place again and what it does there.
    """

    file: str
    where: str
    what: str
    before: str
    after: str
    key: tuple[object, ...]

    def __str__(self) -> str:
        change = f"{self.before[:60]} -> {self.after[:60]}"
        return f"{self.file}: {self.where}, {self.what}: {change}"


def number_changes(value: float) -> dict[str, float]:
    """What to make of a number, by the name of the change."""
    whole = {"plus 1": value + 1} if float(value).is_integer() else {}
    if abs(value) < RESIDUE:
        return whole | {"from zero": FROM_ZERO}
    if not math.isfinite(value):
        return {"finite": 1.0, "zero": 0.0}
    return whole | {
        "1 %": value * 1.01,
        "10 %": value * 1.1,
        "sign": -value,
        "pi / 180": value * math.pi / 180,
        "times 1000": value * 1000,
        "zero": 0.0,
    }


def is_same(one: float, two: float) -> bool:
    """Whether two numbers are one, but for rounding."""
    return one == two or math.isclose(one, two, rel_tol=ENOUGH, abs_tol=RESIDUE)


def vector_changes(
    values: Sequence[float], random_: random.Random
) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Each change of a number once, at a component drawn for it; two unequal components swapped."""
    names = dict.fromkeys(name for value in values for name in number_changes(value))
    for name in names:
        able = [i for i, value in enumerate(values) if name in number_changes(value)]
        index = random_.choice(able)
        new = list(values)
        new[index] = number_changes(values[index])[name]
        yield name, tuple(new)
    pairs = [
        (i, j)
        for i in range(min(len(values), 12))
        for j in range(i)
        if not is_same(values[i], values[j])
    ]
    if pairs:
        i, j = random_.choice(pairs)
        new = list(values)
        new[i], new[j] = new[j], new[i]
        yield "swapped", tuple(new)


def other_text(text: str, pool: Sequence[str], random_: random.Random) -> str:
    """A text of the same kind: another of the file, else of `WORDS`, else a longer one."""
    others = sorted({word for word in pool if word != text})
    if not others:
        others = [word for row in WORDS if text in row for word in row if word != text]
    return random_.choice(others) if others else f"{text}x"


def numbers_in(text: str) -> tuple[float, ...] | None:
    """The numbers that a text consists of; None where it is no vector."""
    try:
        return tuple(float(word) for word in text.split()) or None
    except ValueError:
        return None
