"""Do meshes whose file names an up axis stand as the rest of the robot says they should?

`<up_axis>` is wrong as often as right, and no viewer agrees with another. What tells is the
robot itself: collision shapes that name no axis enclose the same part, and its centre of mass and
its joints lie in it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding, Rule
from assetbuild.mesh.companions import format_of
from assetbuild.mesh.material import ConvertedMesh
from assetbuild.mesh.primitives import half_height
from assetbuild.mesh.read import TO_Z_UP
from assetbuild.mesh.solid import beyond_box
from assetbuild.robot.codec import decode_file
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Body, Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import MeshFile, Role, SourceShape, SourceShapes

CLEARLY = 0.05
"""Share of the part's size by which the other way must fit better to be worth a word."""
CLOSELY = 0.15
"""Share of the size up to which a part fits its other shapes so well that they are sure."""

AGREED = 0.5
"""(votes for - votes against) / votes of a format: above it single doubts do not count."""
SHAPE = "its collision or visual shape"

UP_AXIS_FIT = Rule(
    "mesh.up_axis.fit",
    ("error", "warning"),
    "meshes would fit the shapes, the joints or the centre of mass of their links better with the "
    "other up axis (a warning where only one of the last two says so)",
    "name them in `source.honour_up_axis`, or take them out of it",
)


@dataclass(frozen=True, eq=False)
class _Standing:
    """A shape of known size in the frame of its link: (8, 3) corners as it stands, and the other
    way, m. path: of a mesh whose file states an up axis.
    """

    role: Role
    path: str | None
    now: Array
    other: Array


@dataclass(frozen=True)
class _Vote:
    """Misfit of the meshes of one role as they are and the other way, as shares of their size.

    paths: the files that these meshes come from. is_sure: shapes say so, or joints and mass alike.
    """

    link: str
    paths: tuple[str, ...]
    now: float
    other: float
    by: str
    is_sure: bool = False

    @property
    def is_better(self) -> bool:
        """Would the other way fit better?"""
        return self.other < self.now


class LintMeshes(Step):
    """`links.json`, `shapes.json`, `meshes/<number>.json` -> findings only."""

    shares = True
    shapes: tuple[str, ...]
    """Names of the shapes that `meshes/0.json`, `.../1.json`, ... are of; others are left out."""

    def run(self, files: Files) -> Iterator[Finding]:
        """One finding for all meshes of the robot."""
        robot = RobotFiles(files.inputs)
        records = _records(files.inputs, self.shapes)
        yield from judge_up_axes(robot.links, robot.source_shapes, records)


def _records(inputs: Path, shapes: Sequence[str]) -> dict[str, ConvertedMesh]:
    """Return the record of each shape's mesh, by the name of the shape."""
    return {
        name: decode_file(ConvertedMesh, inputs / "meshes" / f"{number}.json")
        for number, name in enumerate(shapes)
    }


def judge_up_axes(
    tree: Tree, shapes: SourceShapes, records: Mapping[str, ConvertedMesh]
) -> Iterator[Finding]:
    """One finding for all meshes of the robot that would stand better the other way.

    records: by the name of the shape; a mesh without one is no witness.
    """
    votes, doubted = _votes(tree, shapes, records)
    wrong = _wrong(votes, doubted)
    better = [vote for vote in votes if vote.is_better and wrong.intersection(vote.paths)]
    if not better:
        return
    first = max(better, key=lambda vote: (vote.is_sure, vote.now - vote.other))
    mesh = next(path for path in first.paths if path in wrong)
    is_turned = doubted[mesh].turned
    do = "taken as it is" if is_turned else "turned to Z"
    key = "leave it out of" if is_turned else "name it in"
    opposite = sum(not vote.is_better for vote in votes)
    meshes = tuple(sorted({path for vote in better for path in vote.paths if path in wrong}))
    yield UP_AXIS_FIT(
        f"mesh {mesh}",
        f"it says {doubted[mesh].up_axis} and would fit link `{first.link}` better {do}: "
        f"{first.by} is off by {100 * first.now:.0f} % of its size, then {100 * first.other:.0f} %"
        f"; so it is for {len(better)} shapes, the opposite for {opposite}",
        hint=f"{key} `source.honour_up_axis`"
        + (f", like {len(meshes) - 1} other meshes" if len(meshes) > 1 else ""),
        severity="error" if any(vote.is_sure for vote in better) else "warning",
        data={"better": len(better), "worse": opposite, "meshes": meshes},
    )


