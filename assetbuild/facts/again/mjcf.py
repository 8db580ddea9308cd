"""MJCF: the text locates, the compiled models decide."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from assetbuild.facts.again.row import ABSOLUTE, RELATIVE, Row, groups
from assetbuild.facts.again.xml import root_of, xml_rows
from assetbuild.facts.mjcf_fields import subjects
from assetbuild.facts.table import Value
from assetbuild.simulators.mujoco import Model

KINDS = {
    "body": "body", "jnt": "joint", "geom": "geom", "site": "site", "cam": "camera",
    "light": "light", "mesh": "mesh", "hfield": "hfield", "tex": "texture", "mat": "material",
    "pair": "pair", "exclude": "exclude", "eq": "equality", "tendon": "tendon",
    "actuator": "actuator", "sensor": "sensor", "numeric": "numeric", "text": "text",
    "tuple": "tuple", "key": "key",
}  # fmt: skip
"""How MuJoCo's arrays begin -> what MJCF calls the thing; its count is `n` and the former."""
PLACES = ("names", "paths", "pathadr", "nameadr", "name_", "signature", "narena", "nbuffer")
"""Words in the names of fields that tell where a file lay or how much memory the model takes."""
DERIVED = ("invweight", "subtreemass", "lengthrange", "bvh", "oct_", "simple", "sameframe", "M_",
           "D_", "B_", "map", "stat.", "0")  # fmt: skip
"""Parts of the names of fields that follow from others; a trailing 0: at the home position."""
QUATERNIONS = {0: 3, 1: 0}
"""Free and ball joints -> where among their positions the quaternion begins."""
SHORT = 4
"""Numbers of a vector that is shown whole; of a longer one only the first that differs."""


def mjcf_rows(again: Path, there: Path) -> list[Row]:
    """What two models say differently. Both lie among the same meshes and included files."""
    text = xml_rows(again.read_bytes(), there.read_bytes())
    after = _compiled(there)
    if after is None:
        return text
    compiled = list(_model_rows(_must_compile(again), after))
    shown = [row for row in compiled if not _is_derived(row.attribute)] or compiled
    if not compiled or not text or len(groups(text)) > len(groups(shown)):
        return shown
    return [named for row in text for named in _with_subjects(row, shown)]


def is_mjcf(data: bytes) -> bool:
    """Whether an XML file is a model of MuJoCo. NotParsedError."""
    return root_of(data).tag == "mujoco"


def _compiled(path: Path) -> Model | None:
    """None where MuJoCo refuses the model."""
    import mujoco

    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError:
        return None


def _must_compile(path: Path) -> Model:
    import mujoco

    return mujoco.MjModel.from_xml_path(str(path))


def _with_subjects(row: Row, compiled: Sequence[Row]) -> Iterator[Row]:
    """A row about a default class, as rows about the things that it changes."""
    words = row.attribute.split()
    if row.kind != "default" or len(words) < 2:
        yield row
        return
    kind = words[0] if words[0] in KINDS.values() else "actuator"
    names = dict.fromkeys(each.name for each in compiled if each.kind == kind)
    for name in names:
        yield replace(row, kind=kind, name=name, attribute=" ".join(words[1:]))
    if not names:
        yield row


# --- compiled models --------------------------------------------------------------------------


def _model_rows(again: Model, there: Model) -> Iterator[Row]:
    """Every field of two compiled models."""
    same_counts = set()
    for prefix, kind in KINDS.items():
        ours, theirs = subjects(again, prefix), subjects(there, prefix)
        if ours == theirs:
            same_counts.add(prefix)
            continue
        for name in dict.fromkeys((*ours, *theirs)):
            if (name in ours) != (name in theirs):
                there_only = name in theirs
                what = "extra" if there_only else "missing"
                yield Row(
                    kind, name, what, None if there_only else name, name if there_only else None
                )
        if sorted(ours) == sorted(theirs):
            yield Row(kind, "", "order", " ".join(ours), " ".join(theirs))
    before, after = dict(_fields(again)), dict(_fields(there))
    for field in before.keys() & after.keys():
        yield from _field_rows(field, before[field], after[field], again, same_counts)


def _fields(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:  # Any: a structure of MuJoCo
    """(name, array or number) of all fields, those of structures inside it with a dot."""
    for name in dir(value):
        if name.startswith("_") or any(word in name for word in PLACES):
            continue
        found = getattr(value, name)
        if isinstance(found, np.ndarray | int | float):
            yield f"{path}{name}", np.asarray(found)
        elif not callable(found) and not isinstance(found, str | bytes):
            yield from _fields(found, f"{path}{name}.")


def _field_rows(
    field: str,
    one: Any,
    other: Any,
    model: Model,
    same: set[str],  # Any: arrays
) -> Iterator[Row]:
    if one.shape != other.shape:
        if not field.partition("_")[2]:
            yield Row("model", "", field, str(one.shape), str(other.shape))
        return
    if _close(one, other) or _same_places(field, one, other, model):
        return
    prefix, _, rest = field.partition("_")
    owners = _owners(model, prefix)
    if one.ndim == 0 or len(owners) != len(one) or (prefix not in same and prefix != "dof"):
        kind, _, name = field.rpartition(".")
        yield _first(kind.partition(".")[0] or "model", "", name, one.ravel(), other.ravel())
        return
    for index, (kind, name) in enumerate(owners):
        a, b = np.ravel(one[index]), np.ravel(other[index])
        if not _close(a, b) and not ("quat" in rest and _close(a, -b)):
            yield _first(kind, name, rest, a, b)


def _owners(model: Model, prefix: str) -> list[tuple[str, str]]:
    """(kind, name) of what the rows of an array are about."""
    kind = "joint" if prefix == "dof" else KINDS.get(prefix)
    return [(kind, name) for name in subjects(model, prefix)] if kind else []


def _first(kind: str, name: str, field: str, one: Any, other: Any) -> Row:  # Any: flat arrays
    """A short vector whole, of a long one the first number that differs."""
    if len(one) <= SHORT:
        return Row(kind, name, field, _value(one), _value(other))
    index = next(i for i in range(len(one)) if not _close(one[i], other[i]))
    return Row(kind, name, f"{field}[{index}]", float(one[index]), float(other[index]))


def _value(values: Any) -> Value:  # Any: a flat array
    numbers = tuple(map(float, values))
    return numbers[0] if len(numbers) == 1 else numbers


def _close(one: Any, other: Any) -> bool:  # Any: arrays of one shape
    if np.asarray(one).dtype.kind != "f":
        return bool(np.array_equal(one, other))
    return bool(np.allclose(one, other, rtol=RELATIVE, atol=ABSOLUTE, equal_nan=True))


def _same_places(field: str, one: Any, other: Any, model: Model) -> bool:  # Any: arrays
    """Whether two lists of joint positions are the same, quaternions of either sign."""
    if field not in ("qpos0", "qpos_spring", "key_qpos"):
        return False
    columns = np.atleast_2d(one).T, np.atleast_2d(other).T
    turned = columns[1].copy()
    for kind, start in zip(model.jnt_type, model.jnt_qposadr, strict=True):
        if kind in QUATERNIONS:
            first = int(start) + QUATERNIONS[int(kind)]
            for key in range(turned.shape[1]):
                part = columns[0][first : first + 4, key], turned[first : first + 4, key]
                turned[first : first + 4, key] *= np.sign(np.dot(*part)) or 1.0
    return _close(columns[0], turned)


def _is_derived(field: str) -> bool:
    name = field.partition("[")[0]
    return any(name.endswith(part) if part == "0" else part in name for part in DERIVED)
