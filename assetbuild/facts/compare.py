"""The difference of two tables of facts, and the findings that report it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from assetbuild.errors import quoted
from assetbuild.facts.table import Key, Table, Value
from assetbuild.facts.vocabulary import RANKS, VOCABULARY, Comparison, Quantity, Rank, Required
from assetbuild.findings import Finding, Rule, Scalar
from assetbuild.grouping import grouped
from assetbuild.robot.pose import normalised_quat, rotation_of

EXACT: Mapping[Comparison, float] = {
    "number": 1e-9, "vector": 1e-9, "direction": 1e-9, "pose": 1e-9, "tensor": 1e-9, "length": 1e-9
}  # fmt: skip
FLOAT32: Mapping[Comparison, float] = {
    "number": 2e-7, "vector": 2e-7, "direction": 1e-6, "pose": 1e-6, "tensor": 1e-6, "length": 3e-7
}  # fmt: skip
"""float32 holds 6e-8 of a number's size: 2e-7 covers that and one conversion of units; directions
and tensors come from a float32 quaternion."""
ROUNDING = 1e-14
"""Absolute, SI units: where the expected value is zero."""
LEAST_REACH_M = 0.3
"""So far the corners of a small part may lie from the origin of its file."""
NAMED = 3
"""So many subjects of one difference are named."""


def _renamed(
    old: str, form: str, parts: Mapping[str, str], kinds: Sequence[str] = ()
) -> dict[str, tuple[str, ...]]:
    """Old ids -> what says it now. parts: by quantity; kinds: those about one kind of subject."""
    new_ids = {
        f"{old}.{part}": tuple(f"equal.{form}.{name}" for name in names.split())
        for part, names in parts.items()
    }
    return new_ids | {f"{old}.{kind}": (f"equal.{form}.* {kind}",) for kind in kinds}


_MASKS = {"mask": "contype", "partners": "conaffinity"}
_WAS = {
    **{
        old: new
        for form in ("bare", "mjcf", "mjx", "source")
        for old, new in _renamed(f"equal.{form}", form, _MASKS).items()
    },
    **_renamed(
        "equal.mjcf",
        "mjcf",
        {
            "actuator": "model missing", "com": "centre_of_mass", "ctrl": "command_range",
            "contact": "friction condim priority solref solimp contype conaffinity",
            "count": "missing extra filtered", "gains": "kp kd drive_parameters",
            "limits": "lower upper", "option": "timestep gravity", "total_mass": "mass",
        },
        ("body", "camera", "frame", "joint", "keyframe", "sensor", "shape"),
    ),
    **_renamed(
        "equal.usd",
        "usd",
        {
            "com": "centre_of_mass", "connection": "parent body", "drive": "model",
            "excludes": "filtered", "gains": "kp kd", "joint_frame": "anchor pose",
            "limits": "lower upper", "root": "base_pose", "surface": "friction restitution",
            "target": "drive_target",
        },
        ("frame", "shape"),
    ),
    **_renamed(
        "physx",
        "physx",
        {
            "base": "base", "com": "centre_of_mass", "count.bodies": "missing extra",
            "count.dof": "dof", "count.shapes": "shapes", "drive": "model drive",
            "gains": "kp kd", "limits": "lower upper", "missing_joint": "missing",
            "missing_link": "missing", "root": "base_pose",
        } | {same: same for same in ("armature", "damping", "effort", "friction", "inertia", "mass",
                                     "velocity")},
    ),
    **_renamed("urdf.reload", "urdf", {
        "kinematics": "pose axis",
        "limits": "lower upper effort velocity", "mass": "mass centre_of_mass", "mesh": "missing",
    }),
    "smoke.reading": ("equal.newton.*",),
}  # fmt: skip
"""The rules of version 0.1, in which every check had names of its own, and masks others."""

EQUAL = Rule(
    "equal.*",
    "error",
    "a file says something else than the robot (`equal.<format>.<quantity>`), or lacks it "
    "(`.missing`), or has more (`.extra`)",
    "if nobody edited the bundle, the target or its reader has a bug: report it with both values",
    was=_WAS,
)


@dataclass(frozen=True)
class Precision:
    """How exactly a format holds its facts: tolerance by comparison, and by (kind, quantity).

    turn: least tolerance of a pose's rotation, rad.
    """

    by_comparison: Mapping[Comparison, float] = field(default_factory=lambda: EXACT)
    by_quantity: Mapping[tuple[str, str], float] = field(default_factory=dict)
    turn: float = 1e-15

    def of(self, key: Key, comparison: Comparison) -> float:
        """Relative tolerance of one fact."""
        tolerance = self.by_quantity.get((key.kind, key.quantity))
        return self.by_comparison.get(comparison, 0.0) if tolerance is None else tolerance

    def coarser(self, other: Precision) -> Precision:
        """The larger tolerance of both, for what is compared between two formats."""
        kinds = {*self.by_comparison, *other.by_comparison}
        one, two = self.by_comparison, other.by_comparison
        both = {kind: max(one.get(kind, 0.0), two.get(kind, 0.0)) for kind in kinds}
        keys = {*self.by_quantity, *other.by_quantity}
        of = {k: max(self.by_quantity.get(k, 0.0), other.by_quantity.get(k, 0.0)) for k in keys}
        return Precision(both, of, max(self.turn, other.turn))

    def at_least(self, tolerance: float) -> Precision:
        """No finer than a tolerance."""
        kinds = {kind: max(own, tolerance) for kind, own in self.by_comparison.items()}
        keys = {key: max(own, tolerance) for key, own in self.by_quantity.items()}
        return replace(self, by_comparison=kinds, by_quantity=keys)


@dataclass(frozen=True)
class Difference:
    """One fact that two tables state differently.

    what: "value", or "missing" or "extra" of a whole subject, which then has no values.
    before, after: the values; of a quantity that one does not state, what its absence means.
    """

    key: Key
    before: Value
    after: Value
    what: str = "value"

    @property
    def quantity(self) -> Quantity | None:
        """The row of the vocabulary; None for a word of one format."""
        return VOCABULARY.get((self.key.kind, self.key.quantity))

    @property
    def rank(self) -> Rank:
        """How much it matters; of a whole subject the worst that its quantities can be."""
        if self.what == "value":
            return self.quantity.rank if self.quantity else "MEDIUM"
        ranks = [row.rank for row in VOCABULARY.values() if row.kind == self.key.kind]
        return min(ranks, key=RANKS.index, default="MEDIUM")


def differences(before: Table, after: Table, precision: Precision) -> list[Difference]:
    """All facts that differ, worst first, in the order of the first table."""
    gone, new = _absent(before, after), _absent(after, before)
    mismatches = [Difference(Key(*subject, ""), None, None, "missing") for subject in gone]
    mismatches += [Difference(Key(*subject, ""), None, None, "extra") for subject in new]
    whole = {*gone, *new}
    for key in dict.fromkeys((*before.facts, *after.facts)):
        if (key.kind, key.name) in whole:
            continue
        old, now = _value(before, key), _value(after, key)
        if not _same(key, old, now, precision, before):
            mismatches.append(Difference(key, _plain(old), _plain(now)))
    return sorted(mismatches, key=lambda d: RANKS.index(d.rank))


def _absent(here: Table, there: Table) -> list[tuple[str, str]]:
    """Subjects of one table that the other lacks though such a subject states something always."""
    known = {key[:2] for key in there.facts}
    lost = (key for key in here.facts if key[:2] not in known)
    return [*dict.fromkeys(key[:2] for key in lost if isinstance(_value(there, key), Required))]


def _value(table: Table, key: Key) -> Value | Required:
    if key in table.facts:
        return table.facts[key]
    quantity = VOCABULARY.get((key.kind, key.quantity))
    return quantity.unstated if quantity else None


def _plain(value: Value | Required) -> Value:
    return None if isinstance(value, Required) else value


def _same(
    key: Key, old: Value | Required, new: Value | Required, precision: Precision, table: Table
) -> bool:
    if isinstance(old, Required) or isinstance(new, Required):
        return old is new
    if old == new:
        return True
    if old is None or new is None or isinstance(old, bool | str) or isinstance(new, bool | str):
        return False
    quantity = VOCABULARY.get((key.kind, key.quantity))
    comparison: Comparison = quantity.comparison if quantity else _guessed(key, old)
    if comparison == "names":
        return set(_items(old)) == set(_items(new))
    a, b = _numbers(old), _numbers(new)
    if a is None or b is None or len(a) != len(b):
        return False
    tolerance = precision.of(key, comparison)
    if comparison == "pose":
        shape = table.facts.get(Key(key.kind, key.name, "geometry"))
        return _same_pose(a, b, tolerance, max(tolerance, precision.turn), shape)
    size = math.hypot(*a)
    if comparison == "length" and quantity is not None:
        size = max(size, _size(table, key, {"m": 1, "m2": 2, "m3": 3}[quantity.unit]))
    distance = math.hypot(*(0.0 if x == y else x - y for x, y in zip(a, b, strict=True)))
    return distance <= tolerance * size + ROUNDING


def _guessed(key: Key, value: object) -> Comparison:
    """Return how a word of a format is compared; its name says whether it is a pose."""
    if key.quantity.endswith(" pose"):
        return "pose"
    return "vector" if isinstance(value, tuple) else "number"


def _items(value: Value) -> tuple[object, ...]:
    return value if isinstance(value, tuple) else (value,)


def _numbers(value: Value) -> tuple[float, ...] | None:
    """None where one of them is no number."""
    try:
        return tuple(float(item) for item in _items(value))  # type: ignore[arg-type] # refused below
    except (TypeError, ValueError):
        return None


def _same_pose(
    a: tuple[float, ...], b: tuple[float, ...], tolerance: float, turn: float, shape: Value
) -> bool:
    """a, b: not the same numbers; turn: tolerance of the rotation, rad; shape: what stands there,
    a sphere the same however it is turned, a capsule or cylinder about its axis and end for end."""
    if len(a) != 7 or not all(map(math.isfinite, (*a, *b))):
        return False
    reach = max(1.0, *map(abs, a[:3]))
    if not math.dist(a[:3], b[:3]) <= tolerance * reach + ROUNDING:
        return False
    if not (any(a[3:]) and any(b[3:])):
        return a[3:] == b[3:]
    turns = [rotation_of(normalised_quat(q[3:])) for q in (a, b)]  # type: ignore[arg-type] # four numbers
    if shape == "sphere":
        return True
    if shape in ("capsule", "cylinder"):
        sine = np.cross(turns[0][:, 2], turns[1][:, 2])
        return bool(float(np.abs(sine).max()) <= turn)
    return bool(float(np.abs(turns[0] - turns[1]).max()) <= turn)


def _size(table: Table, key: Key, power: int) -> float:
    """What rounding the corners of a mesh is relative to, m to some power.

    size: root mean square distance of the corners from the body's origin; reach: the same from the
    origin of the file, of which only the least is known. Rounding moves corners by a share of the
    reach, which changes their moments by the size times that, the area by the length of all edges
    (of even triangles) times that, and the volume by the area times that: much for many small
    triangles far out. Slivers are as long as the mesh, its spread about its mean corner, and what
    rounding adds to some of them it takes from others.
    """
    moments, mean, area, count = (
        _numbers(table.facts.get(Key(key.kind, key.name, quantity)))
        for quantity in ("corner moments", "mean corner", "area", "triangles")
    )
    if moments is None or mean is None or area is None or count is None:
        return 0.0
    size = math.sqrt(sum(moments[:3]))
    reach = max(size, LEAST_REACH_M)
    spread = math.sqrt(max(0.0, size**2 - math.fsum(x * x for x in mean)))
    slivers = math.sqrt(count[0]) * spread
    shares = {
        "area": max(math.sqrt(count[0] * area[0]), slivers),
        "volume": max(area[0], slivers * spread),
        "mean corner": 1.0,
        "corner moments": size,
    }
    return max(size**power, reach * shares.get(key.quantity, 0.0))


# --- findings -------------------------------------------------------------------------------


def equality_findings(
    mismatches: Sequence[Difference],
    form: str,
    subject: str,
    places: Mapping[tuple[str, str], str],
    model: str = "the robot",
) -> Iterator[Finding]:
    """One finding `equal.<form>.<quantity>` for each group.

    subject: what the file is called; model: what it is compared with.
    """
    for same in grouped(
        mismatches, lambda d: (d.what, d.key.kind, d.key.quantity, d.before, d.after)
    ).values():
        first, keys = same[0], [item.key for item in same]
        quantity = first.key.quantity.rsplit(":", 1)[-1] if first.what == "value" else first.what
        data: dict[str, Scalar | tuple[Scalar, ...]] = {}
        if first.what == "value":
            data = {"expected": plain_data(first.before), "found": plain_data(first.after)}
        if len(keys) > 1:
            data["subjects"] = tuple(key.subject for key in keys)
        text = f"{_sentence(first, subject, model)}{so_for(key.name for key in keys)}"
        where = places.get((first.key.kind, first.key.name), "")
        rule = EQUAL.named(f"{form}.{slug(quantity)}")
        yield rule(keys[0].subject, text, data=data, where=where)


def _sentence(one: Difference, subject: str, model: str) -> str:
    if one.what == "missing":
        return f"{subject} lacks it"
    if one.what == "extra":
        return f"{subject} has it, {model} does not"
    unit = one.quantity.unit if one.quantity else ""
    before, after = value_text(one.before, unit), value_text(one.after, unit)
    if before == after:
        before, after = value_text(one.before, unit, 17), value_text(one.after, unit, 17)
    return f"{one.key.quantity} is {after} in {subject}, {before} in {model}"


def so_for(names: Iterable[str]) -> str:
    """`; so for `b`, `c` and 2 more`, of names whose first is the subject."""
    others = list(names)[1:]
    return f"; so for {quoted(others, NAMED - 1, ' and {} more')}" if others else ""


def slug(text: str) -> str:
    """A quantity's name in a rule."""
    return "_".join(text.lower().replace("-", "_").split())


def value_text(value: Value, unit: str = "", digits: int = 6) -> str:
    """A value for people."""
    if value is None:
        return "not stated"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return f"`{value}`" if value else "none"
    unit = "" if " or " in unit or "," in unit else unit
    if isinstance(value, tuple):
        text = " ".join(_digits(v, digits) if isinstance(v, float) else str(v) for v in value)
        return f"({text})" + (f" {unit}" if unit else "")
    return _digits(value, digits) + (f" {unit}" if unit else "")


def _digits(value: float, digits: int) -> str:
    """Write at most so many; of 17 no more than distinguish it from all others."""
    return repr(value) if digits == 17 else f"{value:.{digits}g}"


def plain_data(value: Value) -> Scalar | tuple[Scalar, ...]:
    """Plain data; numbers that are not finite as text, which JSON has no other form of."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, tuple):
        return tuple(plain_data(v) for v in value)  # type: ignore[misc] # no tuple holds tuples
    return value
