"""Does a bundle's own robot agree with itself: links, merged bodies, drives, meshes, sections?

`report/robot.json` holds the links before merging and the bodies after; merged again, the links
must give the bodies. Each thing stands there once. The sections of the recipe stand in
`provenance.json` too.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from assetbuild.facts.compare import Precision, differences, equality_findings
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key, Table, Value, pair_name
from assetbuild.findings import Finding
from assetbuild.robot.model import Tree
from assetbuild.robot.shapes import Mesh
from assetbuild.robot.tree import merge_fixed_joints

HELD = "links", "tree", "shapes", "control", "assets"
"""Parts of the robot whose lists name each thing once."""


def incoherent(reference: Reference) -> Iterator[Finding]:
    """A finding `equal.robot.<quantity>` for each fact that the robot tells in two ways."""
    kept = [joint.child for joint in reference.tree.joints if joint.kind == "fixed"]
    same_root = reference.tree.root == reference.links.root
    merged, _ = merge_fixed_joints(reference.links, True, kept, keep_root=same_root)
    again = _with_ratings(robot_table(replace(reference, tree=merged)), merged)
    stated = _with_ratings(robot_table(reference), reference.tree)
    expected, found = _meshes(reference)
    for key, (wanted, said) in {**_once(reference), **_canonical(reference)}.items():
        expected[key], found[key] = wanted, said
    different = differences(
        Table({**stated.facts, **expected}), Table({**again.facts, **found}), Precision()
    )
    yield from equality_findings(different, "robot", "the links of report/robot.json", {})


def other_sections(reference: Reference, bundle: Path) -> Iterator[Finding]:
    """A finding for each entry of the recipe's sections that `provenance.json` tells otherwise."""
    try:
        statement = json.loads((bundle / "provenance.json").read_bytes())
        built = statement["predicate"]["buildDefinition"]["externalParameters"]["sections"]
    except (OSError, ValueError, LookupError, TypeError):
        return  # of a bundle that an earlier version built
    found = differences(_sections(built), _sections(reference.options), Precision())
    yield from equality_findings(found, "robot", "report/robot.json", {}, "provenance.json")


def _sections(said: object) -> Table:
    """An entry that is null stands there."""
    found = ((path, "null" if value is None else value) for path, value in leaves(said))
    return Table({Key("recipe", "", f"recipe:{path}"): value for path, value in found})


def leaves(value: object, path: str = "") -> Iterator[tuple[str, Value]]:
    """(path, value) of all leaves of plain JSON; items of a list go by their names.

    A second item of one name has its place behind it. What is empty is a leaf.
    """
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from leaves(item, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list | tuple) and value:
        seen = set()
        for index, item in enumerate(value):
            named = item.get("name", item.get("joint")) if isinstance(item, Mapping) else None
            again = f"[{index}]" if not named or named in seen else ""
            seen.add(named)
            yield from leaves(item, f"{path}.{named}{again}" if named else f"{path}{again}")
    elif isinstance(value, bool | str) or value is None:
        yield path, value
    elif isinstance(value, int | float):
        yield path, float(value)
    else:
        yield path, "nothing"


# --- what stands there twice ------------------------------------------------------------------


def _meshes(reference: Reference) -> tuple[dict[Key, Value], dict[Key, Value]]:
    """What the list of meshes says, and what was measured in their files."""
    expected: dict[Key, Value] = {}
    found: dict[Key, Value] = {}
    surfaces = dict(reference.assets.surfaces)
    solid = reference.shapes.of("collision")
    pieces = {shape.geometry.mesh for shape in solid if isinstance(shape.geometry, Mesh)}
    for mesh in reference.shapes.meshes:
        surface = surfaces.get(mesh.name)
        rows: dict[str, tuple[Value, Value]] = {
            "triangles": (float(mesh.faces), float(surface.triangles) if surface else None),
            "vertices": (float(mesh.vertices), float(surface.vertices) if surface else None),
            "file": (mesh.file, f"{mesh.name}.obj"),
        }
        if mesh.name not in pieces:
            rows["convex"] = mesh.convex, False  # only hulls that were made to collide are
        for word, (said, measured) in rows.items():
            expected[Key("mesh", mesh.name, f"robot:{word}")] = said
            found[Key("mesh", mesh.name, f"robot:{word}")] = measured
    return expected, found


def _once(reference: Reference) -> dict[Key, tuple[Value, Value]]:
    """(1, how often) of each named thing that a list has more than once."""
    robot = json.loads(reference.to_json())
    counts: Counter[tuple[str, str]] = Counter()
    for part in HELD:
        counts.update(_named(robot[part], part))
    return {
        Key(where, name, "robot:entries"): (1.0, float(count))
        for (where, name), count in counts.items()
        if count > 1
    }


def _named(value: object, path: str) -> Iterator[tuple[str, str]]:
    """(path of a list, name of an item) for every list of named items."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _named(item, f"{path}.{key}")
    elif isinstance(value, list):
        for item in value:
            name = _name(item)
            if name:
                yield path, name
            yield from _named(item, f"{path}.{name}" if name else path)


def _name(item: object) -> str:
    """Of an entry with a name, of a pair that begins with one, of a pair of bodies."""
    if isinstance(item, dict):
        return str(item.get("name") or item.get("joint") or "")
    if isinstance(item, list) and item and isinstance(item[0], str):
        return " ".join(item) if all(isinstance(part, str) for part in item) else item[0]
    return ""


def _canonical(reference: Reference) -> dict[Key, tuple[Value, Value]]:
    """(as it must be, as it stands there) of what has one way of being written."""
    found: dict[Key, tuple[Value, Value]] = {
        Key("robot", "", "robot:name"): (reference.links.name, reference.tree.name)
    }
    for kind, tree in (("link's joint", reference.links), ("joint", reference.tree)):
        for joint in tree.joints:
            key = Key(kind, joint.name, "robot:length of axis")
            found[key] = 1.0, math.hypot(*joint.axis)
    for pair in reference.control.excludes:
        name = pair_name(*sorted(pair))
        found[Key("pair", name, "robot:order")] = tuple(sorted(pair)), tuple(pair)
        found[Key("pair", name, "robot:bodies")] = 2.0, float(len(set(pair)))
    return found


def _with_ratings(table: Table, tree: Tree) -> Table:
    """With what the source says of the joints themselves, which drives may override.

    A fixed joint has an axis too, about which nothing turns.
    """
    said: dict[Key, Value] = {}
    for joint in tree.joints:
        said[Key("joint", joint.name, "robot:axis")] = tuple(joint.axis)
        for word in ("damping", "friction"):
            said[Key("joint", joint.name, f"robot:source's {word}")] = getattr(joint, word)
        for word in ("effort", "velocity"):
            said[Key("joint", joint.name, f"robot:source's {word}")] = getattr(joint.limits, word)
    return Table({**table.facts, **said})