def meshes_to_turn(
    tree: Tree, shapes: SourceShapes, records: Mapping[str, ConvertedMesh]
) -> frozenset[str]:
    """Paths of the meshes that stand best with the up axis that they state; none was turned."""
    return _wrong(*_votes(tree, shapes, records))


def _wrong(votes: Sequence[_Vote], doubted: Mapping[str, ConvertedMesh]) -> frozenset[str]:
    """Paths of the meshes that should stand the other way.

    The shapes beside a mesh decide for it. Else it follows the other meshes of its format, since
    one exporter wrote them, where most agree; what its own joints and mass say comes after that.
    """
    directions = [
        (vote, path, 1 if vote.is_better != doubted[path].turned else -1)
        for vote in votes
        for path in vote.paths
    ]
    wrong = set()
    for path, record in doubted.items():
        sure = [(v.by, says) for v, named, says in directions if named == path and v.is_sure]
        alike = [says for _, named, says in directions if format_of(named) == format_of(path)]
        shown = sum(says for by, says in sure if by == SHAPE)
        most = sum(alike) if abs(sum(alike)) > AGREED * len(alike) else 0
        balance = shown or most or sum(says for _, says in sure) or sum(alike)
        if balance and (balance > 0) != record.turned:
            wrong.add(path)
    return frozenset(wrong)


def _votes(
    tree: Tree, shapes: SourceShapes, records: Mapping[str, ConvertedMesh]
) -> tuple[list[_Vote], dict[str, ConvertedMesh]]:
    """What each link says of its meshes, where it says anything clearly; and the meshes that state
    an up axis, by path."""
    by_link: dict[str, list[_Standing]] = {}
    doubted: dict[str, ConvertedMesh] = {}
    for shape in shapes.shapes:
        record = records.get(shape.name)
        standing = _standing(shape, record)
        if standing is not None:
            by_link.setdefault(shape.link, []).append(standing)
            if standing.path is not None and record is not None:
                doubted[standing.path] = record
    asked = ((body, role) for body in tree.bodies for role in get_args(Role))
    votes = (_vote(body, role, tree, by_link.get(body.name, [])) for body, role in asked)
    return [vote for vote in votes if vote is not None], doubted


def _standing(shape: SourceShape, record: ConvertedMesh | None) -> _Standing | None:
    """None for a mesh that was not converted, which is no witness."""
    geometry = shape.geometry
    path, turn = None, np.eye(3)
    if not isinstance(geometry, MeshFile):
        upper = np.array([half_height(geometry, axis) for axis in np.eye(3)])
        box = np.array([-upper, upper])
    elif record is None:
        return None
    else:
        box = np.array([record.lower, record.upper])
        if record.up_axis is not None:
            path, turn = geometry.path, np.array(TO_Z_UP[record.up_axis], dtype=np.float64)
            turn = np.diag(geometry.scale) @ (turn.T if record.turned else turn) / geometry.scale
    corners = np.array(list(itertools.product(*box.T)), dtype=np.float64)
    now, other = (shape.X_link_shape.apply(each) for each in (corners, corners @ turn.T))
    return _Standing(shape.role, path, now, other)


def _joints_at(link: str, tree: Tree) -> Array:
    """(n, 3) m: where the moving joints of a link are, in its frame; their parts meet there."""
    below = [joint.X_parent_joint.xyz for joint in tree.moving_joints if joint.parent == link]
    above = [(0.0, 0.0, 0.0) for joint in tree.moving_joints if joint.child == link]
    return np.array([*below, *above], dtype=np.float64).reshape(-1, 3)


