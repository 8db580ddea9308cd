"""Links whose mass properties are wrong, and what their mirror twin says they are."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from assetbuild.findings import Finding
from assetbuild.init.look import InspectedRobot, mesh_of, scaled_points
from assetbuild.mesh.hulls import extent_of
from assetbuild.mesh.primitives import tessellate
from assetbuild.robot.contradictions import (
    FACTOR,
    Extent,
    alike,
    beyond_reach,
    contradictions,
    twins_apart,
)
from assetbuild.robot.inertia import principal_moments, tensor_of
from assetbuild.robot.model import Inertial
from assetbuild.robot.pose import Array, vec3
from assetbuild.robot.shapes import MeshFile
from assetbuild.robot.tree import forward_kinematics

BOX = 0.05
"""Share of a shape's size by which its box may differ from the mirror image of its twin's."""


@dataclass(frozen=True)
class Weighed:
    """A robot with what its shapes occupy. root: of the source's files."""

    robot: InspectedRobot
    root: Path

    @cached_property
    def by_link(self) -> dict[str, Extent]:
        """Links with shapes that can all be read."""
        return {link: extent_of(points) for link, points in self._clouds.items() if points}

    @cached_property
    def by_body(self) -> dict[str, Extent]:
        """The same of merged bodies."""
        points: dict[str, list[Array]] = {}
        unread = {link for link, own in self._clouds.items() if not own}
        placed = {link: self.robot.tree.placement(link) for link in self._clouds}
        for link, extent in self.by_link.items():
            body, X_body_link = placed[link]
            points.setdefault(body, []).append(X_body_link.apply(extent.points))
        for link in unread:
            points.pop(placed[link][0], None)
        return {body: extent_of(own) for body, own in points.items()}

    @cached_property
    def _clouds(self) -> dict[str, list[Array]]:
        """Points by link; none of a link with a shape that cannot be read."""
        found: dict[str, list[Array | None]] = {}
        for shape in self.robot.shapes.shapes:
            points = (
                self._points_of(shape.geometry)
                if isinstance(shape.geometry, MeshFile)
                else tessellate(shape.geometry).vertices
            )
            own = found.setdefault(shape.link, [])
            own.append(None if points is None else shape.X_link_shape.apply(points))
        return {
            link: [] if any(p is None for p in own) else [p for p in own if p is not None]
            for link, own in found.items()
        }

    def _points_of(self, mesh: MeshFile) -> Array | None:
        try:
            stamp = (self.root / mesh.path).stat()
        except OSError:
            return None
        return _hull_points(self.root, mesh, (stamp.st_mtime_ns, stamp.st_size))

    def findings(self) -> tuple[Finding, ...]:
        """What a build will find contradicted."""
        return tuple(contradictions(self.robot.tree, self.by_body))

    def wrong_links(self) -> dict[str, Finding]:
        """Links that make a body contradicted, where it is known which they are."""
        links, tree = self.robot.links, self.robot.tree
        bodies = {finding.subject.removeprefix("link "): finding for finding in self.findings()}
        wrong = {*beyond_reach(links, self.by_link)}
        wrong |= {pair.wrong.name for pair in twins_apart(links, self.by_link) if pair.sure}
        beyond = beyond_reach(tree, self.by_body)
        wrong |= {link for body in beyond for link in self.robot.links_of(body)
                  if self._is_beyond(link, body)}  # fmt: skip
        placed = {link: tree.placement(link)[0] for link in links.by_body if link in wrong}
        return {link: bodies[body] for link, body in placed.items() if body in bodies}

    def _is_beyond(self, link: str, body: str) -> bool:
        """Whether the shapes of a merged body rule out the inertia of one of its links.

        That link may have no shape of its own: a fingertip's frame with a placeholder.
        """
        inertial = self.robot.links.by_body[link].inertial
        if inertial is None:
            return False
        X_body_link = self.robot.tree.placement(link)[1]
        away = self.by_body[body].points - X_body_link.apply(inertial.com_m)
        reach = float(np.linalg.norm(away, axis=1).max())
        largest = principal_moments(inertial.inertia_com_kg_m2)[-1]
        return largest > FACTOR * inertial.mass_kg * reach**2

    def from_twin(self, link: str, doubtful: Collection[str]) -> tuple[str, Inertial] | None:
        """The link's twin and the mirror image of its mass properties, in the frame of the link.

        None without a twin of the same shape that mirrors the link, or where that is doubtful, too.
        """
        for left, right, axis in alike(self.robot.links, self.by_link):
            wrong, sound = (left, right) if left.name == link else (right, left)
            usable = wrong.name == link and sound.name not in doubtful and sound.mass > 0.0
            if not usable or not self._mirrors(link, sound.name, axis):
                continue
            flip = np.eye(3)
            flip[axis, axis] = -1.0
            X_root_link = forward_kinematics(self.robot.links, {})[link]
            turn = X_root_link.rotation.T @ flip
            com = X_root_link.inverse().apply(flip @ sound.com)
            return sound.name, Inertial(
                sound.mass, vec3(com), tensor_of(turn @ sound.inertia @ turn.T)
            )
        return None

    def _mirrors(self, one: str, other: str, axis: int) -> bool:
        """Whether their shapes are mirror images where all joints are at 0."""
        if one not in self.by_link:
            return True  # neither has a shape
        poses = forward_kinematics(self.robot.links, {})
        here, there = (poses[name].apply(self.by_link[name].points) for name in (one, other))
        there[:, axis] *= -1.0
        size = float(np.ptp(here, axis=0).max())
        apart = [abs(a(here, axis=0) - a(there, axis=0)).max() for a in (np.min, np.max)]
        return bool(max(apart) <= BOX * size)


@lru_cache(maxsize=1024)
def _hull_points(root: Path, mesh: MeshFile, stamp: tuple[int, int]) -> Array | None:
    """Corners (n, 3) of a mesh's hull, m; None where it cannot be read. stamp: of its file."""
    read = mesh_of(root, mesh)
    return None if read is None else extent_of([scaled_points(read, mesh)]).points


def unmended(weighed: Weighed) -> Iterator[str]:
    """What is still contradicted after the edits, each a sentence with the edit that mends it."""
    for finding in weighed.findings():
        yield f"{finding.subject}: {finding.message} ({finding.hint})"


def keys_of(found: Inertial, own: Inertial | None) -> Mapping[str, object]:
    """Return the keys of `set_inertia`: mass and centre only if the link's own are far off."""
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    tensor = {n: float(f"{v:.9g}") for n, v in zip(names, found.inertia_com_kg_m2, strict=True)}
    moments = {name: value for name, value in tensor.items() if value or name[1] == name[2]}
    masses = sorted((found.mass_kg, own.mass_kg if own else 0.0))
    if masses[0] > 0.0 and masses[1] <= FACTOR * masses[0]:
        return {"inertia": moments}
    com = tuple(float(f"{v:.9g}") for v in found.com_m)
    return {"mass": found.mass_kg, "com": com, "inertia": moments}
