"""Could the body be made of matter of its shape? Density, centre and axes against the geometry.

The reference is the convex hull of a body's visual geometry (of its collision geometry where it
has no other), filled evenly. Real parts are hollow or heavy at one end, so only what no part can
explain is reported: a slip of a factor of ten, a tensor in other axes, a centre outside of the
part, and what `robot.contradictions` finds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.mesh import MESH_MODULES
from assetbuild.mesh.hulls import common_hull, extent_of, hulls_by_body
from assetbuild.mesh.triangles import TriangleMesh, solid_moments
from assetbuild.plugin_types import Check, write_figures
from assetbuild.recipe_types import Positive
from assetbuild.robot.contradictions import Extent, contradictions
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import matrix_of
from assetbuild.robot.model import Body, Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import Role

NEGLIGIBLE = 0.01
"""Share of the robot's mass below which a strange density is no more than information."""
SMALLEST_KG = 0.01
"""Lighter bodies are screws and sensors: nobody measures them."""
OUTSIDE = 0.1
"""Share of a body's size by which its centre of mass may lie outside of its geometry."""
SLENDER = 2.5
"""Middle over least principal moment, of body and of hull, from which an axis is meant."""
HEAVIEST_KG = 20e3
"""The strongest arm in series production, Fanuc's M-2000iA, weighs 12.5 t as a whole."""
LONGEST_M = 20.0
"""The longest arm of all, Canadarm2, is 17.6 m as a whole."""
LEAST_KG_M3, MOST_KG_M3 = 5.0, 68e3
"""Half of the lightest foam, three times osmium: masses of a robot outside are off by a hundred.
The bodies of 265 public robots together have 60 to 3,700 kg/m3 of their hulls."""
BROKEN = 5.0
"""Times the tolerance of the total mass that is no tolerance any more."""

TOTAL = Rule(
    "mass.total",
    ("warning", "error"),
    "the robot's mass differs from its datasheet (an error above five tolerances)",
    "look for a body with too little or too much below; `edits: set_mass`",
)
DENSITY = Rule(
    "mass.density",
    ("warning", "info"),
    "a body is far lighter or heavier than matter of its size",
    "is the mass ten times too large or small, or the mesh in other units?",
)
CENTER = Rule(
    "mass.center",
    "warning",
    "a centre of mass is outside the geometry of its body",
    "was it given in another frame? `edits: set_inertia` corrects it",
)
AXES = Rule(
    "mass.axes",
    "warning",
    "the mass is long where the geometry is short",
    "is the tensor given in the link's axes? `edits: set_inertia` corrects it",
)
ABSURD = Rule(
    "mass.absurd",
    "error",
    "a body weighs more than 20 t, or the whole robot is lighter than foam or heavier than metal",
    "state the masses: `edits: set_mass`; check the units of the mesh from which they come",
)
SIZE = Rule(
    "mass.size",
    "error",
    "a body that moves is longer than 20 m, which no robot's body is",
    'are its lengths in millimetres? A mesh takes `scale="0.001 0.001 0.001"`',
)


Hulls = Mapping[tuple[str, Role], TriangleMesh]
"""(body, role) -> the convex hull of all its shapes; of flat ones their vertices, without faces."""


@dataclass(frozen=True)
class Filled:
    """A body and the hull of what is seen of it, else of what collides.

    outside_m: centre of mass beyond the hull's box; angle_rad: between the long axes of both.
    """

    mass_kg: float
    volume_m3: float
    outside_m: float
    size_m: float
    angle_rad: float | None

    @property
    def density(self) -> float:
        """kg/m3"""
        return self.mass_kg / self.volume_m3


