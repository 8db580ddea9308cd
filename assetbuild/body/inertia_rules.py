"""What a body's mass properties must satisfy; one set of rules for links and merged bodies.

Per body the first broken rule of the chain mass, positive, triangle, pseudo is reported, since each
implies the next; size, density and smallness are judged besides.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import replace

from assetbuild.findings import Data, Finding, Rule, Severity, steady
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
from assetbuild.robot.shapes import Shapes, SourceShapes

ROUNDING = 1e-9
"""Relative: smaller violations are the noise of turning a tensor into other axes."""

SPARSE_KG_M3 = 20.0
"""A ball of the same inertia that is denser than this is merely large: no units are mistaken."""

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
    "the inertia is that of a ball of more than 0.5 m radius and less than 20 kg/m³: much for the "
    "mass, though every simulator takes it",
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
            for finding in mass_findings(subject, body.inertial, bounds, worst):
                moves, shows = body.name in driven, body.name in shaped
                kept = _of_body(finding, moves=moves, shows=shows, made=body.name in made)
                if kept:
                    yield kept


def _of_body(finding: Finding, *, moves: bool, shows: bool, made: bool) -> Finding | None:
    """The severity that fits a body which moves or not, has a shape or not; None: no finding."""
    if finding.rule == DENSE.id and not shows and finding.severity != "error":
        return replace(finding, severity="info")  # it has no size to doubt
    if finding.rule == RADIUS.id and not moves:  # what never turns may be as lazy as it likes
        return replace(finding, severity=_below(finding.severity))
    if finding.rule == MASS_SMALL.id and made:
        message = f"{finding.message}: an edit gave the link this mass"
        finding = replace(finding, severity="info", message=message, hint="")
    if moves:
        return finding
    if finding.severity == "warning" and finding.data.get("principal_kg_m2") == (0.0, 0.0, 0.0):
        message = "no inertia of its own: a point mass, which is exact once it is merged"
        return replace(finding, severity="info", message=message, hint="")
    return finding if finding.rule != MASS_SMALL.id else None


def _between(subject: str, chain: Chain) -> Finding:
    joints = tuple(joint.name for joint in chain.joints)
    return BETWEEN(
        subject,
        f"a massless link between the joints of `{chain.body}` ({', '.join(joints)}): "
        "exact in URDF and MJCF, but PhysX wants mass on every body",
        data={"joints": joints, "body": chain.body},
    )


def mass_findings(
    subject: str, inertial: Inertial, bounds: InertiaBounds, worst: Severity
) -> Iterator[Finding]:
    """Yield what is wrong with mass properties; of a body without mass nothing else."""
    mass, moments = inertial.mass_kg, principal_moments(inertial.inertia_com_kg_m2)
    data: Data = {"mass_kg": mass, "principal_kg_m2": moments}
    if mass <= 0.0:
        yield MASS(subject, f"mass is {mass:g} kg", severity=worst, data=data)
        return
    if mass < bounds.small_mass:
        bound = {"mass_kg": mass, "bound_kg": bounds.small_mass}
        yield MASS_SMALL(subject, f"mass is only {mass:g} kg", severity=_below(worst), data=bound)
    a, b, c = steady(moments)
    shown = f"({a:.4g}, {b:.4g}, {c:.4g}) kg m²"
    if a <= SINGULAR * abs(c):
        message = f"principal moments {shown} are not all positive"
        dummy = worst == "warning" and mass < bounds.small_mass
        yield POSITIVE(subject, message, severity="info" if dummy else worst, data=data)
        return
    violation = triangle_violation(inertial.inertia_com_kg_m2)
    least = -violation * c / 2
    if violation > TRIANGLE_ROUNDING:
        severity = worst if violation > bounds.triangle_slack else "warning"
        message = f"principal moments A + B < C by {100 * violation:.3g} % of C: {shown}"
        refused = "MuJoCo refuses it: " if severity == "error" else ""
        hint = f"is it about the centre of mass? {refused}`edits: balance_inertia` repairs it"
        more = {**data, "violation": violation}
        yield TRIANGLE(subject, message, hint, severity=severity, data=more)
    elif least <= ROUNDING * c:
        message = f"its pseudo-inertia is singular: all mass lies in a plane, moments {shown}"
        more = {**data, "least_second_moment_kg_m2": least}
        yield PSEUDO(subject, message, severity=_below(worst), data=more)
    yield from _size_findings(subject, inertial, bounds, worst, data)


def _size_findings(
    subject: str, inertial: Inertial, bounds: InertiaBounds, worst: Severity, data: Data
) -> Iterator[Finding]:
    mass, radius = inertial.mass_kg, equivalent_radius(inertial)
    ball = 4.0 / 3.0 * math.pi * radius**3
    data = {"radius_m": radius, **data}
    refused = principal_moments(inertial.inertia_com_kg_m2)[0] < LEAST_MOMENT_KG_M2
    if refused or mass > bounds.density * ball:
        also = f"; MuJoCo refuses moments below {LEAST_MOMENT_KG_M2:g} kg m²"
        message = f"{mass:g} kg with the inertia of a ball of {radius:.3g} m radius: denser "
        message += "than any matter" + also * refused
        yield DENSE(subject, message, severity=worst if refused else _below(worst), data=data)
    if radius > bounds.radius * (1.0 + ROUNDING) and mass < SPARSE_KG_M3 * ball:
        message = f"its inertia is that of a ball of {radius:.3g} m radius with {mass:g} kg"
        yield RADIUS(subject, message, data=data)


def _below(worst: Severity) -> Severity:
    """One step below `worst`, for what is odd and not wrong."""
    return "warning" if worst == "error" else "info"
