"""MJCF: the text locates, the compiled models decide."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from assetbuild.facts.again.tree import Node, Row, groups, of_one_sign, same, tree_rows
from assetbuild.facts.again.xml import xml_tree
from assetbuild.facts.mjcf_fields import CALLED, subjects
from assetbuild.simulators.mujoco import Model, mj

PREFIXES = (
    "body jnt geom site cam light mesh hfield tex mat pair exclude eq tendon actuator sensor "
    "numeric text tuple key"
)
KINDS = {prefix: CALLED.get(prefix, prefix) for prefix in PREFIXES.split()}
"""How MuJoCo's arrays begin -> what MJCF calls the thing; its count is `n` and the former."""
PLACES = ("names", "paths", "pathadr", "nameadr", "name_", "signature", "nbuffer")
"""Words in the names of fields that state where a file lay or how long names are."""
DERIVED = ("invweight", "subtreemass", "lengthrange", "bvh", "oct_", "simple", "sameframe", "M_",
           "D_", "B_", "map", "stat.", "qpos0")  # fmt: skip
"""Words in the names of fields that follow from others."""
QUATERNIONS = {0: 3, 1: 0}
"""Free and ball joints -> where among their positions the quaternion begins."""
ABSENT = ("missing", "extra", "order")
Fields = dict[str, Any]
"""Arrays of a compiled model by name. Any: arrays of numpy."""


def mjcf_rows(again: Path, there: Path) -> list[Row]:
    """What two models say differently. Both lie among the same meshes and included files."""
    text = tree_rows(xml_tree(again), xml_tree(there))
    try:
        after = mj.MjModel.from_xml_path(str(there))
    except ValueError:
        return text
    compiled = _model_rows(mj.MjModel.from_xml_path(str(again)), after)
    if not compiled or not text or len(groups(text)) > len(groups(compiled)):
        return compiled
    return [named for row in text for named in _with_subjects(row, compiled)]


def _with_subjects(row: Row, compiled: Sequence[Row]) -> Iterator[Row]:
    """A row about a default class, as rows about the things that it changes."""
    element, _, attribute = row.attribute.partition(" ")
    kind = element if element in KINDS.values() else "actuator"
    names = dict.fromkeys(each.name for each in compiled if each.kind == kind)
    if row.kind != "default" or not attribute or not names:
        yield row
        return
    for name in names:
        yield replace(row, kind=kind, name=name, attribute=attribute)


# --- compiled models --------------------------------------------------------------------------


def _model_rows(again: Model, there: Model) -> list[Row]:
    """What two compiled models state differently, but for what follows from it."""
    before, after = _fields(again), _fields(there)
    differ = [f for f in before if f in after and not same(before[f], after[f])]
    rows = tree_rows(_tree(again, before, differ), _tree(there, after, differ))
    if structure := [row for row in rows if row.attribute in ABSENT]:
        return structure  # the rest of the arrays has other rows
    stated = [row for row in rows if not any(word in row.attribute for word in DERIVED)]
    return stated or rows


def _fields(model: Model) -> Fields:
    """All of a model and its name, without the signs of quaternions."""
    fields = dict(_walk(model, ""), name=bytes(model.names).partition(b"\0")[0].decode())
    for field in ("qpos0", "qpos_spring", "key_qpos"):
        rows = np.atleast_2d(fields[field]).copy()
        for kind, start in zip(model.jnt_type, model.jnt_qposadr, strict=True):
            if kind in QUATERNIONS:
                first = int(start) + QUATERNIONS[int(kind)]
                rows[:, first : first + 4] = of_one_sign(rows[:, first : first + 4])
        fields[field] = rows
    return fields


def _walk(value: Any, path: str) -> Iterator[tuple[str, Any]]:  # Any: a structure of MuJoCo
    """(name, array) of all fields, those of structures inside it with a dot."""
    for name in dir(value):
        if name.startswith("_") or any(word in name for word in PLACES):
            continue
        field = getattr(value, name)
        if isinstance(field, np.ndarray | int | float):
            array = np.array(field)
            yield f"{path}{name}", of_one_sign(array) if name.endswith("quat") else array
        elif not callable(field) and not isinstance(field, str | bytes):
            yield from _walk(field, f"{path}{name}.")


def _tree(model: Model, fields: Fields, wanted: Sequence[str]) -> Node:
    """Rows of arrays by the names of what they are about; all else by the array's name."""
    things: dict[str, dict[str, dict[str, Node]]] = {
        kind: {name: {} for name in subjects(model, prefix)} for prefix, kind in KINDS.items()
    }
    others: dict[str, dict[str, Node]] = {}
    for field in wanted:
        prefix, _, rest = field.partition("_")
        names = subjects(model, prefix) if prefix in (*KINDS, "dof") else []
        if rest and fields[field].ndim and len(names) == len(fields[field]):
            for name, row in zip(names, fields[field], strict=True):
                attributes = things[KINDS.get(prefix, "joint")][name]
                attributes[f"{rest}{f'[{len(attributes)}]' if rest in attributes else ''}"] = Node(
                    np.squeeze(row)
                )
        else:
            owner, _, name = field.rpartition(".")
            others.setdefault(owner.partition(".")[0] or "model", {})[name] = Node(fields[field])
    parts = {kind: Node(None, attributes, 0, (kind, "")) for kind, attributes in others.items()}
    for kind, named in things.items():
        nodes = {n: Node(None, attributes, 0, (kind, n)) for n, attributes in named.items()}
        parts[f"all of {kind}"] = Node(None, nodes, 0, (kind, ""), ordered=True)
    return Node(None, parts)
