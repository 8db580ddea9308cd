"""Mutations of USD layers: every prim, property, metadata field and list of each layer's specs."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Vt

from tests.mutations.change import Mutation, other_text, pools, vector_changes

Value = Any  # whatever a field of a layer holds
STRUCTURE = {
    "primChildren", "properties", "variantSetChildren", "variantChildren", "targetChildren",
    "connectionChildren", "subLayerOffsets",
}  # fmt: skip
"""Fields that list children, whose own specs are walked; Python cannot read the offsets."""
VECTORS = (
    Gf.Vec2d, Gf.Vec2f, Gf.Vec2i, Gf.Vec3d, Gf.Vec3f, Gf.Vec3i, Gf.Vec4d, Gf.Vec4f, Gf.Vec4i,
)  # fmt: skip
QUATERNIONS = (Gf.Quatd, Gf.Quatf, Gf.Quath)
DRAWN = 24
"""Of a longer array so many elements are drawn."""


def walk(path: Path, file: str, random_: random.Random) -> Iterator[Mutation]:
    """All mutations of one layer."""
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    fields = [(p, f, layer.GetObjectAtPath(p).GetInfo(f)) for p, f in _fields(layer)]
    texts = pools([(_label(layer, p, f), t) for p, f, value in fields for t in _texts(value)])
    for at, field, value in fields:
        label = _label(layer, at, field)
        for what, arg, after in _changes(value, texts.get(label, []), random_):
            key = ("set", str(at), field, what, arg)
            yield Mutation(file, str(at), label, what, _short(value), _short(after), key)
    for at in _paths(layer):
        yield from _structure(layer, at, file)


def _structure(layer: Sdf.Layer, at: Sdf.Path, file: str) -> Iterator[Mutation]:
    spec = layer.GetObjectAtPath(at)
    if isinstance(spec, Sdf.PropertySpec):
        name = str(at.name)
        yield Mutation(file, str(at), name, "property deleted", name, "", ("remove", str(at)))
    elif isinstance(spec, Sdf.PrimSpec) and at.IsPrimPath():
        label = f"prim {spec.typeName or spec.specifier.displayName}"
        yield Mutation(file, str(at), label, "prim deleted", at.name, "", ("remove", str(at)))
        renamed = ("rename", str(at), f"{at.name}_x")
        yield Mutation(file, str(at), label, "prim renamed", at.name, f"{at.name}_x", renamed)
        if at.pathElementCount > 1:
            copied = ("copy", str(at), f"{at.name}_copy")
            yield Mutation(file, str(at), label, "prim duplicated", at.name, at.name, copied)


def apply(path: Path, key: tuple[object, ...]) -> None:
    """Makes the change of a mutation's key in the file."""
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    what, at = key[0], Sdf.Path(str(key[1]))
    if what == "set":
        spec = layer.GetObjectAtPath(at)
        new = changed(spec.GetInfo(str(key[2])), str(key[3]), key[4])
        if isinstance(new, list):
            layer.subLayerPaths = new
        elif new is None:
            spec.ClearInfo(str(key[2]))
        else:
            spec.SetInfo(str(key[2]), new)
    elif what == "copy":
        Sdf.CopySpec(layer, at, layer, at.GetParentPath().AppendChild(str(key[2])))
    else:
        edit = Sdf.BatchNamespaceEdit()
        edit.Add(
            Sdf.NamespaceEdit.Remove(at)
            if what == "remove"
            else Sdf.NamespaceEdit.Rename(at, str(key[2]))
        )
        if not layer.Apply(edit):
            raise ValueError(f"{at} cannot be removed or renamed")
    layer.Export(str(path))
    there = Sdf.Layer.Find(str(path))
    if there:
        there.Reload(True)


# --- fields


def _paths(layer: Sdf.Layer) -> list[Sdf.Path]:
    found: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, found.append)
    return sorted(p for p in found if not p.IsTargetPath())


def _fields(layer: Sdf.Layer) -> Iterator[tuple[Sdf.Path, str]]:
    for at in _paths(layer):
        spec = layer.GetObjectAtPath(at)
        if spec is None or isinstance(spec, Sdf.VariantSetSpec):
            continue
        for field in sorted(spec.ListInfoKeys()):
            if field not in STRUCTURE:
                yield at, field


def _label(layer: Sdf.Layer, at: Sdf.Path, field: str) -> str:
    """`physics:mass`, `layer upAxis`, `prim kind`, `material:binding targetPaths`."""
    if at == Sdf.Path.absoluteRootPath:
        return f"layer {field}"
    if at.IsPropertyPath():
        return str(at.name) if field == "default" else f"{at.name} {field}"
    return f"prim {field}"


def _texts(value: Value) -> list[str]:
    if isinstance(value, Sdf.AssetPath):
        return [value.path]
    return [value] if isinstance(value, str) else []


# --- values


def _changes(
    value: Value, pool: list[str], random_: random.Random
) -> Iterator[tuple[str, object, Value]]:
    """(name, argument of `changed`, value after) of every change of a value."""
    for what, arg in _plans(value, pool, random_):
        after = changed(value, what, arg)
        if after is not None or what == "cleared":
            yield what, arg, after


