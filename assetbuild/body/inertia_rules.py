"""What a body's mass properties must satisfy; one set of rules for links and merged bodies.

Per body the first broken rule of the chain mass, positive, triangle, pseudo is told, since each
implies the next; size, density and smallness are judged besides.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

from assetbuild.findings import Finding, Rule, Scalar, Severity
from assetbuild.robot.chains import Chain, find_chains, is_massless, weighs
from assetbuild.robot.inertia import (
    LEAST_MOMENT_KG_M2,
    InertiaBounds,
    Tensor,
    equivalent_radius,
    least_second_moment,
    principal_moments,
    triangle_violation,
)
from assetbuild.robot.model import Inertial, Shapes, Tree

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
    "inertia.between",
    "info",
    "a massless link between two joints: in MJCF one body has several joints",
    "for USD the edit `share_mass`",
)
MASS = Rule(
    "inertia.mass",
    ("error", "warning"),
    "the mass is not positive (a warning in the source)",
    "give the real mass",
)
POSITIVE = Rule(
    "inertia.positive",
    ("error", "warning"),
    "a principal moment is not positive (a warning in the source)",
    "give the real tensor",
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
    "give the body thickness",
)
RADIUS = Rule(
    "inertia.radius",
    ("warning", "info"),
    "the inertia is that of a ball of more than 0.5 m radius: much for the mass, though every "
    "simulator takes it",
    "check the units",
)
DENSE = Rule(
    "inertia.dense",
    ("warning", "info", "error"),
    "the inertia is less than that of the densest matter (an error where MuJoCo refuses it: "
    "under 1e-15 kg m²)",
    "`inertia_from_geometry`",
)
MASS_SMALL = Rule(
    "inertia.mass_small",
    ("warning", "info"),
    "a moving body weighs less than 1 g (info in the source)",
    "merge it, or give its real mass",
)


def inertia_findings(
    tree: Tree, shapes: Shapes, bounds: InertiaBounds, worst: Severity
) -> Iterator[Finding]:
    """Findings on all bodies of a tree, none graver than `worst`.

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
                yield _carried(subject)
        elif body.inertial is None:
            yield _missing(subject, worst)
        else:
            for finding in _judge(subject, body.inertial, bounds, worst):
                kept = _of_this(finding, moves=body.name in driven, shows=body.name in shaped)
                if kept:
                    yield kept


def _of_this(finding: Finding, *, moves: bool, shows: bool) -> Finding | None:
    """As grave as it is for a body that moves or not, and has a shape or not."""
    if finding.rule == DENSE.id and not shows and finding.severity != "error":
        return replace(finding, severity="info")  # it has no size to doubt
    if moves:
        return finding
    if finding.rule == RADIUS.id:  # what never turns may be as lazy as it likes
        return replace(finding, severity=_note(finding.severity))
    return finding if finding.rule != MASS_SMALL.id else None


def _carried(subject: str) -> Finding:
    return MISSING(
        subject,
        "it is kept as a body but has no mass; some engines invent one",
        "let it be merged, or give it a small mass and inertia",
    )


def _between(subject: str, chain: Chain) -> Finding:
    joints = tuple(joint.name for joint in chain.joints)
    return BETWEEN(
        subject,
        f"a massless link between the joints of `{chain.body}` ({', '.join(joints)}): "
        "exact in URDF and MJCF, but PhysX wants mass on every body",
        "the edit `share_mass` moves some mass here that no motion can tell",
        data={"joints": joints, "body": chain.body},
    )


def _missing(subject: str, worst: Severity) -> Finding:
    message = "it moves but has no <inertial>: no simulator can accelerate it"
    return MISSING(
        subject,
        message,
        "give it a mass: edit `inertia_from_geometry`, or `set_inertia`",
        severity=worst,
    )