class Mass(Check):
    """Findings `mass.<what>`: of the robot's total and of each body against its geometry."""

    shares = True
    usual_s = 0.5
    isolated = True
    preload = MESH_MODULES
    reads = ("tree.json", "shapes.json", "hulls.npz")

    section = "validate.mass"
    about = "masses against what is known of the robot and of matter"
    recipe_fields: ClassVar = {"absent": "source.missing.visuals"}

    total_kg: Positive | None = Field(
        None, description="kg, of the whole robot from its datasheet; null = not known"
    )
    tolerance: Positive = Field(
        0.03, description="relative, of the total mass; a warning, five times more is an error"
    )
    density: tuple[Positive, Positive] = Field(
        (30.0, 5000.0),
        description="kg/m3: least and most of a body's mass over the volume of its hull, warning",
    )
    max_angle: float = math.radians(50.0)
    """Between the long axes of body and hull."""
    absent: tuple[str, ...] | None = None
    """Meshes that the source names and does not bring: no hull shows how large those are."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads tree, shapes and hulls."""
        robot = RobotFiles(files.inputs)
        tree, unknown = robot.tree, set[str]()
        if self.absent:  # bodies with a link that collides and is not drawn
            drawn, solid = ({s.link for s in robot.shapes.of(r)} for r in ("visual", "collision"))
            unknown = {tree.placement(link)[0] for link in solid - drawn}
        parts = hulls_by_body(robot)
        hulls = {key: common_hull(parts[key]) for key in parts if key[0] not in unknown}
        every = {b.name: made for b in tree.bodies if (made := _filled(b, hulls)) is not None}
        total = math.fsum(b.inertial.mass_kg for b in tree.bodies if b.inertial)
        bodies = {name: row for name, row in every.items() if row.mass_kg >= SMALLEST_KG}
        rows = [
            {"body": name, "mass_kg": row.mass_kg, "hull_volume_m3": row.volume_m3,
             "density_kg_m3": row.density, "center_outside_m": row.outside_m,
             "long_axes_apart_rad": row.angle_rad}
            for name, row in bodies.items()
        ]  # fmt: skip
        figures = {"total_kg": total, "datasheet_kg": self.total_kg, "bodies": rows}
        smallest_m = min((row.size_m for row in bodies.values()), default=1.0)
        limits = {"long_axes_apart_rad": self.max_angle, "center_outside_m": OUTSIDE * smallest_m}
        write_figures(files, figures, limits)
        points: dict[str, list[Array]] = {}  # of all that is drawn and all that collides
        for (name, _), hull in hulls.items():
            points.setdefault(name, []).append(hull.vertices)
        extents = {name: extent_of(vertices) for name, vertices in points.items()}
        error = abs(total - self.total_kg) / self.total_kg if self.total_kg is not None else 0.0
        if error > self.tolerance:
            yield TOTAL(
                "robot",
                f"the robot has {total:.4g} kg, its datasheet says {self.total_kg:.4g} kg",
                severity="error" if error > BROKEN * self.tolerance else "warning",
                data={"total_kg": total, "datasheet_kg": self.total_kg, "relative": error},
            )
        yield from _too_large(tree, extents)
        yield from _of_no_matter(tree, every)
        for name, row in bodies.items():
            yield from self._judge(name, row, total)
        yield from _outside(bodies)
        yield from contradictions(tree, extents)

    def _judge(self, name: str, row: Filled, total_kg: float) -> Iterator[Finding]:
        if not self.density[0] <= row.density <= self.density[1]:
            yield DENSITY(
                f"link {name}",
                f"{row.mass_kg:.4g} kg in a hull of {1e3 * row.volume_m3:.3g} litres: "
                f"{row.density:.4g} kg/m³",
                severity="info" if row.mass_kg < NEGLIGIBLE * total_kg else "warning",
                data={"density_kg_m3": row.density, "mass_kg": row.mass_kg},
            )
        if row.angle_rad is not None and row.angle_rad > self.max_angle:
            yield AXES(
                f"link {name}",
                f"the longest axis of the mass is {math.degrees(row.angle_rad):.0f} degrees away "
                "from that of the geometry",
                data={"angle_rad": row.angle_rad},
            )


def _outside(bodies: Mapping[str, Filled]) -> Iterator[Finding]:
    """Centres of mass outside; bodies that are as far off share a finding, as they do a mistake."""
    alike: dict[str, list[str]] = {}
    for name, row in bodies.items():
        if row.outside_m > OUTSIDE * row.size_m:
            alike.setdefault(f"{row.outside_m:.0e}", []).append(name)
    for name, *others in alike.values():
        row = bodies[name]
        far = (f"{other} ({1e3 * bodies[other].outside_m:.3g} mm)" for other in others)
        also = f"; so are those of {', '.join(far)}" if others else ""
        yield CENTER(
            f"link {name}",
            f"the centre of mass is {1e3 * row.outside_m:.3g} mm outside of the geometry{also}",
            data={"outside_m": row.outside_m, "size_m": row.size_m},
        )