def _plans(value: Value, pool: list[str], random_: random.Random) -> Iterator[tuple[str, object]]:
    numbers = _numbers(value)
    if isinstance(value, bool):
        yield "flipped", None
    elif isinstance(value, str | Sdf.AssetPath):
        text = value.path if isinstance(value, Sdf.AssetPath) else value
        yield "another text", other_text(text, pool, random_)
    elif numbers is not None and len(numbers):
        drawn = sorted(random_.sample(range(len(numbers)), min(DRAWN, len(numbers))))
        part = [int(numbers[i]) if _is_whole(value) else float(numbers[i]) for i in drawn]
        for what, new in vector_changes(part, random_):
            rows = [(i, n) for i, old, n in zip(drawn, part, new, strict=True) if old != n]
            yield what, tuple(rows)
        if _is_array(value):
            yield "last dropped", None
    elif isinstance(value, Vt.TokenArray | Vt.StringArray | list) and len(value):
        yield "last dropped", None
        if len(value) > 1:
            yield "swapped", None
    elif _lists(value):
        yield "item dropped", random_.randrange(len(_items(value)))
        if isinstance(value, Sdf.TokenListOp):
            yield "item added", "PhysicsArticulationRootAPI"
        if isinstance(value, Sdf.PathListOp):
            yield "item changed", None
    elif isinstance(value, dict) and value:
        yield "entry changed", random_.choice(sorted(value))
    if not isinstance(value, bool | list):
        yield "cleared", None


def changed(value: Value, what: str, arg: object) -> Value:
    """The value after a change; None: the field is gone, or the change is none of such a value."""
    if what == "cleared":
        return None
    if what == "flipped":
        return not value
    if what == "another text":
        return Sdf.AssetPath(str(arg)) if isinstance(value, Sdf.AssetPath) else type(value)(arg)
    if what == "last dropped":
        return type(value)(list(value)[:-1])
    if what == "entry changed":
        return {**value, str(arg): _other(value[str(arg)])}
    if what.startswith("item"):
        return _with_items(value, what, arg)
    if isinstance(value, Vt.TokenArray | Vt.StringArray | list):
        return type(value)([*list(value)[1:], value[0]])
    assert isinstance(arg, tuple)
    return _with_numbers(value, dict(arg))


def _other(value: Value) -> Value:
    if isinstance(value, bool):
        return not value
    return (
        value * 1.1
        if isinstance(value, float)
        else value + 1
        if isinstance(value, int)
        else f"{value}x"
    )


def _numbers(value: Value) -> np.ndarray[Any, Any] | None:  # numbers of any type
    """All numbers of a value in one row; quaternions as w, x, y, z."""
    if isinstance(value, bool | str):
        return None
    if isinstance(value, int | float):
        return np.array([value])
    if isinstance(value, VECTORS):
        return np.array(list(value))
    if isinstance(value, QUATERNIONS):
        return np.array([value.real, *value.imaginary])
    if _is_array(value):
        return np.array(value).reshape(-1)
    return None


def _with_numbers(value: Value, new: dict[int, float]) -> Value:
    """The value with other numbers at some places of `_numbers`."""
    flat = _numbers(value)
    assert flat is not None
    flat = flat.copy()
    with np.errstate(over="ignore"):  # a planted number may be too large for a float
        for index, number in new.items():
            flat[index] = number
    plain = flat.tolist()
    if isinstance(value, int | float):
        return type(value)(plain[0])
    if isinstance(value, VECTORS):
        return type(value)(*plain)
    if isinstance(value, QUATERNIONS):
        return type(value)(*plain)
    shape = np.array(value).shape
    return type(value).FromNumpy(flat.reshape(shape))


def _is_array(value: Value) -> bool:
    return type(value).__name__.endswith("Array") and np.array(value).dtype.kind in "fiu"


def _is_whole(value: Value) -> bool:
    found = _numbers(value)
    return isinstance(value, int) or (found is not None and found.dtype.kind in "iu")


# --- lists


def _lists(value: Value) -> bool:
    return type(value).__name__.endswith("ListOp") and bool(_items(value))


def _items(value: Value) -> list[Value]:
    return [*value.explicitItems, *value.prependedItems, *value.appendedItems, *value.deletedItems]


def _with_items(value: Value, what: str, arg: object) -> Value:
    """A list of edits without one item, with one more, or with one of its paths changed."""
    new = type(value)()
    rows = ("explicitItems", "prependedItems", "appendedItems", "deletedItems")
    number = 0
    for row in rows:
        kept = []
        for item in getattr(value, row):
            if what == "item dropped" and number == arg:
                number += 1
                continue
            number += 1
            kept.append(_elsewhere(item) if what == "item changed" and number == 1 else item)
        if what == "item added" and getattr(value, row):
            kept.append(str(arg))
        if kept or getattr(value, row):
            setattr(new, row, kept)
    return new


def _elsewhere(path: Sdf.Path) -> Sdf.Path:
    """Its parent, or of a property another one."""
    return path.ReplaceName(f"{path.name}_x") if path.IsPropertyPath() else path.GetParentPath()


def _short(value: Value) -> str:
    return (
        " ".join(str(value).split())[:120]
        if not _is_array(value) or len(value) < 8
        else (f"{len(value)} elements")
    )
