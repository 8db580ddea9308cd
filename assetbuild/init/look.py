"""The robot as the build will read it: the same steps, run on the spot.

And what it can become, and where its masses contradict its shapes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import astuple, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import get_args

import numpy as np

from assetbuild.body.lint import LintBodies, LintLinks
from assetbuild.engine.scratch import Scratch, scratch
from assetbuild.errors import StepError
from assetbuild.findings import Finding
from assetbuild.geometry.lint_meshes import meshes_to_turn
from assetbuild.init.draft import Draft, patterns_of, plain, some
from assetbuild.init.source import UrdfSource
from assetbuild.mesh.companions import companions_of
from assetbuild.mesh.hull import capped, hull_or_points
from assetbuild.mesh.hulls import extent_of
from assetbuild.mesh.material import ConvertedMesh
from assetbuild.mesh.obj import obj_bytes
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.read import Format, UpAxis, read_mesh
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.robot.chains import is_massless, split, weighs
from assetbuild.robot.codec import encode
from assetbuild.robot.contradictions import (
    FACTOR,
    Extent,
    beyond_reach,
    contradictions,
    reach_of,
    twins_apart,
)
from assetbuild.robot.inertia import move_inertial, principal_moments
from assetbuild.robot.model import Base, Joint, Tree
from assetbuild.robot.pose import Array, Pose, vec3
from assetbuild.robot.shapes import (
    Geometry,
    Mesh,
    MeshAsset,
    MeshFile,
    Shape,
    Shapes,
    SourceGeometry,
    SourceShapes,
)
from assetbuild.robot.tree import forward_kinematics, merge_fixed_joints
from assetbuild.source.urdf.joints import LIMIT_OMITTED
from assetbuild.source.urdf.read_urdf import WORLD_JOINT


@dataclass(frozen=True)
class _Outline:
    """What is kept of a shape. up_axis: of a mesh that states another one than Z."""

    hull: TriangleMesh | None = None
    up_axis: str | None = None


@dataclass(frozen=True)
class InspectedRobot:
    """links: before merging fixed joints; tree: after; link_findings, body_findings: the lints'.

    source_findings: what the reader of the source said. planar: joints of the source that are split
    into joints of one coordinate, which all formats hold. root: folder of the source's files.
    turned: paths of the meshes that the recipe turns as their files say. outlines: see `hull_of`.
    """

    links: Tree
    tree: Tree
    shapes: SourceShapes
    link_findings: tuple[Finding, ...] = ()
    body_findings: tuple[Finding, ...] = ()
    source_findings: tuple[Finding, ...] = ()
    planar: tuple[str, ...] = ()
    root: Path = Path()
    turned: frozenset[str] = frozenset()
    outlines: dict[tuple[SourceGeometry, UpAxis], _Outline] = field(
        default_factory=dict, compare=False
    )

    @property
    def unranged(self) -> tuple[str, ...]:
        """Hinges that turn by themselves and state neither end of a range."""
        names = []
        for finding in self.source_findings:
            missing, name = finding.data.get("missing", ()), finding.subject.partition(" ")[2]
            if finding.rule == LIMIT_OMITTED.id and isinstance(missing, tuple):
                joint = self.links.by_joint.get(name)
                if {"lower", "upper"} <= set(missing) and joint and joint.kind == "revolute":
                    names += [name] * (joint.mimic is None)
        return tuple(names)

    @property
    def floats(self) -> bool:
        """Whether the source itself holds its base by a floating joint."""
        return any(finding.rule == WORLD_JOINT.id for finding in self.source_findings)

    @property
    def solid_links(self) -> frozenset[str]:
        """Links with collision shapes; of a robot that has none, those with visual shapes."""
        solid = self.shapes.of("collision") or self.shapes.of("visual")
        return frozenset(shape.link for shape in solid)

    @cached_property
    def up_axes(self) -> dict[str, str]:
        """Return the up axis of each mesh that states another one than Z, by its path."""
        meshes = [s.geometry for s in self.shapes.shapes if isinstance(s.geometry, MeshFile)]
        return {mesh.path: axis for mesh in meshes if (axis := self._outline(mesh).up_axis)}

    @cached_property
    def at_zero(self) -> dict[str, Pose]:
        """Return X_root_link of every link, where all joints are 0."""
        return forward_kinematics(self.links, {})

    def axis_of(self, joint: Joint) -> Array:
        """Return the axis in the frame of the root, where all joints are 0; (3,), a unit vector."""
        axis: Array = self.at_zero[joint.child].rotation @ np.asarray(joint.axis)
        return axis

    def links_of(self, body: str) -> list[str]:
        """The links that became one body."""
        return [name for name in self.links.by_body if self.tree.placement(name)[0] == body]

    def clouds_of(self, body: str) -> Iterator[Array]:
        """(n, 3) m, in the frame of the body: all points that collide, then all that are drawn."""
        for role in ("collision", "visual"):
            clouds = []
            for shape in self.shapes.of(role):
                carrier, X_body_shape = self.tree.shape_placement(shape)
                read = read_points(self.root, shape.geometry) if carrier == body else None
                if read is not None:
                    clouds.append(X_body_shape.apply(read[0]))
            if clouds:
                yield np.concatenate(clouds)

    @cached_property
    def lowest_m(self) -> float:
        """Return the height of the lowest point at 0, m, of what collides, else of what is drawn.

        Meshes that cannot be read are left out.
        """
        clouds = {body.name: next(self.clouds_of(body.name), None) for body in self.tree.bodies}
        placed = (self.at_zero[body].apply(c) for body, c in clouds.items() if c is not None)
        return min((float(cloud[:, 2].min()) for cloud in placed), default=0.0)

    def hull_of(self, geometry: SourceGeometry, up_axis: UpAxis = "ignore") -> TriangleMesh | None:
        """Return the hull in the frame of the shape, without faces if flat, or None if unread."""
        return self._outline(geometry, up_axis).hull

    def _outline(self, geometry: SourceGeometry, up_axis: UpAxis = "ignore") -> _Outline:
        key = (geometry, up_axis)
        if key not in self.outlines:
            read = read_points(self.root, geometry, up_axis)
            self.outlines[key] = _Outline(hull_or_points(read[0]), read[1]) if read else _Outline()
        return self.outlines[key]

    def is_flat(self, geometry: SourceGeometry) -> bool:
        """Return whether the geometry can be read and spans no volume."""
        hull = self.hull_of(geometry)
        return hull is not None and not len(hull.faces)

    def extents(self, tree: Tree) -> dict[str, Extent]:
        """Return what the shapes of each body occupy, where all of them can be read.

        tree: the robot's links, or its merged bodies.
        """
        clouds: dict[str, list[Array]] = {}
        unread = set()
        for shape in self.shapes.shapes:
            body, X_body_shape = tree.shape_placement(shape)
            hull = self.hull_of(shape.geometry)
            if hull is None:
                unread.add(body)
            else:
                clouds.setdefault(body, []).append(X_body_shape.apply(hull.vertices))
        return {body: extent_of(clouds[body]) for body in clouds if body not in unread}

    def simplified(self, links: Sequence[str], ports: Scratch) -> Shapes:
        """Write the hulls to `meshes/`; shapes that are flat or cannot be read are left out.

        The shapes are those of the links that collide; a link without any is taken as it is drawn.
        """
        (ports.folder / "meshes").mkdir()
        of_links = [[shape for shape in self.shapes.shapes if shape.link == link] for link in links]
        used = (s for own in of_links for s in [s for s in own if s.role == "collision"] or own)
        shapes, assets = [], []
        for index, shape in enumerate(used):
            name, source = f"shape_{index}", shape.geometry
            geometry: Geometry
            if isinstance(source, MeshFile):
                hull = self.hull_of(source, "honour" if source.path in self.turned else "ignore")
                if hull is None or not len(hull.faces):
                    continue
                hull = capped(hull, CORNERS, None, subject=name)
                asset = MeshAsset(
                    name, f"{name}.obj", len(hull.vertices), len(hull.faces), convex=True
                )
                ports.put(f"meshes/{asset.file}", obj_bytes(hull))
                assets.append(asset)
                geometry = Mesh(asset.name)
            else:
                geometry = source
            shapes.append(Shape(name, shape.link, "collision", geometry, shape.X_link_shape))
        return Shapes(tuple(shapes), (), tuple(assets))


def look(source: UrdfSource) -> InspectedRobot:
    """Read. Raises SourceError with file and line, as a build would."""
    read, shapes, findings, _ = source.read()
    planar = tuple(joint.name for joint in read.joints if joint.kind == "planar")
    links = split(read, frozenset(planar))
    tree, _ = merge_fixed_joints(links, True, ())
    return InspectedRobot(
        links, tree, shapes, source_findings=findings, planar=planar, root=source.root
    )


def judge(robot: InspectedRobot, base: Base, kept: Collection[str] | None = None) -> InspectedRobot:
    """The robot on this base, with what the lints say of it there.

    kept: of an MJCF, links that stay bodies on their fixed joint, and the root stays the root.
    """
    links = replace(robot.links, base=base)
    tree, _ = merge_fixed_joints(links, True, kept or (), keep_root=kept is not None)
    with scratch() as ports:
        for name, value in (("links", links), ("tree", tree), ("shapes", robot.shapes)):
            ports.put(f"{name}.json", encode(value))
        of_links, of_bodies = ports.run(LintLinks()), ports.run(LintBodies())
    return replace(robot, links=links, tree=tree, link_findings=of_links, body_findings=of_bodies)


def zeroed(tree: Tree) -> list[str]:
    """Hinges of a robot that could move nothing, as all its limits are stated as 0."""
    moving = [joint for joint in tree.moving_joints if joint.mimic is None]
    stated = [value for joint in moving for value in astuple(joint.limits)]
    if any(value != 0.0 for value in stated):
        return []
    return [joint.name for joint in moving if joint.kind == "revolute"]


FORMATS: dict[str, Format] = {f".{format}": format for format in get_args(Format)}
PICTURES = (".png", ".jpg", ".jpeg")
CORNERS = 64
"""Most vertices of a simplified hull."""
LARGEST = 16 << 20
"""A mesh of more bytes is left to the build, which reads it in a process of its own."""


def read_points(
    root: Path, geometry: SourceGeometry, up_axis: UpAxis = "ignore"
) -> tuple[Array, str | None] | None:
    """Return the points that a face uses, (n, 3) m, in the frame of the shape; its up axis.

    None for a mesh that the build would refuse, or that is too large. root: the folder that the
    mesh's path starts from. The axis is that of a mesh that states another one than Z.
    """
    if not isinstance(geometry, MeshFile):
        return tessellate(geometry).vertices, None
    try:
        format, data, beside = mesh_file(root / geometry.path)
        read = read_mesh(data, format, companions=beside, up_axis=up_axis, subject=geometry.path)
    except (StepError, OSError):
        return None
    used = [part.mesh.vertices[part.mesh.is_used] for part in read.parts]
    return np.concatenate(used) * np.array(geometry.scale), read.up_axis


def mesh_file(path: Path) -> tuple[Format, bytes, dict[str, bytes]]:
    """Its format and content; those of a glTF's buffers by name, without pictures.

    OSError for a mesh that is left to the build.
    """
    format = FORMATS.get(path.suffix.lower())
    if format is None or path.stat().st_size > LARGEST:
        raise OSError(f"left to the build: {path}")
    data = path.read_bytes()
    names = companions_of(data, "gltf") if format == "gltf" else ()
    files = {name: path.parent / name for name in names if not name.lower().endswith(PICTURES)}
    return format, data, {n: file.read_bytes() for n, file in files.items() if file.is_file()}


def turned(robot: InspectedRobot) -> frozenset[str]:
    """Paths of the meshes that the recipe turns as their files say."""
    records = {}
    for shape in robot.shapes.shapes if robot.up_axes else ():
        hull = robot.hull_of(shape.geometry) if isinstance(shape.geometry, MeshFile) else None
        if hull is not None and isinstance(shape.geometry, MeshFile):
            lower, upper = vec3(hull.vertices.min(axis=0)), vec3(hull.vertices.max(axis=0))
            axis = robot.up_axes.get(shape.geometry.path)
            records[shape.name] = ConvertedMesh((), 0, lower, upper, None, axis)
    return meshes_to_turn(robot.links, robot.shapes, records) if records else frozenset()


def put_up_axis(draft: Draft, robot: InspectedRobot, turn: frozenset[str]) -> None:
    """The key `honour_up_axis`, where a mesh needs it."""
    stated = sorted(robot.up_axes)
    if turn:
        patterns = [".*"] if turn == {*stated} else patterns_of(sorted(turn), stated)
        why = f"turned as their files say: {len(turn)} of {len(stated)} meshes that state an axis "
        draft.put(patterns, "source", "honour_up_axis", beside=why + "fit their links better so")


MERGED = "`fixed_joints: {merge: true}`, and the edit `share_mass` for links without mass above it"


def usual_targets(
    robot: InspectedRobot, springs: Collection[str] = (), motion: Collection[str] = ()
) -> tuple[list[str], str]:
    """The targets that can hold the robot, and why not all of them can.

    springs: joints with one that the USD cannot hold; motion: what else it cannot, in words.
    """
    by_kind = {joint.kind: plain(joint.name) for joint in robot.tree.joints}
    if name := by_kind.get("floating"):
        why = f"joint {name} is floating, which only a base can be in MJCF and USD; "
        return ["urdf"], why + "the edit `split_joint` makes six joints of it"
    if name := by_kind.get("ball"):
        why = f"joint {name} is a ball, which MJCF alone has here; the edit `split_joint` makes "
        return ["mjcf"], why + "three hinges of it, if it never turns to 90 degrees"
    why = not_in_usd(robot)
    if springs and not why:
        why = f"it cannot hold the springs of {some(list(springs))}; see `usd.spring`"
    if motion and not why:
        why = f"it cannot hold {next(iter(motion))}; see `usd.motion`"
    if why:
        return ["urdf", "mjcf"], f"no usd: {plain(why, 160)}"
    return ["urdf", "mjcf", "usd"], ""


def not_in_usd(robot: InspectedRobot) -> str:
    """Why no articulation of PhysX is this robot, exactly; "" when one is."""
    tree, shown = robot.tree, {shape.link for shape in robot.shapes.shapes}
    for name in carried(robot):
        return f"{name} has no mass but for the bodies that fixed joints hold to it; {MERGED}"
    for joint in tree.joints:
        name = joint.child
        if joint.kind == "fixed" and name in shown and is_massless(tree.by_body[name]):
            return f"{name} has no mass, and is excluded from other pairs than {joint.parent}"
    return ""


def carried(robot: InspectedRobot) -> list[str]:
    """Moving bodies without mass, to which fixed joints hold bodies that have some."""
    tree = robot.tree
    return [
        body.name
        for body in tree.bodies
        if (tree.base == "floating" or body.name != tree.root)
        and is_massless(body)
        and weighs(tree, body.name)
    ]


def wrong_links(robot: InspectedRobot) -> dict[str, Finding]:
    """Links that make a body contradicted, where it is known which they are."""
    links, tree = robot.links, robot.tree
    by_link, by_body = robot.extents(links), robot.extents(tree)
    found = {f.subject.removeprefix("link "): f for f in contradictions(tree, by_body)}
    wrong = {*beyond_reach(links, by_link)}
    twins = twins_apart(links, by_link)
    wrong |= {each.subject.removeprefix("link ") for each in twins if each.data["sure"]}
    for body in beyond_reach(tree, by_body):
        beyond = (link for link in robot.links_of(body) if _is_beyond(robot, link, by_body[body]))
        wrong.update(beyond)
    placed = {link: tree.placement(link)[0] for link in links.by_body if link in wrong}
    return {link: found[body] for link, body in placed.items() if body in found}


def _is_beyond(robot: InspectedRobot, link: str, extent: Extent) -> bool:
    """Whether the shapes of a merged body rule out the inertia of one of its links.

    That link may have no shape of its own: a fingertip's frame with a placeholder.
    """
    inertial = robot.links.by_body[link].inertial
    if inertial is None:
        return False
    moved = move_inertial(inertial, robot.tree.placement(link)[1])
    reach = reach_of(moved, extent)
    largest = principal_moments(inertial.inertia_com_kg_m2)[-1]
    return largest > FACTOR * inertial.mass_kg * reach**2
