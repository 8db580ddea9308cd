"""The reader of facts of `xrdf/<robot>.xrdf`: what a planner knows beyond the URDF.

Links are those of the URDF, unmerged. Spheres that cover other collision geometry are found again:
from the robot's shapes and the meshes of the URDF beside, by the collision method `spheres`.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

from assetbuild.collision.spheres import covering_spheres
from assetbuild.errors import UsageError
from assetbuild.facts.reader import Proof, Reader
from assetbuild.facts.reference import Reference, filtered_pairs
from assetbuild.facts.table import Table, Value, Writer, pair_name
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.facts.yaml_file import read_yaml
from assetbuild.mesh.cover import Reference as Inside
from assetbuild.mesh.cover import union_of
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.shapes import Mesh, Shape, Sphere

IN_URDF = "stands in the URDF beside"
Ball = tuple[tuple[float, ...], float]
"""Centre and radius, m."""
DEFAULTS: Mapping[str, Any] = {  # Any: plain JSON, here and below
    "joints": ".*", "acceleration": None, "jerk": None, "tool_frames": [], "max_spheres": 32,
    "margin": 0.02,
}  # fmt: skip
"""Defaults of the recipe's `xrdf`, for a bundle that does not state them."""
MESHES = "xrdf meshes"
"""Among the options of a reference: the folder of the URDF's meshes."""
LISTS = {"acceleration_limits": "acceleration", "jerk_limits": "jerk"}
WORLD, SELF, SPHERES = "collision", "self_collision", "collision_spheres"


class Xrdf(Reader):
    """All facts are words of the format (`xrdf:acceleration`), of joints, links, spheres, pairs."""

    needs: ClassVar = ("xrdf", "urdf")
    form: ClassVar[str] = "xrdf"
    called: ClassVar[str] = "the XRDF"
    folder: ClassVar[str] = "xrdf"
    behind: ClassVar[tuple[str, ...]] = ("xrdf/{robot}.xrdf",)
    lacks: ClassVar[Mapping[str, str]] = {kind: IN_URDF for kind, _ in VOCABULARY}
    asks: ClassVar[tuple[str, ...]] = ("xrdf",)

    def file(self, root: Path, robot: str) -> Path | None:
        """`<robot>.xrdf`."""
        return root / f"{robot}.xrdf"

    def prove(self, reference: Reference, path: Path) -> Proof:
        """Compare the file; the URDF's meshes are needed to fit the spheres again."""
        meshes = str(path.parent.parent / "urdf/meshes")
        return super().prove(
            replace(reference, options={**reference.options, MESHES: meshes}), path
        )

    def read(self, path: Path) -> Table:
        """Joints, limits, spheres and pairs; UsageError for what is no YAML."""
        said, book = read_yaml(path), Writer()
        head = {word: said.get(word) for word in ("format", "format_version")}
        frames = tuple(said.get("tool_frames", ()))
        head |= {"tool_frames": frames} if frames else {}
        for section in (WORLD, SELF):
            head |= {f"{section} {key}": value for key, value in said.get(section, {}).items()
                     if key == "geometry"}  # fmt: skip
        _put(book, "planner", "", head)
        _read_joints(said, book)
        groups = said.get("geometry", {})
        for link, spheres in groups.get(SPHERES, {}).get("spheres", {}).items():
            for number, ball in enumerate(spheres):
                place = {"centre": tuple(ball["center"]), "radius": ball["radius"]}
                _put(book, "sphere", f"{link}/{number}", place)
        for one, others in said.get(SELF, {}).get("ignore", {}).items():
            for other in others:
                _put(book, "pair", pair_name(one, other), {"ignored": True})
        return book.plain_table()

    def expected(self, reference: Reference) -> Table:
        """From the section `xrdf` of the recipe, and the robot."""
        said = {**DEFAULTS, **(reference.options.get("xrdf") or {})}
        book = Writer()
        head: dict[str, Value] = {"format": "xrdf", "format_version": 1.0}
        if said["tool_frames"]:
            head["tool_frames"] = tuple(said["tool_frames"])
        spheres = dict(_spheres(reference, said))
        if spheres:
            head |= {f"{name} geometry": SPHERES for name in (WORLD, SELF)}
        _put(book, "planner", "", head)
        _joints(reference, said, book)
        for link, own in spheres.items():
            for number, (centre, radius) in enumerate(own):
                _put(book, "sphere", f"{link}/{number}", {"centre": centre, "radius": radius})
        for one, other in _unmet(reference, list(spheres)):
            _put(book, "pair", pair_name(one, other), {"ignored": True})
        return book.table()


