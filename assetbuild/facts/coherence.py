"""Does a bundle's own robot agree with itself: links, merged bodies, drives and meshes?

`report/robot.json` holds the links before merging and the bodies after; merged again, the links
must give the bodies.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from assetbuild.facts.compare import Precision, differences, equality_findings
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key, Table, Value
from assetbuild.findings import Finding
from assetbuild.robot.model import Tree
from assetbuild.robot.tree import merge_fixed_joints


def incoherent(reference: Reference) -> Iterator[Finding]:
    """A finding `equal.robot.<quantity>` for each fact that the robot tells in two ways."""
    kept = [joint.child for joint in reference.tree.joints if joint.kind == "fixed"]
    merged, _ = merge_fixed_joints(reference.links, True, kept)
    again = _with_ratings(robot_table(replace(reference, tree=merged)), merged)
    stated = _with_ratings(robot_table(reference), reference.tree)
    measured = {name: float(surface.triangles) for name, surface in reference.assets.surfaces}
    counted: dict[Key, Value] = {
        Key("mesh", mesh.name, "robot:triangles"): float(mesh.faces)
        for mesh in reference.shapes.meshes
    }
    found: dict[Key, Value] = {key: measured.get(key.name) for key in counted}
    different = differences(
        Table({**stated.facts, **counted}), Table({**again.facts, **found}), Precision()
    )
    yield from equality_findings(different, "robot", "the links of report/robot.json", {})


def _with_ratings(table: Table, tree: Tree) -> Table:
    """With what the source says of the joints themselves, which drives may override."""
    said: dict[Key, Value] = {}
    for joint in tree.joints:
        for word in ("damping", "friction"):
            said[Key("joint", joint.name, f"robot:source's {word}")] = getattr(joint, word)
        for word in ("effort", "velocity"):
            said[Key("joint", joint.name, f"robot:source's {word}")] = getattr(joint.limits, word)
    return Table({**table.facts, **said})
