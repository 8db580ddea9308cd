"""USD: what a layer states locates, flattened stages decide.

Stages are flattened as selected and in each variant, without instances: their prototypes are
numbered by chance.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdUtils

from assetbuild.facts.again.tree import (
    LONGEST,
    Node,
    NotParsedError,
    Row,
    groups,
    of_one_sign,
    same,
    tree_rows,
)

QUATERNIONS = (Gf.Quatd, Gf.Quatf, Gf.Quath)
SAID_ONLY = ("comment", "documentation")
"""Fields for people."""
PLAIN = {"custom", "default", "typeName", "variability"}
"""Fields of an attribute without time samples, connections and the like."""
UNITS = ("kilogramsPerUnit", "metersPerUnit", "upAxis")
_PLACE = re.compile(r":(\d+):\d+: (.*?)'?$")
"""Line and message at the end of an error of USD."""
Choice = tuple[str, str] | None
"""A variant set and its variant; None: as selected."""


def usd_rows(again: Path, there: Path, roots: tuple[str, ...]) -> list[Row]:
    """What two layers say differently, each in a folder with the same other layers.

    roots: the stages that they may be part of, by path from the layer's folder.
    """
    text = tree_rows(_tree(_opened(again)), _tree(_opened(there)))
    if not text:
        return []
    for root in roots:
        one, other = again.parent / root, there.parent / root
        for choice in (None, *_choices(one)):
            flat = tree_rows(_flattened(one, choice), _flattened(other, choice))
            if flat and len(groups(flat)) >= len(groups(text)):
                return _placed(text, there)
            if flat:
                return flat
    # Engines ask for a value by its type and take a default where the layer gives it another one;
    # Isaac Sim scales and turns a layer whose units are not those of the stage.
    retyped = [row for row in text if row.attribute.endswith(" typeName")]
    kept = [row for row in retyped if row.expected and row.found]
    return _placed([*kept, *(row for row in text if row.attribute in UNITS)], there)


def _placed(rows: list[Row], there: Path) -> list[Row]:
    """The same rows, each with its line if the layer is text."""
    lines = usda_lines(there.read_text("utf-8")) if there.suffix == ".usda" else {}
    placed_rows = []
    for row in rows:
        stated = re.split(r"[ \[]", row.attribute)[0]
        line = lines.get(f"{row.name}.{stated}") or lines.get(row.name, 0)
        placed_rows.append(replace(row, line=line))
    return placed_rows


def _opened(path: Path) -> Sdf.Layer:
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path))
    except Tf.ErrorException as error:
        raise _not_parsed(error) from None
    if layer is None:
        raise NotParsedError("not readable as USD")
    return layer


def _not_parsed(error: object) -> NotParsedError:
    """USD's own message and line, without the place in its sources."""
    text = " ".join(str(error).split())
    if match := _PLACE.search(text):
        return NotParsedError(match[2], int(match[1]))
    return NotParsedError(text[-LONGEST:])


# --- a layer as a tree ------------------------------------------------------------------------


def _tree(layer: Sdf.Layer, stage: Usd.Stage | None = None) -> Node:
    """Prims, variants and properties. stage: of a flattened layer, of which what a prim's schema
    says anyway is left out."""
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    parts: dict[Sdf.Path, dict[str, Node]] = {Sdf.Path.emptyPath: {}}
    for path in sorted(one for one in paths if not one.IsTargetPath()):
        spec, above = layer.GetObjectAtPath(path), parts.get(path.GetParentPath())
        keys = sorted(set(spec.ListInfoKeys()) - set(SAID_ONLY))
        fields = {key: _plain(_field(spec, key)) for key in keys}
        if above is None or (stage and _is_default(spec, fields, stage)):
            continue
        parts[path] = {field: value for field, value in fields.items() if field != "default"}
        is_property = path.IsPropertyPath()
        key = str(path.name) if is_property else str(path)
        default = fields["default"].value if "default" in fields else None
        subject = None if is_property else ("prim", str(path))
        above[key] = Node(default, parts[path], 0, subject)
    return Node(None, parts[Sdf.Path.emptyPath])


def _field(spec: Sdf.Spec, field: str) -> object:
    if field == "subLayerOffsets":  # a type that Python does not get
        return " ".join(map(repr, spec.layer.subLayerOffsets))
    return spec.GetInfo(field)


