"""What a recipe says about the XRDF, and the spheres of each link: its own, or those that cover its
collision geometry."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from assetbuild.collision.spheres import covering_spheres
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.mesh.cover import Reference, union_of
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.quality import sobol
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.recipe_types import Model, Pattern, Positive, Share
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.pose import Array, Pose
from assetbuild.robot.shapes import Mesh, Shape, Sphere
from assetbuild.robot.tree import forward_kinematics

LimitTable = dict[Pattern, Positive]


class XrdfOptions(Model):
    """What only a planner asks for: `xrdf/<robot>.xrdf`."""

    joints: Pattern = Field(
        ".*",
        description="driven joints that a planner moves; it holds all others, such as a gripper's, "
        "at their default positions",
    )
    acceleration: Positive | LimitTable | None = Field(
        None,
        description="rad/s2 or m/s2: one number, or one for each pattern of joints, of which the "
        "first that matches wins; planners require it",
    )
    jerk: Positive | LimitTable | None = Field(
        None, description="rad/s3 or m/s3, likewise; planners require it"
    )
    tool_frames: tuple[str, ...] = Field(
        (), max_length=100, description="links that a planner moves to a goal; it requires one"
    )
    max_spheres: int = Field(32, ge=1, le=1024, description="most spheres of a link")
    margin: Share = Field(
        0.02,
        le=0.5,
        description="how far a sphere may stick out of a link's collision geometry, share of its "
        "size",
    )
    min_coverage: Share = Field(
        0.9, le=1, description="share of a link's collision volume below which a warning is given"
    )


SPHERES = Rule(
    "xrdf.spheres",
    ("info", "warning"),
    "how well a planner's spheres cover the collision geometry of a link (warning: less of its "
    "volume than `xrdf.min_coverage`)",
    "raise `xrdf.max_spheres`, or `xrdf.margin`, the distance by which a sphere may stick out",
)
OVERLAP = Rule(
    "xrdf.overlap",
    "warning",
    "spheres of two links overlap where every joint is at its default position, so that a planner "
    "refuses to start there",
    "exclude the pair from collision (`collision.exclude.pairs`), or lower `xrdf.margin`",
)

POINTS = 2**14
"""Points that tell the covered share: 1 sigma is below 0.5 %."""


@dataclass(frozen=True)
class Covered:
    """The spheres of one link, in its frame. coverage: share of the collision volume.

    outside_m: most that they stick out; exact: they are the collision geometry itself.
    """

    name: str
    spheres: tuple[tuple[Pose, Sphere], ...]
    coverage: float
    outside_m: float
    exact: bool

    def finding(self, options: XrdfOptions) -> Finding:
        """How good they are."""
        count = len(self.spheres)
        data = {"coverage": self.coverage, "outside_m": self.outside_m, "spheres": count}
        if self.exact:
            message = f"its collision is {count} spheres, which the XRDF has as they are"
            return SPHERES(f"link {self.name}", message, data=data)
        short = self.coverage < options.min_coverage
        return SPHERES(
            f"link {self.name}",
            f"{count} spheres cover {100 * self.coverage:.3g} % of its collision volume"
            + f", below {100 * options.min_coverage:.3g} %" * short
            + f"; they stick out by at most {1000 * self.outside_m:.3g} mm",
            hint="raise `xrdf.max_spheres` or `xrdf.margin`" if short else "",
            severity="warning" if short else "info",
            data=data,
        )


def covers_of(robot: RobotFiles, options: XrdfOptions) -> Iterator[Covered]:
    """One for each link with collision, in the order of the URDF; of equal ones found once."""
    known: dict[object, Covered] = {}
    for body in robot.links.bodies:
        shapes = tuple(s for s in robot.shapes.of("collision") if s.link == body.name)
        same = tuple((shape.X_link_shape, shape.geometry) for shape in shapes)
        if same and same not in known:
            pieces = list(_pieces(shapes, robot))
            known[same] = _covered(body.name, pieces, options)
        if same:
            yield replace(known[same], name=body.name)


def _covered(link: str, pieces: list[ConvexPiece], options: XrdfOptions) -> Covered:
    """Spheres as they are; else those that cover the union of all pieces."""
    exact_spheres = tuple((p.X_frame_piece, p.solid) for p in pieces if isinstance(p.solid, Sphere))
    if len(exact_spheres) == len(pieces):
        return Covered(link, exact_spheres, 1.0, 0.0, True)
    _, skin = union_of(pieces)
    reference = Reference(skin)
    cover = covering_spheres(reference, options.max_spheres, options.margin * reference.diagonal)
    spheres = tuple(
        (piece.X_frame_piece, piece.solid) for piece in cover if isinstance(piece.solid, Sphere)
    )
    centres = np.array([pose.xyz for pose, _ in spheres])
    radii = np.array([sphere.radius for _, sphere in spheres])
    # A ball as large as the depth of its centre lies inside: the rest of the radius sticks out.
    depth = reference.surface.distance(centres)
    depth = np.where(reference.solid.contains(centres), depth, -depth)
    outside = max(float((radii - depth).max()), 0.0)
    return Covered(link, spheres, _share_within(reference, centres, radii), outside, False)


def _share_within(reference: Reference, centres: Array, radii: Array) -> float:
    """Share of the inside of a mesh that lies in spheres, of other points than they were chosen by.

    centres: (n, 3) m; radii: (n,) m.
    """
    from scipy.spatial.distance import cdist

    cloud = sobol(POINTS, *reference.mesh.bounds, seed=1)
    inside = cloud[reference.solid.contains(cloud)]
    return float((cdist(inside, centres) <= radii).any(axis=1).mean())


def _pieces(shapes: tuple[Shape, ...], robot: RobotFiles) -> Iterator[ConvexPiece]:
    """Shapes of one link in its frame."""
    assets = {asset.name: asset for asset in robot.shapes.meshes}
    for shape in shapes:
        if not isinstance(shape.geometry, Mesh):
            yield ConvexPiece(shape.geometry, shape.X_link_shape)
            continue
        asset = assets[shape.geometry.mesh]
        if not asset.convex:
            raise StepError(
                f"link `{shape.link}`: its collision mesh `{shape.name}` is not known to be "
                "convex, and spheres are fitted to convex pieces",
                hint=f"`collision: {{links: {{{shape.link}: {{method: auto}}}}}}`, or another "
                "method that makes hulls",
            )
        mesh = read_triangles((robot.mesh_dir / asset.file).read_bytes(), f"mesh {asset.name}")
        yield ConvexPiece(convex_hull(mesh.placed(shape.X_link_shape).vertices))


def overlaps(
    covers: Mapping[str, Covered], ignored: dict[str, list[str]], robot: RobotFiles
) -> Iterator[Finding]:
    """Pairs whose spheres overlap in the default positions, though a planner looks at them."""
    X_root_link = forward_kinematics(
        robot.links, dict(initial_pose(robot.tree, robot.control).joints)
    )
    placed = {
        link: (
            X_root_link[link].apply([pose.xyz for pose, _ in cover.spheres]),
            np.array([sphere.radius for _, sphere in cover.spheres]),
        )
        for link, cover in covers.items()
    }
    for one, other in itertools.combinations(covers, 2):
        (a, r), (b, s) = placed[one], placed[other]
        apart = float((np.linalg.norm(a[:, None] - b, axis=2) - r[:, None] - s).min())
        if apart < 0.0 and other not in ignored.get(one, ()):
            yield OVERLAP(
                f"link {one}",
                f"its spheres overlap those of `{other}` by {-1000 * apart:.3g} mm in the default "
                "joint positions, and the pair is not filtered",
                hint=f"`collision: {{exclude: {{pairs: [[{one}, {other}]]}}}}` where they cannot "
                "meet, or a smaller `xrdf.margin`",
                data={"other": other, "overlap_m": -apart},
            )