def _put(book: Writer, kind: str, name: str, facts: Mapping[str, Value]) -> None:
    book.put(kind, name, {f"xrdf:{word}": value for word, value in facts.items()})


def _read_joints(said: Mapping[str, Any], book: Writer) -> None:
    """Places in the cspace, limits, default positions."""
    cspace = said.get("cspace", {})
    names = cspace.get("joint_names", [])
    for place, name in enumerate(names):
        _put(book, "joint", name, {"place": float(place)})
    for key, word in LISTS.items():
        for name, limit in zip(names, cspace[key], strict=True) if key in cspace else ():
            _put(book, "joint", name, {word: limit})
    for name, position in said.get("default_joint_positions", {}).items():
        _put(book, "joint", name, {"default": position})


# --- what the file must say -----------------------------------------------------------------


def _joints(reference: Reference, said: Mapping[str, Any], book: Writer) -> None:
    """Places in the cspace, limits, default positions; a joint that follows another has none."""
    leading = [joint for joint in reference.tree.moving_joints if joint.mimic is None]
    pose = dict(initial_pose(reference.tree, reference.control).joints)
    driven = {row.joint for row in reference.control.actuators if row.model != "passive"}
    planned = [j.name for j in leading if j.name in driven and re.fullmatch(said["joints"], j.name)]
    for joint in leading:
        _put(book, "joint", joint.name, {"default": pose[joint.name]})
    for place, name in enumerate(planned):
        _put(book, "joint", name, {"place": float(place)})
    for word in LISTS.values():
        limits = {name: _limit(said[word], name) for name in planned}
        for name, limit in limits.items():
            if None not in limits.values():
                _put(book, "joint", name, {word: limit})


def _limit(stated: Any, joint: str) -> float | None:
    if not isinstance(stated, Mapping):
        return None if stated is None else float(stated)
    rows = (float(value) for pattern, value in stated.items() if re.fullmatch(pattern, joint))
    return next(rows, None)


def _spheres(reference: Reference, said: Mapping[str, Any]) -> Iterator[tuple[str, list[Ball]]]:
    """(link, its spheres): those of its collision, or those that cover it."""
    by_link: dict[str, list[Shape]] = {}
    for shape in reference.shapes.of("collision"):
        by_link.setdefault(shape.link, []).append(shape)
    known: dict[object, list[Ball]] = {}
    for link in (body.name for body in reference.links.bodies if body.name in by_link):
        same = tuple((shape.geometry, shape.X_link_shape) for shape in by_link[link])
        if same not in known:
            own: list[Ball] = [(p.xyz, g.radius) for g, p in same if isinstance(g, Sphere)]
            known[same] = own if len(own) == len(same) else _cover(by_link[link], reference, said)
        yield link, known[same]


def _cover(shapes: list[Shape], reference: Reference, said: Mapping[str, Any]) -> list[Ball]:
    files = {mesh.name: mesh.file for mesh in reference.shapes.meshes}
    pieces = []
    for shape in shapes:
        solid = shape.geometry
        if isinstance(solid, Mesh):
            file = Path(str(reference.options.get(MESHES, ""))) / files[solid.mesh]
            try:
                corners = read_triangles(file.read_bytes(), file.name).vertices
            except OSError as error:
                message = f"cannot read `meshes/{file.name}` of the URDF: {error.strerror}"
                raise UsageError(message) from None
            pieces.append(ConvexPiece(convex_hull(shape.X_link_shape.apply(corners))))
        else:
            pieces.append(ConvexPiece(solid, shape.X_link_shape))
    inside = Inside(union_of(pieces)[1])
    found = covering_spheres(inside, said["max_spheres"], said["margin"] * inside.diagonal)
    return [(p.X_frame_piece.xyz, p.solid.radius) for p in found if isinstance(p.solid, Sphere)]


def _unmet(reference: Reference, links: list[str]) -> Iterator[tuple[str, str]]:
    """Links that never meet: their bodies are one, are filtered, or only these two's masks are."""
    tree, shapes, control = reference.tree, reference.shapes, reference.control
    filtered = {frozenset(pair) for pair in filtered_pairs(tree, shapes, control)}
    own = dict(control.contacts)
    for one, other in itertools.combinations(links, 2):
        bodies = frozenset(tree.placement(link)[0] for link in (one, other))
        sides = [
            [own.get(s.name, control.contact) for s in shapes.of("collision") if s.link == link]
            for link in (one, other)
        ]
        masked = not any(
            a.mask & b.partners or b.mask & a.partners for a, b in itertools.product(*sides)
        )
        if len(bodies) == 1 or bodies in filtered or masked:
            yield one, other
