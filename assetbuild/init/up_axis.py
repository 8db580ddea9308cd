"""Which meshes stand as their file says: `honour_up_axis`, where the robot itself tells."""

from __future__ import annotations

import re

from assetbuild.geometry.lint_meshes import meshes_to_turn
from assetbuild.init.draft import Draft, patterns_of
from assetbuild.init.look import InspectedRobot, mesh_of, scaled_points
from assetbuild.mesh.companions import format_of
from assetbuild.plugin_types import ConvertedMesh
from assetbuild.robot.pose import vec3
from assetbuild.robot.shapes import MeshFile, SourceShape

Z_UP = re.compile(rb"<up_axis>\s*Z_UP\s*<")
HEAD = 1 << 16
"""Bytes in which a COLLADA file tells its axis: its asset comes first."""


def turned(robot: InspectedRobot) -> frozenset[str]:
    """Paths of the meshes that the recipe turns as their files say."""
    links = {shape.link for shape in robot.shapes.shapes if _may_say_so(robot, shape)}
    records = {}
    for shape in robot.shapes.shapes:
        if shape.link in links and isinstance(shape.geometry, MeshFile):
            record = _bounds(robot, shape.geometry)
            if record is not None:  # else the build says what is wrong with it
                records[shape.name] = record
    return frozenset(meshes_to_turn(robot.links, robot.shapes, records) if records else ())


def put_up_axis(draft: Draft, robot: InspectedRobot, turn: frozenset[str]) -> None:
    """The key `honour_up_axis`, where a mesh needs it."""
    doubted = (s.geometry for s in robot.shapes.shapes if _may_say_so(robot, s))
    stated = {mesh.path for mesh in doubted if isinstance(mesh, MeshFile)}
    if turn:
        patterns = [".*"] if turn == stated else patterns_of(sorted(turn), sorted(stated))
        why = f"turned as their files say: {len(turn)} of {len(stated)} meshes that state an axis "
        draft.put(patterns, "source", "honour_up_axis", beside=why + "fit their links better so")


def _may_say_so(robot: InspectedRobot, shape: SourceShape) -> bool:
    """May the file state an axis other than Z? A glTF does, and a COLLADA that says nothing."""
    if not isinstance(shape.geometry, MeshFile):
        return False
    format = format_of(shape.geometry.path)
    if format in ("glb", "gltf"):
        return True
    try:
        with (robot.root / shape.geometry.path).open("rb") as file:
            return format == "dae" and not Z_UP.search(file.read(HEAD))
    except OSError:
        return False


def _bounds(robot: InspectedRobot, mesh: MeshFile) -> ConvertedMesh | None:
    """What `convert_mesh` would say of its bounds; None for one that it would refuse."""
    read = mesh_of(robot.root, mesh)
    if read is None:
        return None
    points = scaled_points(read, mesh)
    lower, upper = vec3(points.min(axis=0)), vec3(points.max(axis=0))
    return ConvertedMesh((), 0, 0.0, lower, upper, False, None, read.up_axis)