def _judge(
    subject: str, inertial: Inertial, bounds: InertiaBounds, worst: Severity
) -> Iterator[Finding]:
    mass, tensor = inertial.mass_kg, inertial.inertia_com_kg_m2
    moments = principal_moments(tensor)
    data: dict[str, Scalar | tuple[Scalar, ...]] = {"mass_kg": mass, "principal_kg_m2": moments}
    if mass <= 0.0:
        message = f"mass is {mass:g} kg"
        hint = "give it its real one: edit `set_mass`, or `inertia_from_geometry` with a density"
        yield MASS(subject, message, hint, severity=worst, data=data)
        return
    if mass < bounds.small_mass:
        yield MASS_SMALL(
            subject,
            f"mass is only {mass:g} kg",
            "merge it into a neighbour, or give it its real mass",
            severity=_note(worst),
            data={"mass_kg": mass, "bound_kg": bounds.small_mass},
        )
    broken = _broken(subject, tensor, moments, bounds, worst, data)
    if broken:
        yield broken
    if not broken or broken.rule != POSITIVE.id:
        yield from _size(subject, inertial, bounds, worst, moments)


def _broken(
    subject: str,
    tensor: Tensor,
    moments: tuple[float, float, float],
    bounds: InertiaBounds,
    worst: Severity,
    data: Mapping[str, Scalar | tuple[Scalar, ...]],
) -> Finding | None:
    a, b, c = moments
    shown = f"({a:.4g}, {b:.4g}, {c:.4g}) kg m²"
    if a <= SINGULAR * abs(c):
        message = f"principal moments {shown} are not all positive"
        hint = "a product with the wrong sign, or a dummy? edit `inertia_from_geometry`"
        return POSITIVE(subject, message, hint, severity=worst, data=data)
    violation = triangle_violation(tensor)
    if violation > ROUNDING:
        severity = worst if violation > bounds.triangle_slack else "warning"
        message = f"principal moments A + B < C by {100 * violation:.3g} % of C: {shown}"
        hint = "was it taken about the centre of mass? MuJoCo refuses it: edit `balance_inertia`"
        extra = {**data, "violation": violation}
        return TRIANGLE(subject, message, hint, severity=severity, data=extra)
    least = least_second_moment(tensor)
    if least <= ROUNDING * c:
        message = f"its pseudo-inertia is singular: all mass lies in a plane, moments {shown}"
        hint = "a real part has thickness; randomised or identified masses can turn invalid"
        extra = {**data, "least_second_moment_kg_m2": least}
        return PSEUDO(subject, message, hint, severity=_note(worst), data=extra)
    return None


def _size(
    subject: str,
    inertial: Inertial,
    bounds: InertiaBounds,
    worst: Severity,
    moments: tuple[float, float, float],
) -> Iterator[Finding]:
    radius_m = equivalent_radius(inertial)
    yield from _dense(subject, inertial, bounds, worst, moments, radius_m)
    if radius_m <= bounds.radius * (1.0 + ROUNDING):
        return
    yield RADIUS(
        subject,
        f"its inertia is that of a ball of {radius_m:.3g} m radius with {inertial.mass_kg:g} kg",
        "are the units kg m² (not kg mm² or g cm²), and the tensor about the centre of mass?",
        data={"radius_m": radius_m, "mass_kg": inertial.mass_kg, "principal_kg_m2": moments},
    )


def _dense(
    subject: str,
    inertial: Inertial,
    bounds: InertiaBounds,
    worst: Severity,
    moments: tuple[float, float, float],
    radius_m: float,
) -> Iterator[Finding]:
    refused = moments[0] < LEAST_MOMENT_KG_M2
    ball = 4.0 / 3.0 * math.pi * radius_m**3
    if not refused and inertial.mass_kg <= bounds.density * ball:
        return
    also = f"; MuJoCo refuses moments below {LEAST_MOMENT_KG_M2:g} kg m²" if refused else ""
    yield DENSE(
        subject,
        f"{inertial.mass_kg:g} kg with the inertia of a ball of {radius_m:.3g} m radius: "
        f"denser than any matter{also}",
        "is it a dummy value? `inertia_from_geometry` computes it from the shapes",
        severity=worst if refused else _note(worst),
        data={"radius_m": radius_m, "mass_kg": inertial.mass_kg, "principal_kg_m2": moments},
    )


def _note(worst: Severity) -> Severity:
    """One step below `worst`, for what is odd and not wrong."""
    return "warning" if worst == "error" else "info"