def _vote(body: Body, role: Role, tree: Tree, shapes: Sequence[_Standing]) -> _Vote | None:
    """What a link with these shapes says of its meshes of one role; None: nothing clearly."""
    # One box for all parts of a role: collision is cut into other pieces than what is seen.
    same = [shape for shape in shapes if shape.role == role]
    paths = tuple(dict.fromkeys(shape.path for shape in same if shape.path is not None))
    if not paths:
        return None
    boxes = _around([shape.now for shape in same]), _around([shape.other for shape in same])
    size = float(np.linalg.norm(boxes[0][1] - boxes[0][0]))
    witnesses = [s.now for s in shapes if s.role != role and s.path is None]
    misfits: dict[str, list[float]] = {}
    if witnesses:
        seen = _around(witnesses)
        misfits[SHAPE] = [float(np.abs(box - seen).max()) for box in boxes]
    else:
        if body.inertial is not None and any(body.inertial.com_m):  # zero is often made up
            com = np.array([body.inertial.com_m])
            misfits["the centre of mass"] = [float(beyond_box(box, com)[0]) for box in boxes]
        joints = _joints_at(body.name, tree)
        if len(joints):
            far = [float(beyond_box(box, joints).mean()) for box in boxes]
            misfits["where its joints are"] = far
    votes = [
        _Vote(body.name, paths, now / size, other / size, by)
        for by, (now, other) in misfits.items()
        if abs(now - other) > CLEARLY * size
    ]
    if not votes or len({vote.is_better for vote in votes}) > 1:
        return None
    best = max(votes, key=lambda vote: abs(vote.now - vote.other))
    is_sure = min(best.now, best.other) < CLOSELY if witnesses else len(votes) > 1
    return replace(best, is_sure=is_sure)


def _around(points: Sequence[Array]) -> Array:
    """(2, 3) m: lower and upper corner of the box around points (n, 3)."""
    every = np.concatenate(points)
    return np.array([every.min(axis=0), every.max(axis=0)])


DEFAULT_KG_M3 = 1000.0
"""SolidWorks' density of a part without a material, water's."""
FEWEST = 2
"""A single link of that density may well be one of plastic."""
NEAR = 0.005
"""Relative: volume of the exported triangles against the CAD's own."""

DEFAULT_DENSITY = Rule(
    "inertia.default_density",
    "warning",
    "half of the links weigh 1000 kg/m³ times their visual volume, the CAD program's default",
    "`set_mass`",
)


class LintDensity(Step):
    """`links.json`, `shapes.json` and `meshes/<n>.json` of `shapes` -> findings only.

    A link counts when all its visual shapes are closed meshes.
    """

    shares = True
    own_name = "lint_density"
    shapes: tuple[str, ...] = ()
    """Names of the shapes whose meshes `meshes/0.json`, ... are."""

    def run(self, files: Files) -> Iterator[Finding]:
        """One finding for the robot, when at least half of its links have that density."""
        robot = RobotFiles(files.inputs)
        records = _records(files.inputs, self.shapes)
        densities = _densities(robot.links, robot.source_shapes, records)
        suspects = tuple(
            link
            for link, density in densities.items()
            if abs(density - DEFAULT_KG_M3) <= NEAR * DEFAULT_KG_M3
        )
        if len(suspects) >= FEWEST and 2 * len(suspects) >= len(densities):
            names = ", ".join(suspects[:6]) + (", ..." if len(suspects) > 6 else "")
            yield DEFAULT_DENSITY(
                "robot",
                f"{len(suspects)} of {len(densities)} links weigh {DEFAULT_KG_M3:g} kg/m³ times "
                f"their visual volume ({names}): the CAD's density without a material?",
                "choose the materials in the CAD, or weigh the parts: `set_mass` scales mass and "
                "inertia together",
                data={"links": suspects, "density_kg_m3": DEFAULT_KG_M3},
            )


def _densities(
    tree: Tree, shapes: SourceShapes, records: Mapping[str, ConvertedMesh]
) -> dict[str, float]:
    """kg/m3 of the links with a mass whose visual volume is known."""
    densities = {}
    for body in tree.bodies:
        visuals = [shape for shape in shapes.of("visual") if shape.link == body.name]
        volumes = [records[s.name].volume_m3 for s in visuals if s.name in records]
        known = [value for value in volumes if value]
        if body.inertial and body.inertial.mass_kg > 0.0 and visuals and len(known) == len(visuals):
            densities[body.name] = body.inertial.mass_kg / sum(known)
    return densities
