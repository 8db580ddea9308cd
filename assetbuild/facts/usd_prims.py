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
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdPhysics

from assetbuild.errors import UsageError
from assetbuild.facts.table import Value, Writer
from assetbuild.robot.pose import IDENTITY, Array, Pose, Quat, normalised_quat, quat_of, vec3

PLAIN = frozenset(
    {"typeName", "custom", "variability", "documentation", "comment", "specifier", "apiSchemas"}
)
"""Metadata that is no fact; applied schemas are asked for one by one."""
RIGID = 1e-9
"""Scales nearer to 1 than this are rounding."""
QUATERNIONS = (Gf.Quatd, Gf.Quatf, Gf.Quath)
LENGTH = 1e-3
"""A quaternion as long as this from 1 is not one that was rounded."""
UNLIMITED = 1e30
"""PhysX takes numbers beyond for infinite."""


@dataclass(frozen=True)
class Units:
    """What one unit of the stage is: metre, kilogram; angles are degrees."""

    metre: float = 1.0
    kilogram: float = 1.0

    def length(self, angular: bool) -> float:
        """Of a coordinate: rad or m in one of USD's units."""
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
            if not isinstance(prop, Usd.Attribute):
                continue
            spec, kind = known.GetSchemaAttributeSpec(name), str(prop.GetTypeName())
            wanted = str(spec.typeName) if spec else ""
            if name.startswith("xformOp:"):
                wanted = "double" if kind.rstrip("23df4h") in ("float", "half") else ""
                wanted = "quatd" if kind in ("quatf", "quath") else wanted
            elif not spec and kind in ("double", "half", "int64"):
                wanted = "float"
            if wanted and wanted != kind:
                said = f"{kind}, where {wanted} is meant"
                self.book.put("prim", self.path, {f"usd:type of {name}": said})

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
        """The value of an attribute; None where none stands there, or its schema is not applied."""
        if schema and not self.has(schema):
            return None
        found = self.left.get(name)
        if not isinstance(found, Usd.Attribute):
            return None
        del self.left[name]
        if found.GetNumTimeSamples() > 0:
            self.book.skip(self.path, f"{name} over time", found.GetTimeSamples())
        if found.HasAuthoredConnections() and name not in self.connected:
            self.book.skip(self.path, f"{name}.connect", found.GetConnections())
        return found.Get() if found.HasAuthoredValue() else None

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
            # USD turns by the angle of its real part alone, other runtimes make it a unit first.
            if isinstance(value, QUATERNIONS) and abs(value.GetLength() - 1.0) > LENGTH:
                self.book.put("prim", self.path, {f"usd:length of {name}": value.GetLength()})
        for name in ("visibility", "purpose"):  # both are inherited: see the shapes
            self.take(name)

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
        for schema in self.schemas:
            self.book.skip(self.path, "apiSchemas", schema)
        for key, value in self.metadata.items():
            self.book.skip(self.path, key, value)
        for (name, key), value in self.notes.items():
            self.book.skip(self.path, f"{name} ({key})", value)


# --- the stage -------------------------------------------------------------------------------


@contextmanager
def opened(path: Path) -> Iterator[Usd.Stage]:
    """The stage with its default variants; UsageError where USD cannot make sense of it."""
    try:
        stage = Usd.Stage.Open(str(path))
        if not stage.GetDefaultPrim():
            raise UsageError(
                f"`{path}` has no default prim, so nothing says which of its prims is the robot",
                hint="set `defaultPrim` in it",
            )
        yield stage
    except Tf.ErrorException as error:
        raise UsageError(f"`{path}` is not readable as USD: {error}") from None


def units_of(stage: Usd.Stage) -> Units:
    """Units of a stage; UsageError where one is not positive."""
    units = Units(UsdGeom.GetStageMetersPerUnit(stage), UsdPhysics.GetStageKilogramsPerUnit(stage))
    if not (units.metre > 0.0 and units.kilogram > 0.0):
        raise UsageError(
            f"its units are {units.metre:g} m and {units.kilogram:g} kg",
            hint="`metersPerUnit` and `kilogramsPerUnit` must be positive",
        )
    return units


_LAYER = frozenset({"subLayers", "subLayerOffsets", "documentation", "comment"})
"""No facts: what they compose is compared."""


def stage_facts(stage: Usd.Stage, units: Units, book: Writer) -> None:
    """Units, up axis and metadata of the stage, and of every layer that it is made of.

    Runtimes scale and turn a layer whose units differ from the stage's.
    """
    book.put("robot", "", {
        "up axis": str(UsdGeom.GetStageUpAxis(stage)),
        "metres per unit": units.metre,
        "kilograms per unit": units.kilogram,
    })  # fmt: skip
    book.put("stage", "", {"usd:defaultPrim": str(stage.GetDefaultPrim().GetName())})
    own: dict[str, list[Value]] = {}
    for layer in stage.GetUsedLayers():
        root = layer.pseudoRoot
        fields = [key for key in root.ListInfoKeys() if key not in _LAYER]
        if layer.anonymous and not fields:
            continue
        for key in fields:
            if key in ("upAxis", "metersPerUnit", "kilogramsPerUnit"):
                value = root.GetInfo(key)
                own.setdefault(key, []).append(value if isinstance(value, float) else str(value))
            elif key == "defaultPrim":
                if not layer.GetPrimAtPath(f"/{layer.defaultPrim}"):
                    book.skip(layer.GetDisplayName(), key, layer.defaultPrim)
            else:
                book.skip(layer.GetDisplayName(), key, root.GetInfo(key))
    for key, values in own.items():
        differing = tuple(sorted({str(value) for value in values}))
        book.put("stage", "", {f"usd:{key} of layers": differing})


def variant_facts(prim: Usd.Prim, book: Writer) -> None:
    """Variant sets with their selections, and what the variants say that are not selected."""
    sets = prim.GetVariantSets()
    for name in sets.GetNames():
        chosen = sets.GetVariantSelection(name)
        book.put("stage", "", {
            f"usd:variants of {name}": tuple(sorted(sets.GetVariantSet(name).GetVariantNames())),
            f"usd:selected {name}": chosen,
        })  # fmt: skip
        for spec in prim.GetPrimStack():
            found = spec.variantSets[name].variants if name in spec.variantSets else {}
            for variant in found.keys():  # noqa: SIM118 # a proxy of USD, not a dictionary
                if variant != chosen:
                    said = " ".join(_said_by(found[variant].primSpec))
                    book.put("stage", "", {f"usd:variant {name}={variant}": said})


def _said_by(spec: Sdf.PrimSpec) -> Iterator[str]:
    """What a variant adds: its metadata, properties and children by name."""
    for key in spec.ListInfoKeys():
        if key not in PLAIN:
            yield str(key)
    yield from (str(found.name) for found in spec.properties)
    yield from (str(found.name) for found in spec.nameChildren)


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
    """Of `localPos` and `localRot`; what is not stated is the origin."""
    xyz = (0.0, 0.0, 0.0) if position is None else vec3(np.array(position) * scale)
    return Pose(xyz, quat_of_gf(turn))


def quat_of_gf(turn: object) -> Quat:
    """Of a Gf.Quat; PhysX takes one without length for none at all."""
    if not isinstance(turn, Gf.Quatf | Gf.Quatd):
        return IDENTITY.quat
    w, (x, y, z) = float(turn.GetReal()), map(float, turn.GetImaginary())
    return normalised_quat((w, x, y, z)) if any((w, x, y, z)) else IDENTITY.quat
