"""Do meshes whose file names an up axis stand as the rest of the robot says they should?

`<up_axis>` is wrong as often as right, and no viewer agrees with another. What tells is the
robot itself: collision shapes that name no axis enclose the same part, and the centre of mass
lies inside of it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import ConvertedMesh
from assetbuild.mesh.read import TO_Z_UP
from assetbuild.robot.codec import decode_file
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Body, Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import (
    Box,
    Capsule,
    Cylinder,
    MeshFile,
    SourceGeometry,
    SourceShape,
    SourceShapes,
    Sphere,
)

CLEARLY = 0.05
"""Share of the part's size by which the other way must fit better to be worth a word."""

UP_AXIS_FIT = Rule(
    "mesh.up_axis.fit",
    "warning",
    "meshes would fit the collision shapes or the centre of mass of their links better with the "
    "other up axis",
    "name them in `source.honour_up_axis`, or take them out of it",
)


Box3 = Array
"""(2, 3): lower and upper corner of an axis-aligned box, m."""


@dataclass(frozen=True)
class _Fit:
    """Misfit of one shape as it is and the other way, as shares of its size."""

    shape: SourceShape
    now: float
    other: float
    by: str


class LintMeshes(Step):
    """`links.json`, `shapes.json`, `meshes/<number>.json` -> findings only."""

    shapes: tuple[str, ...]
    """Names of the shapes that `meshes/0.json`, `.../1.json`, ... are of; others are left out."""

    def run(self, files: Files) -> Iterator[Finding]:
        """One finding for all meshes of the robot."""
        robot = RobotFiles(files.inputs)
        records = {
            name: decode_file(ConvertedMesh, files.inputs / "meshes" / f"{number}.json")
            for number, name in enumerate(self.shapes)
        }
        finding = judge_up_axes(robot.links, robot.source_shapes, records)
        if finding is not None:
            yield finding


def judge_up_axes(
    tree: Tree, shapes: SourceShapes, records: Mapping[str, ConvertedMesh]
) -> Finding | None:
    """One finding for all meshes of the robot, if most would stand better the other way.

    records: by the name of the shape; a mesh without one is no witness.
    """
    fits = [fit for body in tree.bodies for fit in _fits(body, shapes, records)]
    better = [fit for fit in fits if fit.other < fit.now - CLEARLY]
    worse = [fit for fit in fits if fit.now < fit.other - CLEARLY]
    return _finding(better, worse, records) if len(better) > len(worse) else None


def _finding(
    better: list[_Fit], worse: list[_Fit], records: Mapping[str, ConvertedMesh]
) -> Finding:
    first = max(better, key=lambda fit: fit.now - fit.other)
    record, mesh = records[first.shape.name], _path(first.shape)
    do = "taken as it is" if record.turned else "turned to Z"
    key = "leave it out of" if record.turned else "name it in"
    return UP_AXIS_FIT(
        f"mesh {mesh}",
        f"it says {record.up_axis} and would fit link `{first.shape.link}` better {do}: "
        f"{first.by} is off by {100 * first.now:.0f} % of its size, then {100 * first.other:.0f} %"
        f"; so it is for {len(better)} shapes, the opposite for {len(worse)}",
        hint=f"{key} `source.honour_up_axis`",
        data={
            "better": len(better),
            "worse": len(worse),
            "meshes": tuple(sorted({_path(fit.shape) for fit in better})),
        },
    )


def _path(shape: SourceShape) -> str:
    assert isinstance(shape.geometry, MeshFile)  # noqa: S101 # only meshes have a record
    return shape.geometry.path


def _fits(body: Body, shapes: SourceShapes, records: Mapping[str, ConvertedMesh]) -> Iterator[_Fit]:
    own = [
        shape
        for shape in shapes.shapes
        if shape.link == body.name
        and (not isinstance(shape.geometry, MeshFile) or shape.name in records)
    ]
    for role in ("visual", "collision"):
        doubted = [s for s in own if s.role == role and _says(s, records)]
        if not doubted:
            continue
        # One box for all parts of a role: collision is cut into other pieces than what is seen.
        witnesses = [s for s in own if s.role != role and not _says(s, records)]
        sure = [s for s in own if s.role == role and not _says(s, records)]
        now = _around([*doubted, *sure], records, other=False)
        other = _around([*doubted, *sure], records, other=True)
        if witnesses:
            seen = _around(witnesses, records, other=False)
            misfits = [float(np.abs(box - seen).max()) for box in (now, other)]
            by = "its collision or visual shape"
        elif body.inertial is not None and any(body.inertial.com_m):  # zero is often made up
            misfits = [_outside(box, np.array(body.inertial.com_m)) for box in (now, other)]
            by = "the centre of mass"
        else:
            continue
        size = float(np.linalg.norm(now[1] - now[0]))
        yield _Fit(doubted[0], misfits[0] / size, misfits[1] / size, by)


def _outside(box: Box3, point: Array) -> float:
    """How far a point lies outside, m."""
    gap = np.maximum(box[0] - point, point - box[1])
    return float(np.linalg.norm(np.maximum(gap, 0.0)))


def _says(shape: SourceShape, records: Mapping[str, ConvertedMesh]) -> bool:
    return shape.name in records and records[shape.name].up_axis is not None


def _around(
    shapes: list[SourceShape], records: Mapping[str, ConvertedMesh], *, other: bool
) -> Box3:
    """Bounds of some shapes in the frame of their link; `other`: doubted ones the other way."""
    points = []
    for shape in shapes:
        record = records.get(shape.name)
        if record is None:
            corners = _corners(_of_primitive(shape.geometry))
        else:
            corners = _corners(np.array([record.lower, record.upper]))
            if other and record.up_axis is not None:
                corners = _otherwise(corners, record, shape.geometry)
        points.append(shape.X_link_shape.apply(corners))
    every = np.concatenate(points)
    return np.array([every.min(axis=0), every.max(axis=0)])


def _corners(box: Box3) -> Array:
    """(8, 3) m."""
    return np.array(list(itertools.product(*box.T)), dtype=np.float64)


def _otherwise(corners: Array, record: ConvertedMesh, geometry: SourceGeometry) -> Array:
    """The corners of a mesh if its up axis were honoured, or were not: again those of a box."""
    turn = np.array(TO_Z_UP[record.up_axis or ""], dtype=np.float64)
    if record.turned:
        turn = turn.T
    scale = np.array(geometry.scale if isinstance(geometry, MeshFile) else (1.0, 1.0, 1.0))
    return np.asarray((corners / scale) @ turn.T * scale)


def _of_primitive(geometry: SourceGeometry) -> Box3:
    match geometry:
        case Box(size):
            half = np.array(size) / 2.0
        case Sphere(radius):
            half = np.full(3, radius)
        case Cylinder(radius, length):
            half = np.array([radius, radius, length / 2.0])
        case Capsule(radius, length):
            half = np.array([radius, radius, length / 2.0 + radius])
        case MeshFile():
            raise TypeError("a mesh has a record")
    return np.array([-half, half])
