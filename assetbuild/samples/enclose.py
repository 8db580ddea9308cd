"""The ellipsoid around the geometry of each body: the room that its matter can fill."""

from __future__ import annotations

from collections.abc import Iterator
from typing import get_args

import numpy as np

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding, Rule
from assetbuild.mesh import MESH_MODULES
from assetbuild.mesh.hulls import hulls_by_body
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import matrix_of
from assetbuild.robot.model import Inertial
from assetbuild.robot.pose import vec3
from assetbuild.robot.randomize import Ellipsoid, Room, Rooms, bounding_ellipsoid
from assetbuild.robot.shapes import Role

SUSPICIOUS_GROWTH = 1.05
"""The source's own mass properties need so much more room than its geometry has: told."""

NO_ROOM = Rule(
    "randomize.room",
    "warning",
    "no mass distribution inside the geometry of a body has its mass properties; a larger "
    "ellipsoid of the same form is used",
    "check its inertia and the scale of its meshes",
)


class Enclose(Step):
    """`tree.json`, `shapes.json`, `hulls.npz` -> `rooms.json`.

    A body whose own mass properties do not fit into its geometry gets the smallest larger
    ellipsoid of that form; one without geometry that of a homogeneous ellipsoid.
    """

    outputs = ("rooms.json",)
    isolated = True
    preload = MESH_MODULES

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the hull of each mesh."""
        robot = RobotFiles(files.inputs)
        hulls = hulls_by_body(robot)
        rooms = []
        for body in robot.tree.bodies:
            inertial = body.inertial
            if inertial is None or inertial.mass_kg <= 0.0:
                continue
            by_role = [hulls.get((body.name, role), []) for role in get_args(Role)]
            around = [hull.vertices for part in by_role for hull in part]
            if not around:
                rooms.append(Room(body.name, _homogeneous(inertial)))
                continue
            bounds = bounding_ellipsoid(np.concatenate(around))
            room = bounds.grown_to_hold(inertial)
            growth = float(np.sqrt(bounds.shape[0][0] / room.shape[0][0]))
            rooms.append(Room(body.name, room))
            if growth > SUSPICIOUS_GROWTH:
                yield _too_small(body.name, growth)
        (files.outputs / "rooms.json").write_bytes(encode(Rooms(tuple(rooms))))


def _too_small(body: str, growth: float) -> Finding:
    return NO_ROOM(
        f"link {body}",
        f"the ellipsoid around its geometry must be {growth:.2f} times as large before "
        "any matter inside it can have the stated mass, centre and inertia",
        hint="check its inertia and the scale of its meshes",
        data={"growth": round(growth, 4)},
    )


def _homogeneous(inertial: Inertial) -> Ellipsoid:
    """The solid ellipsoid with this mass and inertia, as if matter filled it evenly."""
    moments, axes = np.linalg.eigh(matrix_of(inertial.inertia_com_kg_m2))
    second = np.maximum(moments.sum() / 2 - moments, 1e-12 * moments.max() + 1e-300)
    semi_squared = 5.0 * second / inertial.mass_kg
    a, b, c = (vec3(row) for row in axes @ np.diag(1.0 / semi_squared) @ axes.T)
    return Ellipsoid(inertial.com_m, (a, b, c))
