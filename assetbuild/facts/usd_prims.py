"""Prims read to the last attribute: what nobody asked for is left over, and reported.

A `Prim` hands out each authored property, applied schema and piece of metadata once; `close` notes
the rest as unread. No fact are:

- the type of a value, whether it is uniform, varying or custom: its value is compared;
- comments and documentation: text for people;
- an attribute that states its schema's own default: its absence means the same;
- a relationship without targets, an attribute that is declared without a value.

An attribute of a schema that is not applied has no meaning for any runtime: it is left over.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from assetbuild.facts.table import Key, Value, Writer
from assetbuild.facts.usd_inventory import prim_facts
from assetbuild.robot.pose import IDENTITY, Array, Pose, Quat, normalised_quat, quat_of, vec3

PLAIN = frozenset(
    {"typeName", "custom", "variability", "documentation", "comment", "specifier", "apiSchemas"}
)
"""Metadata that is no fact; applied schemas are asked for one by one."""
RIGID = 1e-9
"""Scales nearer to 1 than this are rounding."""
QUATERNIONS = (Gf.Quatd, Gf.Quatf, Gf.Quath)
LENGTH = 1e-6
"""A quaternion whose length differs from 1 by more was not rounded to float32: USD turns by the
angle of its real part alone, other runtimes make it a unit first."""
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


class Prim:
    """One prim and what of it has not been read yet."""

    def __init__(self, prim: Usd.Prim, book: Writer) -> None:
        self.prim, self.book, self.path = prim, book, str(prim.GetPath())
        self.left = {p.GetName(): p for p in prim.GetAuthoredProperties()}
        self.schemas = list(prim.GetPrimTypeInfo().GetAppliedAPISchemas())
        self.applied = frozenset(self.schemas)
        self.connected: set[str] = set()
        self.metadata = {k: v for k, v in prim.GetAllAuthoredMetadata().items() if k not in PLAIN}
        self.notes = {
            (name, key): value
            for name, prop in self.left.items()
            for key, value in prop.GetAllAuthoredMetadata().items()
            if key not in PLAIN
        }

        self._declarations()

    def _declarations(self) -> None:
        """Words for properties that are declared otherwise than their schema does.

        A runtime that asks for a float finds nothing in a double of the same name. Of a schema
        that USD does not know, numbers are single precision; places are double.
        """
        known = self.prim.GetPrimDefinition()
        for name, prop in self.left.items():
            if prop.IsCustom():
                self.book.put("prim", self.path, {f"usd:{name} is custom": True})
            spec = known.GetSchemaPropertySpec(name)
            uniform = spec.variability == Sdf.VariabilityUniform if spec else is_uniform(prop)
            meant = "uniform" if uniform else "varying"
            for stated in prop.GetPropertyStack():  # what composes is the schema's declaration
                varies = str(stated.variability).removeprefix("Sdf.Variability").lower()
                self._declared(f"variability of {name}", varies, meant)
                if isinstance(prop, Usd.Attribute):
                    kind = str(stated.GetInfo("typeName"))
                    wanted = str(spec.typeName) if spec else type_meant(name, kind)
                    self._declared(f"type of {name}", kind, wanted)

    def _declared(self, word: str, said: str, meant: str) -> None:
        if said != meant:
            self.book.put("prim", self.path, {f"usd:{word}": f"{said}, where {meant} is meant"})

    @property
    def type(self) -> str:
        """Name of its schema; empty of a prim without one."""
        return str(self.prim.GetTypeName())

    @property
    def name(self) -> str:
        """What the robot calls it: its displayName, else its own name."""
        return str(self.prim.GetMetadata("displayName") or self.prim.GetName())

    def named(self, kind: str) -> str:
        """Its name; notes where it stands, and its identifier where that is another."""
        shown, name = self.metadata.pop("displayName", None), self.name
        if self.book.places.get((kind, name), self.path) != self.path:
            name = f"{name} ({self.path})"  # two of one name
        self.book.place(kind, name, self.path)
        if shown is not None:
            self.book.put(kind, name, {"usd:identifier": str(self.prim.GetName())})
        return name

    def has(self, schema: str) -> bool:
        """Whether it has an applied schema, which is read by this."""
        if schema in self.schemas:
            self.schemas.remove(schema)
        return schema in self.applied

    def take(self, name: str, schema: str = "") -> object:
        """The value of an attribute; None where none stands there, or its schema is not applied.

        Of a schema that USD does not know a runtime has values of its own, which may be any.
        """
        if schema and not self.has(schema):
            return None
        found = self.left.get(name)
        has_value = isinstance(found, Usd.Attribute) and found.HasAuthoredValue()
        known = self.prim.GetPrimDefinition().GetSchemaPropertySpec(name)
        if schema and not has_value and not known:
            self.book.put("prim", self.path, {f"usd:{name}": "not stated"})
        if not isinstance(found, Usd.Attribute):
            return None
        del self.left[name]
        if found.GetNumTimeSamples() > 0:
            self.book.skip(self.path, f"{name} over time", found.GetTimeSamples())
        if found.HasAuthoredConnections() and name not in self.connected:
            self.book.skip(self.path, f"{name}.connect", found.GetConnections())
        return found.Get() if has_value else None

    def number(self, name: str, schema: str = "", unit: float = 1.0) -> float | None:
        """A number in SI units; None where it is unlimited or not stated."""
        value = self.take(name, schema)
        if not isinstance(value, int | float):
            return None if value is None else math.nan
        return None if abs(value) > UNLIMITED else float(value) * unit

    def text(self, name: str, schema: str = "") -> str | None:
        """A token or text."""
        value = self.take(name, schema)
        return None if value is None else str(value)

    def flag(self, name: str, schema: str = "") -> bool | None:
        """A truth value."""
        value = self.take(name, schema)
        return None if value is None else bool(value)

    def targets(self, name: str, schema: str = "") -> tuple[str, ...]:
        """Paths that a relationship points at."""
        if schema and not self.has(schema):
            return ()
        found = self.left.get(name)
        if not isinstance(found, Usd.Relationship):
            return ()
        del self.left[name]
        return tuple(str(path) for path in found.GetTargets())

    def source(self, name: str) -> str:
        """Which output of which shader feeds an attribute: `UsdUVTexture rgb`; empty: none."""
        attribute = self.left.get(name)
        if not isinstance(attribute, Usd.Attribute) or not attribute.HasAuthoredConnections():
            return ""
        self.connected.add(name)
        found = []
        for path in attribute.GetConnections():
            shader = self.prim.GetStage().GetPrimAtPath(path.GetPrimPath())
            kind = shader.GetAttribute("info:id").Get() if shader else None
            found.append(f"{kind or path.GetPrimPath()} {path.name.removeprefix('outputs:')}")
        return ", ".join(found)

    def note(self, name: str, key: str) -> str | None:
        """Metadata of a property, such as its interpolation."""
        value = self.notes.pop((name, key), None)
        return None if value is None else str(value)

    def words(self, kind: str, name: str, rows: dict[str, tuple[str, float]], schema: str) -> None:
        """Numbers of a schema as words of the format; rows: attribute -> (word, unit)."""
        for attribute, (word, unit) in rows.items():
            value = self.number(attribute, schema, unit)
            if value is not None:
                self.book.put(kind, name, {f"usd:{word}": value})

    def placed(self) -> None:
        """Takes what the transform of the prim says, which its pose holds."""
        taken: Any = self.take("xformOpOrder")  # Any: an array of tokens
        order = [str(op) for op in taken or ()]
        ops = [f"xformOp:{op}" for op in ("translate", "orient", "scale")]
        stated = [op for op in ops if op in self.left]
        if order != stated and set(order) <= set(ops):
            self.book.put("prim", self.path, {"usd:xformOpOrder": " ".join(order)})
        for op in order:
            name = op.removeprefix("!invert!")
            value = self.take(name)
            if value is None:
                self.book.put("prim", self.path, {f"usd:{name}": "no value"})
            self.turned(name, value)
        for name in ("visibility", "purpose"):  # both are inherited: see the shapes
            self.take(name)

    def turned(self, name: str, value: object) -> object:
        """The value of an attribute; a word where it is a quaternion of another length than 1."""
        if isinstance(value, QUATERNIONS) and abs(value.GetLength() - 1.0) > LENGTH:
            self.book.put("prim", self.path, {f"usd:length of {name}": value.GetLength()})
        return value

    def close(self) -> None:
        """Notes all that is left as unread."""
        defaults = self.prim.GetPrimDefinition()
        for name, found in self.left.items():
            if isinstance(found, Usd.Relationship):
                said = [str(path) for path in found.GetTargets()]
                if said:
                    self.book.skip(self.path, name, said)
                continue
            value = found.Get()
            default = defaults.GetAttributeFallbackValue(name)
            if found.HasAuthoredConnections() and name not in self.connected:
                self.book.skip(self.path, f"{name}.connect", found.GetConnections())
            elif value is not None and (default is None or value != default):
                self.book.skip(self.path, name, value)
        for key, value in self.metadata.items():
            self.book.skip(self.path, key, value)
        for (name, key), value in self.notes.items():
            self.book.skip(self.path, f"{name} ({key})", value)


def is_uniform(prop: Usd.Property) -> bool:
    """Whether a property that no schema of USD has may not vary over time."""
    name = prop.GetName()
    return isinstance(prop, Usd.Relationship) or name == "xformOpOrder" or name.startswith("mjc:")


def type_meant(name: str, kind: str) -> str:
    """The type of an attribute that no schema of USD has, declared as `kind`.

    Numbers of simulators are single precision, MuJoCo's and places double. A type without a name
    in USD has no value.
    """
    if name.startswith(("inputs:", "outputs:")):
        return kind  # of a shader, whose kind says what it must be
    if not Sdf.ValueTypeNames.Find(kind):
        return "a type of USD"
    if name.startswith("mjc:"):
        return re.sub("^(float|half)", "double", kind)
    if name.startswith("xformOp:"):
        if kind in ("quatf", "quath"):
            return "quatd"
        return re.sub("^(float|half)", "double", kind)
    return "float" if kind in ("double", "half", "int64") else kind


def acts(prim: Usd.Prim) -> bool:
    """Whether a runtime sees it: active, defined and loaded."""
    return bool(prim.IsActive() and prim.IsDefined() and prim.IsLoaded() and not prim.IsAbstract())


def listed(prim: Usd.Prim) -> Iterator[tuple[Key, Value]]:
    """The facts of the inventory: its type and applied schemas, or why it does not act."""
    path, kind = str(prim.GetPath()), str(prim.GetTypeName())
    if not acts(prim):
        state = "inactive" if not prim.IsActive() else "not defined"
        kind = f"{kind} {state}".strip()
    yield from prim_facts(path, kind, prim.GetPrimTypeInfo().GetAppliedAPISchemas())


# --- poses -----------------------------------------------------------------------------------


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
