"""Prims of a stage: their values in SI units, and where they are."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from pxr import Gf, Tf, Usd, UsdGeom, UsdPhysics

from assetbuild.errors import UsageError
from assetbuild.facts.table import Table, Value, plain_value
from assetbuild.robot.pose import IDENTITY, Array, Pose, Quat, normalised_quat, quat_of, vec3

RIGID = 1e-9
"""Scales nearer to 1 than this are rounding."""
AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
UNLIMITED = 1e30
"""PhysX takes numbers beyond for infinite."""


@dataclass(frozen=True)
class Units:
    """What one unit of the stage is: metre, kilogram; angles are degrees."""

    metre: float = 1.0
    kilogram: float = 1.0

    def length(self, angular: bool) -> float:
        """Return how many rad or m one of USD's units of a coordinate is."""
        return math.pi / 180.0 if angular else self.metre

    def effort(self, angular: bool) -> float:
        """N m or N."""
        return self.kilogram * self.metre * (self.metre if angular else 1.0)

    def gain(self, angular: bool) -> float:
        """Effort for a coordinate: N m/rad or N/m; also with a second."""
        return self.effort(angular) / self.length(angular)

    def inertia(self, angular: bool) -> float:
        """kg m2 or kg."""
        return self.kilogram * (self.metre**2 if angular else 1.0)


ENGINES = ("physics", "physx", "newton", "mjc", "drive", "limit", "state")
"""How the names of attributes that engines simulate by begin."""


class Prim:
    """One prim, asked for what it states itself; a schema's own default counts as not stated."""

    asked: ClassVar[set[tuple[str, str]]] = set()
    """Path and name of every attribute of this stage that somebody has asked for."""

    def __init__(self, prim: Usd.Prim) -> None:
        self.prim, self.path = prim, str(prim.GetPath())
        self.applied = frozenset(prim.GetPrimTypeInfo().GetAppliedAPISchemas())

    @property
    def type(self) -> str:
        """Name of its schema; empty of a prim without one."""
        return str(self.prim.GetTypeName())

    @property
    def name(self) -> str:
        """What the robot calls it: its displayName, else its own name."""
        return str(self.prim.GetMetadata("displayName") or self.prim.GetName())

    def named(self, kind: str, facts: Table) -> str:
        """Its name, with its path where two of a kind share one; notes where it stands."""
        name = self.name
        if facts.places.get((kind, name), self.path) != self.path:
            name = f"{name} ({self.path})"
        facts.place(kind, name, self.path)
        return name

    def has(self, schema: str) -> bool:
        """Whether a schema is applied to it."""
        return schema in self.applied

    def value(self, name: str, schema: str = "") -> object:
        """The value of an attribute; None where none is stated, or its schema is not applied."""
        self.asked.add((self.path, name))
        attribute = self.prim.GetAttribute(name)
        if (schema and not self.has(schema)) or not attribute.HasAuthoredValue():
            return None
        return attribute.Get()

    def number(self, name: str, schema: str = "", unit: float = 1.0) -> float | None:
        """A number in SI units; None where it is unlimited or not stated."""
        value = self.value(name, schema)
        if not isinstance(value, int | float):
            return None if value is None else math.nan
        return None if abs(value) > UNLIMITED else float(value) * unit

    def numbers(self, name: str, schema: str = "", unit: float = 1.0) -> tuple[float, ...] | None:
        """Numbers of a vector or an array in SI units; None where none are stated."""
        value = self.value(name, schema)
        if value is None:
            return None
        flat: Array = np.ravel(np.asarray(value, dtype=np.float64)) * unit
        return tuple(flat.tolist())

    def text(self, name: str, schema: str = "") -> str | None:
        """A token or text."""
        value = self.value(name, schema)
        return None if value is None else str(value)

    def flag(self, name: str, schema: str = "") -> bool | None:
        """A truth value."""
        value = self.value(name, schema)
        return None if value is None else bool(value)

    def targets(self, name: str, schema: str = "") -> tuple[str, ...]:
        """Paths that a relationship points at."""
        if schema and not self.has(schema):
            return ()
        return tuple(str(path) for path in self.prim.GetRelationship(name).GetTargets())

    def words(self) -> dict[str, Value]:
        """All that it states for engines and nobody has asked for, in the file's own units."""
        words: dict[str, Value] = {}
        schema = self.prim.GetPrimDefinition()
        for stated in self.prim.GetAuthoredAttributes():
            name, value = stated.GetName(), stated.Get()
            is_read = (self.path, name) in self.asked
            is_default = value == schema.GetAttributeFallbackValue(name)
            if name.startswith(ENGINES) and not (is_read or is_default) and self._acts(name):
                if isinstance(value, float) and abs(value) > UNLIMITED:
                    value = None
                is_plain = isinstance(value, str) or not hasattr(value, "__iter__")
                words[f"usd:{name}"] = plain_value(value if is_plain else list(value))
        return words

    def _acts(self, name: str) -> bool:
        """Whether the schema of an attribute is applied, such as `PhysxJointAxisAPI:angular`."""
        engine, *parts = name.split(":")
        if engine in ("newton", "mjc"):
            return any(schema.lower().startswith(engine) for schema in self.applied)
        schema = f"{engine[0].upper()}{engine[1:]}API"
        return not engine.startswith("physx") or bool(
            {schema, f"{schema}:{parts[0]}"} & self.applied
        )