def _is_default(spec: Sdf.Spec, fields: dict[str, Node], stage: Usd.Stage) -> bool:
    """Whether a property says what its schema says anyway, and nothing besides."""
    if not isinstance(spec, Sdf.AttributeSpec) or fields.keys() - PLAIN:
        return False
    prim = stage.GetPrimAtPath(spec.path.GetPrimPath())
    fallback = prim.GetPrimDefinition().GetAttributeFallbackValue(spec.name) if prim else None
    if fallback is None:
        return False
    return "default" not in fields or same(_plain(fallback).value, fields["default"].value)


def _plain(value: object) -> Node:
    """Numbers as arrays of their own precision; quaternions w first, of one sign."""
    if isinstance(value, dict):
        return Node(None, {str(key): _plain(item) for key, item in value.items()})
    if isinstance(value, Sdf.AssetPath):
        return Node(str(value.path))
    if isinstance(value, QUATERNIONS):
        return Node(of_one_sign(np.array((value.real, *value.imaginary), _type_of(value))))
    if value is None or isinstance(value, bool | str | int | float):
        return Node(value)
    if type(value).__name__.endswith("Array"):
        return Node(np.array(value))
    try:
        return Node(np.array(value, dtype=_type_of(value)).ravel())
    except (TypeError, ValueError):
        return Node(str(value))


def _type_of(value: object) -> str:
    """The type of the numbers of a vector, a matrix or a quaternion."""
    return "float64" if type(value).__name__.endswith("d") else "float32"


# --- stages -----------------------------------------------------------------------------------


def _choices(root: Path) -> list[Choice]:
    """The variants of the robot's own prim."""
    stage = Usd.Stage.Open(str(root))
    prim = stage.GetDefaultPrim()
    if not prim:
        return []
    sets = prim.GetVariantSets()
    return [(n, one) for n in sets.GetNames() for one in sets.GetVariantSet(n).GetVariantNames()]


def _flattened(root: Path, choice: Choice) -> Node:
    """All of a stage as one layer; NotParsedError."""
    try:
        stage = Usd.Stage.Open(str(root))
        stage.SetEditTarget(stage.GetSessionLayer())
        if choice and stage.GetDefaultPrim():
            stage.GetDefaultPrim().GetVariantSet(choice[0]).SetVariantSelection(choice[1])
        instances = _without_instances(stage)
        flat = stage.Flatten(addSourceFileComment=False)
    except Tf.ErrorException as error:
        raise _not_parsed(error) from None
    UsdUtils.ModifyAssetPaths(flat, lambda path: str(path).replace(str(root.parent), ""))
    flat.customLayerData = {**flat.customLayerData, "instances": " ".join(instances)}
    return _tree(flat, Usd.Stage.Open(flat))


def _without_instances(stage: Usd.Stage) -> list[str]:
    """Makes every instance a prim of its own; returns which they were."""
    paths: list[str] = []
    while instances := [prim for prim in stage.Traverse() if prim.IsInstance()]:
        for prim in instances:
            paths.append(str(prim.GetPath()))
            prim.SetInstanceable(False)
    return sorted(paths)


# --- lines of a usda file ------------------------------------------------------------------------


_PRIM = re.compile(r'\s*(?:def|over|class)\s+(?:\w+\s+)?"([^"]+)"')
_SET = re.compile(r'\s*variantSet\s+"([^"]+)"\s*=\s*\{')
_VARIANT = re.compile(r'\s*"([^"]+)"\s*[({]')
_PROPERTY = re.compile(r"\s*(?:\w+ )*?(?:rel|[\w:]+(?:\[\])?) ([\w:]+)(?:\.\w+)?\s*(?:=|\(|$)")


def usda_lines(text: str) -> dict[str, int]:
    """Path of a prim or property -> its line, from 1. Of properties the first line that has it."""
    lines: dict[str, int] = {}
    stack: list[str] = [""]
    coming, in_metadata = "", False
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.strip()
        if in_metadata:
            in_metadata = not words.startswith(")")
            if in_metadata:
                continue
        elif named := _named(line, stack[-1]):
            coming = named
            lines.setdefault(coming, number)
            in_metadata = words.endswith("(")
        elif stated := _PROPERTY.match(line):
            lines.setdefault(f"{stack[-1]}.{stated[1]}", number)
        if words.endswith("{"):
            stack.append(coming or stack[-1])
            coming = ""
        elif words.startswith("}") and len(stack) > 1:
            stack.pop()
    return lines


def _named(line: str, here: str) -> str:
    """The path of the prim, variant set or variant that begins in a line; "" of others."""
    if prim := _PRIM.match(line):
        return f"{here}/{prim[1]}"
    if chosen := _SET.match(line):
        return f"{here}{{{chosen[1]}=}}"
    if here.endswith("=}") and (variant := _VARIANT.match(line)):
        return f"{here[:-1]}{variant[1]}}}"
    return ""
