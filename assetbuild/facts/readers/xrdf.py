"""The reader of facts of `xrdf/<robot>.xrdf`: what a planner knows beyond the URDF.

Links are those of the URDF, unmerged. Spheres that cover the collision geometry of a link stay
within it, but for the margin of the recipe.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from assetbuild.errors import UsageError
from assetbuild.facts.derived import first_match, start_of
from assetbuild.facts.reader import Proof, Reader
from assetbuild.facts.reference import Reference, filtered_pairs
from assetbuild.facts.table import Table, Value, Writer, pair_name
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.facts.plain_yaml import read_yaml
from assetbuild.mesh.obj import read_triangles
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import Box, Mesh, Shape, Sphere

IN_URDF = "stands in the URDF beside"
BALLS, WITHIN = "xrdf:spheres", "within the collision geometry"
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
        """Compare the file; the URDF's meshes are needed to see where spheres may be."""
        meshes = str(path.parent.parent / "urdf/meshes")
        options = {**reference.options, MESHES: meshes}
        return super().prove(replace(reference, options=options), path)

    def found(self, path: Path, reference: Reference) -> Table:
        """In the place of the spheres of a link, whether they are within its collision."""
        table, solid = self.read(path), _solid(reference)
        judged = {
            key: _within(value, solid[key.name], reference)
            if key.quantity == BALLS and key.name in solid
            else value
            for key, value in table.facts.items()
        }
        return replace(table, facts=judged)

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
        for link, balls in groups.get(SPHERES, {}).get("spheres", {}).items():
            flat = [number for ball in balls for number in (*ball["center"], ball["radius"])]
            book.put("link", link, {BALLS: tuple(flat)})
        for one, others in said.get(SELF, {}).get("ignore", {}).items():
            for other in others:
                _put(book, "pair", pair_name(one, other), {"ignored": True})
        return book.plain_table()

    def expected(self, reference: Reference) -> Table:
        """From the section `xrdf` of the recipe, and the robot."""
        said, solid, book = _said(reference), _solid(reference), Writer()
        head: dict[str, Value] = {"format": "xrdf", "format_version": 1.0}
        if said["tool_frames"]:
            head["tool_frames"] = tuple(said["tool_frames"])
        if solid:
            head |= {f"{name} geometry": SPHERES for name in (WORLD, SELF)}
        _put(book, "planner", "", head)
        _joints(reference, said, book)
        for link in solid:
            book.put("link", link, {BALLS: WITHIN})
        for one, other in _unmet(reference, list(solid)):
            _put(book, "pair", pair_name(one, other), {"ignored": True})
        return book.table()


def _said(reference: Reference) -> dict[str, Any]:
    return {**DEFAULTS, **(reference.options.get("xrdf") or {})}


def _solid(reference: Reference) -> dict[str, list[Shape]]:
    """Collision shapes by link, in the order of the URDF."""
    found: dict[str, list[Shape]] = {body.name: [] for body in reference.links.bodies}
    for shape in reference.shapes.of("collision"):
        found.setdefault(shape.link, []).append(shape)
    return {link: shapes for link, shapes in found.items() if shapes}


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
    pose = dict(start_of(reference.tree, reference.control).joints)
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
    found = first_match(stated, joint) if isinstance(stated, Mapping) else stated
    return None if found is None else float(found)


def _within(stated: Value, shapes: list[Shape], reference: Reference) -> Value:
    """WITHIN where all spheres, and no more than may be, lie in the box around the collision."""
    said = _said(reference)
    balls: Array = np.reshape(np.asarray(stated, dtype=np.float64), (-1, 4))
    corners = np.concatenate([_corners(shape, reference) for shape in shapes])
    low, high = corners.min(axis=0), corners.max(axis=0)
    out = said["margin"] * float(np.linalg.norm(high - low)) + 1e-6
    centres, radii = balls[:, :3], balls[:, 3:]
    inside = (centres - radii >= low - out) & (centres + radii <= high + out)
    is_some = 0 < len(balls) <= max(said["max_spheres"], len(shapes))
    return WITHIN if is_some and bool(inside.all()) else stated


def _corners(shape: Shape, reference: Reference) -> Array:
    """(n, 3) m in the link; of a round shape the corners of the box around it."""
    solid = shape.geometry
    if isinstance(solid, Mesh):
        file = next(mesh.file for mesh in reference.shapes.meshes if mesh.name == solid.mesh)
        path = Path(str(reference.options.get(MESHES, ""))) / file
        try:
            return shape.X_link_shape.apply(read_triangles(path.read_bytes(), file).vertices)
        except OSError as error:
            message = f"cannot read `meshes/{file}` of the URDF: {error.strerror}"
            raise UsageError(message) from None
    if isinstance(solid, Box):
        half = np.asarray(solid.size) / 2.0
    else:
        height = 0.0 if isinstance(solid, Sphere) else solid.length / 2.0
        half = np.array((solid.radius, solid.radius, height + solid.radius))
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    return shape.X_link_shape.apply(signs * half)


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