# --- poses


class Places:
    """Where prims are, in metres."""

    def __init__(self, units: Units) -> None:
        self.cache, self.units = UsdGeom.XformCache(), units

    def world(self, prim: Usd.Prim) -> Array:
        """(4, 4) X_world_prim; columns are axes, with the scale of the prim."""
        matrix = np.array(self.cache.GetLocalToWorldTransform(prim), dtype=np.float64).T
        matrix[:3, 3] *= self.units.metre
        return matrix

    def rigid(self, prim: Usd.Prim) -> tuple[Pose, Array]:
        """(X_world_prim without scale, scale along its axes)."""
        return rigid(self.world(prim))


def rigid(matrix: Array) -> tuple[Pose, Array]:
    """(pose, scale along its axes; a mirrored frame has a negative x) of a (4, 4) transform."""
    axes = matrix[:3, :3]
    scale = np.linalg.norm(axes, axis=0)
    if np.linalg.det(axes) < 0.0:
        scale[0] = -scale[0]
    scale = np.where(np.abs(np.abs(scale) - 1.0) < RIGID, np.sign(scale), scale)
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = axes / scale
    if not np.isfinite(turn).all():
        return Pose(vec3(matrix[:3, 3]), IDENTITY.quat), scale
    return Pose(vec3(matrix[:3, 3]), quat_of(turn)), scale


def pose_of(position: object, turn: object, scale: Array) -> Pose:
    """Return the pose that `localPos` and `localRot` state; the origin where they state nothing."""
    xyz = (0.0, 0.0, 0.0) if position is None else vec3(np.array(position) * scale)
    return Pose(xyz, quat_of_gf(turn))


def quat_of_gf(turn: object) -> Quat:
    """Return a Gf.Quat as (w, x, y, z); PhysX ignores a quaternion of length zero."""
    if not isinstance(turn, Gf.Quatf | Gf.Quatd):
        return IDENTITY.quat
    w, (x, y, z) = float(turn.GetReal()), map(float, turn.GetImaginary())
    return normalised_quat((w, x, y, z)) if any((w, x, y, z)) else IDENTITY.quat


# --- stages --------------------------------------------------------------------------------------


@contextmanager
def opened(path: Path) -> Iterator[Usd.Stage]:
    """The stage with its default variants; UsageError where USD cannot make sense of it."""
    try:
        stage = Usd.Stage.Open(str(path))
        broken = [" ".join(str(error).split()) for error in stage.GetCompositionErrors()]
        if not stage.GetDefaultPrim():
            broken.append("it has no default prim, which says which of the prims is the robot")
        if broken:
            raise UsageError(broken[0].replace(f"{path.parent}/", ""))
        yield stage
    except Tf.ErrorException as error:
        raise UsageError(f"`{path}` is not readable as USD: {error}") from None


def units_of(stage: Usd.Stage, facts: Table) -> Units:
    """Units of a stage, noted with its up axis; UsageError where one is not positive."""
    units = Units(UsdGeom.GetStageMetersPerUnit(stage), UsdPhysics.GetStageKilogramsPerUnit(stage))
    if not (units.metre > 0.0 and units.kilogram > 0.0):
        raise UsageError(
            f"its units are {units.metre:g} m and {units.kilogram:g} kg",
            hint="`metersPerUnit` and `kilogramsPerUnit` must be positive",
        )
    facts.put("robot", "", {
        "up axis": str(UsdGeom.GetStageUpAxis(stage)),
        "metres per unit": units.metre,
        "kilograms per unit": units.kilogram,
    })  # fmt: skip
    return units
