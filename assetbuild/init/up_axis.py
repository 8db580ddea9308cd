"""Which meshes stand as their file says: `honour_up_axis`, where the robot itself tells."""

from __future__ import annotations

from assetbuild.geometry.lint_meshes import judge_up_axes
from assetbuild.init.look import InspectedRobot
from assetbuild.init.mesh_points import mesh_of, scaled_points
from assetbuild.init.source import UrdfSource
from assetbuild.kinds import ConvertedMesh
from assetbuild.robot.pose import vec3
from assetbuild.robot.shapes import MeshFile, SourceShape

SAYS = (b">Y_UP<", b">X_UP<")
HEAD = 1 << 16
"""Bytes in which a COLLADA file tells its axis: its asset comes first."""


def turned(source: UrdfSource, robot: InspectedRobot) -> list[str]:
    """The line `honour_up_axis` with its reason; nothing where no mesh needs it."""
    doubted = [s for s in robot.shapes.shapes if _says_so(source, s)]
    if not doubted:
        return []
    links = {shape.link for shape in doubted}
    records = {}
    for shape in robot.shapes.shapes:
        if shape.link in links and isinstance(shape.geometry, MeshFile):
            record = _bounds(source, shape.geometry)
            if record is None:
                return []  # the build says what is wrong with it
            records[shape.name] = record
    finding = judge_up_axes(robot.links, robot.shapes, records)
    if finding is None:
        return []
    told = f"{finding.data['better']} shapes fit their links better so, {finding.data['worse']} not"
    return [f'  honour_up_axis: [".*"]   # meshes stand as their files say: {told}']


def _says_so(source: UrdfSource, shape: SourceShape) -> bool:
    if not isinstance(shape.geometry, MeshFile) or not shape.geometry.path.lower().endswith(".dae"):
        return False
    try:
        with (source.root / shape.geometry.path).open("rb") as file:
            head = file.read(HEAD)
    except OSError:
        return False
    return any(word in head for word in SAYS)


def _bounds(source: UrdfSource, mesh: MeshFile) -> ConvertedMesh | None:
    """What `convert_mesh` would say of its bounds; None for one that it would refuse."""
    read = mesh_of(source.root, mesh)
    if read is None:
        return None
    points = scaled_points(read, mesh)
    lower, upper = vec3(points.min(axis=0)), vec3(points.max(axis=0))
    return ConvertedMesh((), 0, 0.0, lower, upper, False, None, read.up_axis)