def _too_large(tree: Tree, extents: Mapping[str, Extent]) -> Iterator[Finding]:
    """Units or densities off by a hundred; the bolted root may be a hall or a field."""
    for body in tree.bodies:
        mass = body.inertial.mass_kg if body.inertial else 0.0
        if mass > HEAVIEST_KG:
            yield ABSURD(
                f"link {body.name}",
                f"weighs {mass:.4g} kg, more than any robot's body (limit {HEAVIEST_KG:g} kg)",
                hint="was its mass worked out from a mesh in other units? `edits: set_mass`",
                data={"mass_kg": mass, "limit_kg": HEAVIEST_KG},
            )
    for body in _loose_bodies(tree):
        extent = extents.get(body.name)
        size = float(np.ptp(extent.points, axis=0).max()) if extent else 0.0
        if size > LONGEST_M:
            yield SIZE(
                f"link {body.name}",
                f"is {size:.4g} m long, more than any robot's body (limit {LONGEST_M:g} m)",
                data={"size_m": size, "limit_m": LONGEST_M},
            )


def _of_no_matter(tree: Tree, bodies: Mapping[str, Filled]) -> Iterator[Finding]:
    """Report masses or lengths off by a hundred: of all bodies together, no mean of matter."""
    loose = _loose_bodies(tree)
    shaped = [bodies[body.name] for body in loose if body.name in bodies]
    whole_kg = math.fsum(body.inertial.mass_kg for body in loose if body.inertial)
    shaped_kg = math.fsum(row.mass_kg for row in shaped)
    volume_m3 = math.fsum(row.volume_m3 for row in shaped)
    for mass_kg, limit, wrong, comparison, hint in (
        (whole_kg, LEAST_KG_M3, 0.0 < whole_kg < LEAST_KG_M3 * volume_m3,
         "lighter than foam", "are the masses placeholders?"),
        (shaped_kg, MOST_KG_M3, shaped_kg > MOST_KG_M3 * volume_m3,
         "heavier than any metal", "are the shapes or the masses in other units?"),
    ):  # fmt: skip
        if wrong:
            yield ABSURD(
                "robot",
                f"its moving bodies weigh {mass_kg:.4g} kg in hulls of {1e3 * volume_m3:.4g} "
                f"litres, {mass_kg / volume_m3:.3g} kg/m³: {comparison} (limit {limit:g} kg/m³)",
                hint=f"{hint} State masses by `edits: set_mass`, a mesh's size by its `scale`",
                data={"mass_kg": mass_kg, "volume_m3": volume_m3, "limit_kg_m3": limit},
            )


def _loose_bodies(tree: Tree) -> list[Body]:
    """Return all bodies but the bolted root, which many files give no mass or a whole hall."""
    return [b for b in tree.bodies if tree.base == "floating" or b.name != tree.root]


def _filled(body: Body, hulls: Hulls) -> Filled | None:
    """None for what has no volume."""
    hull = hulls.get((body.name, "visual")) or hulls.get((body.name, "collision"))
    if hull is None or not len(hull.faces):
        return None
    volume, _, even = solid_moments(hull)
    if not volume > 0.0:
        return None
    lower, upper = hull.bounds
    size_m, inertial = float(np.linalg.norm(upper - lower)), body.inertial
    if inertial is None:
        return Filled(0.0, volume, 0.0, size_m, None)
    com = np.asarray(inertial.com_m)
    beyond = np.maximum(np.maximum(lower - com, com - upper), 0.0)
    angle = _angle(matrix_of(inertial.inertia_com_kg_m2), even)
    return Filled(inertial.mass_kg, volume, float(np.linalg.norm(beyond)), size_m, angle)


def _angle(stated: Array, even: Array) -> float | None:
    """The angle between the axes of least moment; None where one has no long direction."""
    axes = []
    for tensor in (stated, even):
        moments, vectors = np.linalg.eigh(tensor)
        if not moments[0] > 0.0 or moments[1] < SLENDER * moments[0]:
            return None
        axes.append(vectors[:, 0])
    return math.acos(min(1.0, abs(float(axes[0] @ axes[1]))))
