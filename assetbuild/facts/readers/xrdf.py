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
from assetbuild.facts.plain_yaml import read_yaml
from assetbuild.facts.reader import Proof, Reader
from assetbuild.facts.reference import Reference, filtered_pairs, size_of
from assetbuild.facts.table import Table, Value, Writer, pair_name
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.mesh.obj import read_triangles
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import Box, Mesh, Shape

BALLS, WITHIN = "xrdf:spheres", "within the collision geometry"
DEFAULTS: Mapping[str, Any] = {  # Any: plain JSON, here and below
    "joints": ".*", "acceleration": None, "jerk": None, "tool_frames": [], "max_spheres": 32,
    "margin": 0.02,
}  # fmt: skip
"""Defaults of the recipe's `xrdf`, for a bundle that does not state them."""
LIMITS = ("acceleration", "jerk")
GEOMETRIES, GROUP = ("collision", "self_collision"), "collision_spheres"
MESHES = "xrdf meshes"
"""Among the options of a reference: the folder of the URDF's meshes."""


class Xrdf(Reader):
    """All facts are words of the format (`xrdf:acceleration`), of joints, links, spheres, pairs."""

    needs: ClassVar = ("xrdf", "urdf")
    form: ClassVar[str] = "xrdf"
    called: ClassVar[str] = "the XRDF"
    folder: ClassVar[str] = "xrdf"
    behind: ClassVar[tuple[str, ...]] = ("xrdf/{robot}.xrdf",)
    lacks: ClassVar[Mapping[str, str]] = {
        kind: "stands in the URDF beside" for kind, _ in VOCABULARY
    }
    asks: ClassVar[tuple[str, ...]] = ("xrdf",)

    def file(self, root: Path, robot: str) -> Path | None:
        """`<robot>.xrdf`."""
        return root / f"{robot}.xrdf"

    def prove(self, reference: Reference, path: Path) -> Proof:
        """Compare the file; the URDF's meshes are needed to see where spheres may be."""
        options = {**reference.options, MESHES: path.parent.parent / "urdf/meshes"}
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
        words = {f"xrdf:{word}": said.get(word) for word in ("format", "format_version")}
        words["xrdf:tool_frames"] = said.get("tool_frames")
        words |= {f"xrdf:{name}": said.get(name, {}).get("geometry") for name in GEOMETRIES}
        book.put("planner", "", words)
        cspace = said.get("cspace", {})
        names = cspace.get("joint_names", [])
        for place, name in enumerate(names):
            book.put("joint", name, {"xrdf:place": float(place)})
        for word in LIMITS:
            for name, limit in zip(names, cspace.get(f"{word}_limits", ()), strict=False):
                book.put("joint", name, {f"xrdf:{word}": limit})
        for name, position in said.get("default_joint_positions", {}).items():
            book.put("joint", name, {"xrdf:default": position})
        for link, balls in said.get("geometry", {}).get(GROUP, {}).get("spheres", {}).items():
            flat = [number for ball in balls for number in (*ball["center"], ball["radius"])]
            book.put("link", link, {BALLS: tuple(flat)})
        for one, others in said.get("self_collision", {}).get("ignore", {}).items():
            for other in others:
                book.put("pair", pair_name(one, other), {"xrdf:ignored": True})
        return book.plain_table()

    def expected(self, reference: Reference) -> Table:
        """From the section `xrdf` of the recipe, and the robot."""
        said, solid, book = _said(reference), _solid(reference), Writer()
        words: dict[str, Value] = {"xrdf:format": "xrdf", "xrdf:format_version": 1.0}
        words["xrdf:tool_frames"] = tuple(said["tool_frames"]) or None
        words |= {f"xrdf:{name}": GROUP if solid else None for name in GEOMETRIES}
        book.put("planner", "", words)
        for name, facts in _joints(reference, said):
            book.put("joint", name, facts)
        for link in solid:
            book.put("link", link, {BALLS: WITHIN})
        pairs = filtered_pairs(reference.tree, reference.shapes, reference.control, of_links=True)
        for one, other in pairs:
            book.put("pair", pair_name(one, other), {"xrdf:ignored": True})
        return book.table()


def _said(reference: Reference) -> dict[str, Any]:
    return {**DEFAULTS, **(reference.options.get("xrdf") or {})}


def _solid(reference: Reference) -> dict[str, list[Shape]]:
    """Collision shapes by link."""
    found: dict[str, list[Shape]] = {}
    for shape in reference.shapes.of("collision"):
        found.setdefault(shape.link, []).append(shape)
    return found


def _joints(
    reference: Reference, said: Mapping[str, Any]
) -> Iterator[tuple[str, dict[str, Value]]]:
    """Places in the cspace, limits, default positions; a joint that follows another has none."""
    leading = [joint.name for joint in reference.tree.moving_joints if joint.mimic is None]
    pose = dict(start_of(reference.tree, reference.control).joints)
    driven = {row.joint for row in reference.control.actuators if row.model != "passive"}
    planned = [name for name in leading if name in driven and re.fullmatch(said["joints"], name)]
    for name in leading:
        yield name, {"xrdf:default": pose[name]}
    for place, name in enumerate(planned):
        yield name, {"xrdf:place": float(place)}
    for word in LIMITS:
        table = said[word] if isinstance(said[word], Mapping) else {".*": said[word]}
        limits = [first_match(table, name) for name in planned]
        numbers = [float(limit) for limit in limits if limit is not None]
        if len(numbers) == len(planned):
            for name, number in zip(planned, numbers, strict=True):
                yield name, {f"xrdf:{word}": number}


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
        try:
            data = (reference.options[MESHES] / file).read_bytes()
        except OSError as error:
            message = f"cannot read `meshes/{file}` of the URDF: {error.strerror}"
            raise UsageError(message) from None
        return shape.X_link_shape.apply(read_triangles(data, file).vertices)
    edges = size_of(solid)
    if not isinstance(solid, Box):
        width = 2.0 * edges[0]
        edges = (width, width, width + sum(edges[1:]))
    half = np.asarray(edges) / 2.0
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    return shape.X_link_shape.apply(signs * half)
