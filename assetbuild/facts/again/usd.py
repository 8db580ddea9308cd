"""USD: fields of a layer by Sdf path locate, flattened stages decide.

Stages are flattened as selected and in each variant, without instances: their prototypes are
numbered by chance.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdUtils

from assetbuild.facts.again.row import LONGEST, NotParsedError, Row, groups
from assetbuild.facts.again.usda_lines import usda_lines
from assetbuild.facts.table import Value

QUATERNIONS = (Gf.Quatd, Gf.Quatf, Gf.Quath)
SAID_ONLY = ("comment", "documentation")
"""Fields for people."""
DOUBLE, SINGLE, ZERO = 1e-9, 2e-7, 1e-14
"""Relative tolerances of numbers and of what is stored in half the bytes; absolute beside zero."""


def usd_rows(again: Path, there: Path, roots: tuple[str, ...]) -> list[Row]:
    """What two layers say differently, each in a folder with the same other layers.

    roots: the stages that they may be part of, by path from the layer's folder.
    """
    text = list(_layer_rows(_opened(again), _opened(there)))
    lines = usda_lines(there.read_text("utf-8")) if there.suffix == ".usda" else {}
    text = [_placed(row, lines) for row in text]
    if not text:
        return []
    flat: list[Row] = []
    for root in roots:
        one, other = again.parent / root, there.parent / root
        flat += _stage_rows(one, other)
        if flat:
            break
    return flat if len(groups(flat)) < len(groups(text)) else text


def _placed(row: Row, lines: dict[str, int]) -> Row:
    path = row.name
    line = lines.get(f"{path}.{row.attribute.partition(' ')[0]}") or lines.get(path, 0)
    return Row(row.kind, row.name, row.attribute, row.expected, row.found, line)


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
    if found := _PLACE.search(text):
        return NotParsedError(found[2], int(found[1]))
    return NotParsedError(text[-LONGEST:])


_PLACE = re.compile(r":(\d+):\d+: (.*?)'?$")


# --- one layer --------------------------------------------------------------------------------


def _layer_rows(again: Sdf.Layer, there: Sdf.Layer) -> Iterator[Row]:
    ours, theirs = _paths(again), _paths(there)
    alone: list[Sdf.Path] = []
    for path in dict.fromkeys((*ours, *theirs)):
        if any(path.HasPrefix(known) for known in alone):
            continue
        if path in ours and path in theirs:
            yield from _spec_rows(path, again, there)
        else:
            alone.append(path)
            yield _one_sided(path, again if path in ours else there, gone=path in ours)


def _paths(layer: Sdf.Layer) -> dict[Sdf.Path, None]:
    found: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, found.append)
    kept = [path for path in found if not path.IsTargetPath()]
    return dict.fromkeys(sorted(kept))


def _one_sided(path: Sdf.Path, layer: Sdf.Layer, *, gone: bool) -> Row:
    """A prim or a property that only one layer has."""
    spec = layer.GetObjectAtPath(path)
    stated = _shown(spec.default) if isinstance(spec, Sdf.AttributeSpec) else str(path.name)
    what = "missing" if gone else "extra"
    attribute = f"{path.name} {what}" if path.IsPropertyPath() else what
    return _row(path, attribute, stated if gone else None, None if gone else stated)


def _spec_rows(path: Sdf.Path, again: Sdf.Layer, there: Sdf.Layer) -> Iterator[Row]:
    one, other = again.GetObjectAtPath(path), there.GetObjectAtPath(path)
    for field in dict.fromkeys((*one.ListInfoKeys(), *other.ListInfoKeys())):
        if field in SAID_ONLY:
            continue
        a, b = _info(one, field), _info(other, field)
        if not _same(a, b):
            own = field if field != "default" else ""
            label = f"{path.name} {own}".strip() if path.IsPropertyPath() else field
            yield _first(path, label, a, b)


def _info(spec: Sdf.Spec, field: str) -> object:
    """A field of a spec, None where it is not stated."""
    if field not in spec.ListInfoKeys():
        return None
    if field == "subLayerOffsets":  # a type that Python does not get
        return " ".join(map(repr, spec.layer.subLayerOffsets))
    return spec.GetInfo(field)


def _first(path: Sdf.Path, label: str, a: object, b: object) -> Row:
    """Two long arrays by the first item that differs, two dictionaries by the first such key."""
    if isinstance(a, dict) and isinstance(b, dict):
        key = next(k for k in (*a, *b) if not _same(a.get(k), b.get(k)))
        return _first(path, f"{label} {key}", a.get(key), b.get(key))
    one, other = _array(a), _array(b)
    if one is not None and other is not None and len(one) != len(other):
        return _row(path, f"{label} length", float(len(one)), float(len(other)))
    if one is not None and other is not None and len(one) > 1:
        index = next(i for i in range(len(one)) if not _same(a[i], b[i]))  # type: ignore[index] # arrays
        return _row(path, f"{label}[{index}]", _shown(a[index]), _shown(b[index]))  # type: ignore[index] # arrays
    return _row(path, label, _shown(a), _shown(b))


def _row(path: Sdf.Path, attribute: str, expected: Value, found: Value) -> Row:
    return Row("prim", str(path.GetPrimOrPrimVariantSelectionPath()), attribute, expected, found)


# --- values -----------------------------------------------------------------------------------


def _array(value: object) -> Any:  # Any: a numpy array
    """The items of an array of USD; None of anything else."""
    return np.array(value) if type(value).__name__.endswith("Array") else None


def _numbers(value: object) -> tuple[float, ...] | None:
    """The components of a number, a vector, a matrix or a quaternion (w first)."""
    if isinstance(value, bool | str):
        return None
    if isinstance(value, int | float):
        return (float(value),)
    if isinstance(value, QUATERNIONS):
        return (float(value.real), *map(float, value.imaginary))
    try:
        flat = np.array(value, dtype=float).ravel()
    except (TypeError, ValueError):
        return None
    return tuple(flat.tolist()) if flat.size else None


def _same(a: object, b: object) -> bool:
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    if type(a) is not type(b):
        return False
    one, other = _array(a), _array(b)
    if one is not None and other is not None:
        if one.shape != other.shape or one.dtype.kind != "f":
            return bool(np.array_equal(one, other))
        tolerance = SINGLE if one.dtype.itemsize < 8 else DOUBLE
        return bool(np.allclose(one, other, rtol=tolerance, atol=ZERO, equal_nan=True))
    if isinstance(a, Sdf.AssetPath) and isinstance(b, Sdf.AssetPath):
        return str(a.path) == str(b.path)
    numbers, others = _numbers(a), _numbers(b)
    if numbers is None or others is None or len(numbers) != len(others):
        return a == b
    tolerance = DOUBLE if _is_double(a) else SINGLE
    signs = (1.0, -1.0) if isinstance(a, QUATERNIONS) else (1.0,)
    turned = [np.multiply(sign, others) for sign in signs]
    return any(np.allclose(numbers, o, rtol=tolerance, atol=ZERO, equal_nan=True) for o in turned)


def _is_double(value: object) -> bool:
    return isinstance(value, int | float) or type(value).__name__.endswith("d")


def _shown(value: object) -> Value:
    if isinstance(value, bool) or value is None:
        return value
    if isinstance(value, Sdf.AssetPath):
        return str(value.path)
    numbers = None if isinstance(value, str) else _numbers(value)
    if numbers is None:
        return " ".join(str(value).split())[:LONGEST]
    return numbers[0] if len(numbers) == 1 else numbers[:16]


# --- stages -----------------------------------------------------------------------------------


def _stage_rows(again: Path, there: Path) -> list[Row]:
    """What two stages say differently, as selected, else in the first variant that differs."""
    for choice in (None, *_choices(again)):
        ours, theirs = _flattened(again, choice), _flattened(there, choice)
        rows = [row for row in _layer_rows(ours[0], theirs[0]) if not _is_default(row, theirs[1])]
        if rows:
            return rows
    return []


def _choices(root: Path) -> list[tuple[str, str]]:
    """(variant set, variant) of the robot's own prim."""
    stage = Usd.Stage.Open(str(root))
    prim = stage.GetDefaultPrim()
    if not prim:
        return []
    sets = prim.GetVariantSets()
    names = sets.GetNames()
    return [(name, one) for name in names for one in sets.GetVariantSet(name).GetVariantNames()]


def _flattened(root: Path, choice: tuple[str, str] | None) -> tuple[Sdf.Layer, Usd.Stage]:
    """All of a stage in one layer, and that as a stage; NotParsedError."""
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
    return flat, Usd.Stage.Open(flat)


def _without_instances(stage: Usd.Stage) -> list[str]:
    """Makes every instance a prim of its own; returns which they were."""
    found: list[str] = []
    while instances := [prim for prim in stage.Traverse() if prim.IsInstance()]:
        for prim in instances:
            found.append(str(prim.GetPath()))
            prim.SetInstanceable(False)
    return sorted(found)


def _is_default(row: Row, stage: Usd.Stage) -> bool:
    """Whether a property that only one side states says what its schema says anyway."""
    name, _, what = row.attribute.rpartition(" ")
    prim = stage.GetPrimAtPath(row.name)
    if what not in ("missing", "extra") or not name or not prim:
        return False
    fallback = prim.GetPrimDefinition().GetAttributeFallbackValue(name)
    stated = row.expected if what == "missing" else row.found
    return fallback is not None and (stated is None or _shown(fallback) == stated)
