"""What a body's mass properties must satisfy; one set of rules for links and merged bodies.

Per body the first broken rule of the chain mass, positive, triangle, pseudo is reported, since each
implies the next; size, density and smallness are judged besides.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

from assetbuild.findings import Finding, Rule, Scalar, Severity, steady
from assetbuild.robot.chains import Chain, find_chains, is_massless, weighs
from assetbuild.robot.inertia import (
    LEAST_MOMENT_KG_M2,
    TRIANGLE_ROUNDING,
    InertiaBounds,
    equivalent_radius,
    principal_moments,
    triangle_violation,
)
from assetbuild.robot.model import Inertial, Tree
from assetbuild.robot.pose import Vec3
from assetbuild.robot.shapes import Shapes, SourceShapes

ROUNDING = 1e-9
"""Relative: smaller violations are the noise of turning a tensor into other axes."""

SINGULAR = 1e-12
"""Relative: a least principal moment below this is a zero that rounding made positive."""

MISSING = Rule(
    "inertia.missing",
    ("warning", "error"),
    "a moving link has no inertial (an error on the bodies that will be simulated)",
    "give it one",
)
BETWEEN = Rule(
    "inertia.massless_intermediate_link",
    "info",
    "a massless link between two joints: in MJCF one body has several joints",
    "the edit `share_mass` moves a little mass here",
)
MASS = Rule(
    "inertia.mass",
    ("error", "warning"),
    "the mass is not positive (a warning in the source)",
    "give it its real one: edit `set_mass`, or `inertia_from_geometry` with a density",
)
POSITIVE = Rule(
    "inertia.positive",
    ("error", "warning", "info"),
    "a principal moment is not positive (a warning in the source; info there for a link below 1 g, "
    "and for a point mass that never moves alone)",
    "a dummy, or a wrong sign? `edits: inertia_from_geometry` replaces it",
)
TRIANGLE = Rule(
    "inertia.triangle",
    ("error", "warning"),
    "a principal moment exceeds the sum of the others, which MuJoCo refuses (a warning in the "
    "source, and up to 1 %)",
    "check whether the tensor was taken about the centre of mass",
)
PSEUDO = Rule(
    "inertia.pseudo",
    ("warning", "info"),
    "all of the mass lies in a plane (info in the source)",
    "a real part has thickness; randomised or identified masses can turn invalid",
)
RADIUS = Rule(
    "inertia.radius",
    ("warning", "info"),
    "the inertia is that of a ball of more than 0.5 m radius: much for the mass, though every "
    "simulator takes it",
    "are the units kg m² (not kg mm² or g cm²), and the tensor about the centre of mass?",
)
DENSE = Rule(
    "inertia.dense",
    ("warning", "info", "error"),
    "the inertia is less than that of the densest matter (an error where MuJoCo refuses it: "
    "under 1e-15 kg m²)",
    "is it a dummy value? `inertia_from_geometry` computes it from the shapes",
)
MASS_SMALL = Rule(
    "inertia.mass_small",
    ("warning", "info"),
    "a moving body weighs less than 1 g (info in the source, and where an edit gave it that mass)",
    "merge it into a neighbour, or give it its real mass",
)


def inertia_findings(
    tree: Tree,
    shapes: Shapes | SourceShapes,
    bounds: InertiaBounds,
    worst: Severity,
    made: Collection[str] = (),
) -> Iterator[Finding]:
    """Findings on all bodies of a tree, none graver than `worst`.

    made: links that were massless or not there before the edits, which are meant to weigh little.

    What a fixed joint carries may lack mass: before merging it is a frame in all but name and
    nothing is said, afterwards it was kept as a body and some engines would invent a mass. So may
    what moves, when fixed joints hold bodies to it that weigh.
    A massless link between two joints is no mistake: see `robot.chains`.
    """
    chains = find_chains(tree, {shape.link for shape in shapes.shapes})
    between = {link: chain for chain in chains for link in chain.between}
    shaped = {tree.placement(shape.link)[0] for shape in shapes.shapes}
    driven = {joint.child for joint in tree.joints if joint.kind != "fixed"}
    if tree.base == "floating":
        driven.add(tree.root)
    for body in tree.bodies:
        subject = f"link {body.name}"
        mass = body.inertial.mass_kg if body.inertial else 0.0
        if body.name in between:
            yield _between(subject, between[body.name])
        elif (body.name not in driven and mass <= 0.0) or (
            is_massless(body) and weighs(tree, body.name)
        ):
            if worst == "error" and body.name != tree.root:
                message = "it is kept as a body but has no mass; some engines invent one"
                hint = "let it be merged, or give it a small mass and inertia"
                yield MISSING(subject, message, hint)
        elif body.inertial is None:
            message = "it moves but has no <inertial>: no simulator can accelerate it"
            hint = "give it a mass: edit `inertia_from_geometry`, or `set_inertia`"
            yield MISSING(subject, message, hint, severity=worst)
        else:
            for finding in MassProperties(subject, body.inertial, bounds, worst).findings():
                kept = _of_this(finding, moves=body.name in driven, shows=body.name in shaped)
                if kept:
                    yield _of_edit(kept) if body.name in made else kept


def _of_this(finding: Finding, *, moves: bool, shows: bool) -> Finding | None:
    """The severity that fits a body which moves or not, and has a shape or not."""
    if finding.rule == DENSE.id and not shows and finding.severity != "error":
        return replace(finding, severity="info")  # it has no size to doubt
    if moves:
        return finding
    if finding.rule == RADIUS.id:  # what never turns may be as lazy as it likes
        return replace(finding, severity=_below(finding.severity))
    if finding.severity == "warning" and finding.data.get("principal_kg_m2") == (0.0, 0.0, 0.0):
        message = "no inertia of its own: a point mass, which is exact once it is merged"
        return replace(finding, severity="info", message=message, hint="")
    return finding if finding.rule != MASS_SMALL.id else None


def _of_edit(finding: Finding) -> Finding:
    if finding.rule != MASS_SMALL.id:
        return finding
    message = f"{finding.message}: an edit gave the link this mass"
    return replace(finding, severity="info", message=message, hint="")


def _between(subject: str, chain: Chain) -> Finding:
    joints = tuple(joint.name for joint in chain.joints)
    return BETWEEN(
        subject,
        f"a massless link between the joints of `{chain.body}` ({', '.join(joints)}): "
        "exact in URDF and MJCF, but PhysX wants mass on every body",
        data={"joints": joints, "body": chain.body},
    )


@dataclass(frozen=True)
class MassProperties:
    """The mass properties of one body, and how grave a mistake in them is."""

    subject: str
    inertial: Inertial
    bounds: InertiaBounds
    worst: Severity

    @property
    def moments(self) -> Vec3:
        """Principal moments in rising order, kg m²."""
        return principal_moments(self.inertial.inertia_com_kg_m2)

    @property
    def data(self) -> dict[str, Scalar | tuple[Scalar, ...]]:
        """Mass and principal moments, as each finding carries them."""
        return {"mass_kg": self.inertial.mass_kg, "principal_kg_m2": self.moments}

    def findings(self) -> Iterator[Finding]:
        """Yield what is wrong with them; of a body without mass nothing else."""
        mass, worst = self.inertial.mass_kg, self.worst
        if mass <= 0.0:
            message = f"mass is {mass:g} kg"
            yield MASS(self.subject, message, severity=worst, data=self.data)
            return
        if mass < self.bounds.small_mass:
            message = f"mass is only {mass:g} kg"
            data = {"mass_kg": mass, "bound_kg": self.bounds.small_mass}
            yield MASS_SMALL(self.subject, message, severity=_below(worst), data=data)
        broken = self._broken()
        if broken:
            yield broken
        if not broken or broken.rule != POSITIVE.id:
            yield from self._size(equivalent_radius(self.inertial))

    def _broken(self) -> Finding | None:
        a, b, c = steady(self.moments)
        shown = f"({a:.4g}, {b:.4g}, {c:.4g}) kg m²"
        if a <= SINGULAR * abs(c):
            message = f"principal moments {shown} are not all positive"
            dummy = self.worst == "warning" and self.inertial.mass_kg < self.bounds.small_mass
            severity: Severity = "info" if dummy else self.worst
            return POSITIVE(self.subject, message, severity=severity, data=self.data)
        violation = triangle_violation(self.inertial.inertia_com_kg_m2)
        if violation > TRIANGLE_ROUNDING:
            severity = self.worst if violation > self.bounds.triangle_slack else "warning"
            message = f"principal moments A + B < C by {100 * violation:.3g} % of C: {shown}"
            refused = "MuJoCo refuses it: " if severity == "error" else ""
            hint = f"is it about the centre of mass? {refused}`edits: balance_inertia` repairs it"
            data = self.data | {"violation": violation}
            return TRIANGLE(self.subject, message, hint, severity=severity, data=data)
        least = -violation * c / 2
        if least <= ROUNDING * c:
            message = f"its pseudo-inertia is singular: all mass lies in a plane, moments {shown}"
            data = self.data | {"least_second_moment_kg_m2": least}
            return PSEUDO(self.subject, message, severity=_below(self.worst), data=data)
        return None

    def _size(self, radius: float) -> Iterator[Finding]:
        mass, bounds = self.inertial.mass_kg, self.bounds
        data = {"radius_m": radius, **self.data}
        refused = self.moments[0] < LEAST_MOMENT_KG_M2
        if refused or mass > bounds.density * 4.0 / 3.0 * math.pi * radius**3:
            also = f"; MuJoCo refuses moments below {LEAST_MOMENT_KG_M2:g} kg m²"
            message = f"{mass:g} kg with the inertia of a ball of {radius:.3g} m radius: denser "
            message += "than any matter" + also * refused
            severity = self.worst if refused else _below(self.worst)
            yield DENSE(self.subject, message, severity=severity, data=data)
        if radius > bounds.radius * (1.0 + ROUNDING):
            message = f"its inertia is that of a ball of {radius:.3g} m radius with {mass:g} kg"
            yield RADIUS(self.subject, message, data=data)


def _below(worst: Severity) -> Severity:
    """One step below `worst`, for what is odd and not wrong."""
    return "warning" if worst == "error" else "info"
