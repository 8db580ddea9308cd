"""The model card: what the robot is, in tables that a reviewer can check."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from assetbuild.body.measure_bodies import Measured
from assetbuild.findings import is_waived
from assetbuild.recipe.models import Recipe
from assetbuild.report.document import Report
from assetbuild.report.tables import Record, Table, markdown_table, records, table
from assetbuild.report.verdict import verdict_rows
from assetbuild.robot.identify import Fit
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Actuator, Body, Control, Joint, Tree
from assetbuild.robot.shapes import Geometry, Mesh, Shapes


@dataclass(frozen=True)
class Subject:
    """Everything that a report reads. pin: what the lock says of the source.

    fits: what the logs of the recipe showed.
    """

    recipe: Recipe
    pin: Mapping[str, object]
    tree: Tree
    shapes: Shapes
    control: Control
    measured: Measured
    fits: tuple[Fit, ...] = ()


CHANGES = ("edit.", "merge.", "urdf.dropped", "visual.decimated", "mesh.")
"""Families of rules that tell what is not as the source has it."""
LIMITS = ("usd.", "mjcf.", "urdf.", "collision.none", "joint.", "license.")
"""Families of rules that tell what the files cannot say, or do not know."""


def model_card(subject: Subject, report: Report) -> str:
    """`model_card.md`."""
    parts = [f"# {subject.recipe.robot}", _verdict(report)]
    tables = card_tables(subject, report)
    parts += [f"## {shown.title}\n\n{markdown_table(shown)}" for shown in tables]
    return "\n\n".join(parts) + "\n"


def _verdict(report: Report) -> str:
    ready = "yes" if report.verdict.ready else "no"
    blocked = ", ".join(f"`{rule}`" for rule in report.verdict.blocked_by)
    head = f"Ready for training: {ready}." + (f" Blocked by {blocked}." if blocked else "")
    rows = [f"- {part}: {sentence}" for part, sentence in verdict_rows(report.verdict)]
    return "\n".join([head, "", *rows])


def card_tables(subject: Subject, report: Report) -> tuple[Table, ...]:
    """All tables of the card, in order."""
    return (
        _identity(subject),
        _counts(subject),
        _quality(subject, report),
        _bodies(subject),
        _joints(subject),
        _drives(subject),
        _collision(subject),
        _keyframes(subject),
        _sensors(subject),
        _changes(report),
        _checks(report),
        table("Known limits", ("rule", "of", "what"), _limit_rows(report)),
    )


def _identity(subject: Subject) -> Table:
    recipe, about = subject.recipe, subject.recipe.about
    stated = {
        "vendor": about.vendor,
        "author": about.author,
        "about": about.description,
        "tags": ", ".join(about.tags),
    }
    facts = {
        "robot": recipe.robot,
        **{what: value for what, value in stated.items() if value},
        "source": recipe.source.origin,
        "description": recipe.source.description,
        **dict(sorted(subject.pin.items())),
        "licence": recipe.source.license or "not stated in the recipe",
        "base": subject.tree.base,
        "targets": ", ".join(recipe.targets),
    }
    return table("Identity", ("what", "value"), facts.items())


def _counts(subject: Subject) -> Table:
    tree, shapes, control = subject.tree, subject.shapes, subject.control
    start = initial_pose(tree, control)
    facts = {
        "bodies": len(tree.bodies),
        "frames of merged links": len(tree.frames),
        "moving joints": len(tree.moving_joints),
        "actuators": sum(a.model != "passive" for a in control.actuators),
        "total mass, kg": total_mass(tree),
        f"centre of mass at {start.name or 'the initial pose'}, m": subject.measured.com_m,
        "visual shapes": len(shapes.of("visual")),
        "collision shapes": len(shapes.of("collision")),
        "triangles of all meshes": sum(asset.faces for asset in shapes.meshes),
        "excluded pairs": len(control.excludes),
        "timestep, s": control.simulation.timestep,
        "decimation": control.simulation.decimation,
        "friction: sliding, torsional m, rolling m": control.contact.friction,
    }
    return table("Counts", ("what", "value"), facts.items())


def _quality(subject: Subject, report: Report) -> Table:
    level, criteria = grade(subject.control, report)
    rows = [(c.needed, c.what, c.met, c.evidence) for c in criteria]
    note = f"MuJoCo Menagerie's quality grade, from the evidence of this build: {level}"
    return table("Quality grade", ("needed for", "criterion", "met", "evidence"), rows, note)


def _bodies(subject: Subject) -> Table:
    def columns(body: Body) -> Record:
        inertial = body.inertial
        measured = subject.measured.by_body.get(body.name)
        return {
            "body": body.name,
            "mass, kg": inertial and inertial.mass_kg,
            "centre of mass, m": inertial and inertial.com_m,
            "principal moments, kg m2": measured and measured.moments_kg_m2,
            "their axes, wxyz": measured and measured.axes,
            "inertia xx, yy, zz, xy, xz, yz, kg m2": inertial and inertial.inertia_com_kg_m2,
        }

    note = "inertia about the centre of mass, in the body's axes"
    return records("Bodies", map(columns, subject.tree.bodies), note)


def _joints(subject: Subject) -> Table:
    def columns(joint: Joint) -> Record:
        lower, upper, mimic = joint.limits.lower, joint.limits.upper, joint.mimic
        slides = joint.kind == "prismatic" or lower is None or upper is None
        return {
            "joint": joint.name,
            "kind": joint.kind,
            "parent": joint.parent,
            "axis": joint.axis,
            "lower, rad or m": lower,
            "upper": upper,
            "range, deg": None if slides else math.degrees((upper or 0.0) - (lower or 0.0)),
            "effort in the source, N m or N": joint.limits.effort,
            "velocity in the source, rad/s or m/s": joint.limits.velocity,
            "mimics": mimic and f"{mimic.joint} x {mimic.multiplier:g}",
        }

    return records("Joints", map(columns, subject.tree.moving_joints))


def _drives(subject: Subject) -> Table:
    stalls = any(drive.stall is not None for drive in subject.control.actuators)

    def columns(drive: Actuator) -> Record:
        return {
            "joint": drive.joint,
            "model": drive.model,
            "kp": drive.kp,
            "kd": drive.kd,
            "damping": drive.damping,
            "friction": drive.friction,
            "armature, kg m2": drive.armature,
            "effort": drive.effort,
            "velocity": drive.velocity,
            **({"stall": drive.stall} if stalls else {}),
            "motor": drive.motor,
            "source": drive.source,
        }

    note = "SI units per rad or per m; kd is of the drive, damping of the joint: they add up"
    return records("Actuators", map(columns, subject.control.actuators), note)


def _collision(subject: Subject) -> Table:
    assets = {asset.name: asset for asset in subject.shapes.meshes}

    def size(geometry: Geometry) -> str:
        if isinstance(geometry, Mesh):
            asset = assets[geometry.mesh]
            return f"{asset.vertices} vertices" + ("" if asset.convex else ", not convex")
        return ", ".join(f"{name} {_short(value)}" for name, value in vars(geometry).items())

    rows = [
        (shape.name, shape.link, type(shape.geometry).__name__.lower(), size(shape.geometry))
        for shape in subject.shapes.of("collision")
    ]
    return table("Collision geometry", ("shape", "link", "kind", "size, m"), rows)


def _short(value: object) -> str:
    values = value if isinstance(value, tuple) else (value,)
    return " x ".join(f"{v:.4g}" for v in values)


def _keyframes(subject: Subject) -> Table:
    rows = [
        (k.name, k.base and k.base.xyz, ", ".join(f"{n} {v:.6g}" for n, v in k.joints))
        for k in subject.control.keyframes
    ]
    return table("Keyframes", ("keyframe", "base, m", "joints, rad or m"), rows)


def _sensors(subject: Subject) -> Table:
    control = subject.control
    rows = [
        *((s.name, s.kind, f"{s.at.kind} {s.at.name}".strip(), s.noise) for s in control.sensors),
        *((c.name, "camera", f"link {c.link or 'world'}", None) for c in control.cameras),
    ]
    return table("Sensors and cameras", ("name", "kind", "at", "noise"), rows)


def _changes(report: Report) -> Table:
    rows = [(f.rule, f.subject, f.message) for f in report.findings if f.rule.startswith(CHANGES)]
    title = "Changed against the source"
    return table(title, ("rule", "of", "what"), rows, empty="Nothing.")


def _checks(report: Report) -> Table:
    rows = [(name, check.status, check.note) for name, check in sorted(report.checks.items())]
    return table("Checks", ("check", "result", "note"), rows)


def _limit_rows(report: Report) -> Iterator[tuple[str, str, str]]:
    """Warnings, waived findings, what a format cannot hold, and what was not checked."""
    for finding in report.findings:
        if is_waived(finding):
            because = finding.data["because"]
            yield finding.rule, finding.subject, f"{finding.message}; waived: {because}"
        elif finding.severity != "info" or (
            finding.rule.startswith(LIMITS) and not finding.rule.startswith(CHANGES)
        ):
            yield finding.rule, finding.subject, finding.message
    for name, check in sorted(report.checks.items()):
        if check.status == "skip":
            yield "not checked", name, check.note


# --- the quality grade ----------------------------------------------------------------------

UNREAL = ("inertia.", "joint.effort_zero", "joint.velocity_zero", "joint.range", "mirror.", "mass.")
"""Families of rules whose warnings say that a value is not realistic."""
UNSTABLE = ("stand.finite", "stand.fall", "free_fall.drop", "trials.", "mjcf.")


@dataclass(frozen=True)
class Criterion:
    """One thing that the grade needs. needed: the grade that is lost without it."""

    needed: str
    what: str
    met: bool
    evidence: str


def grade(control: Control, report: Report) -> tuple[str, tuple[Criterion, ...]]:
    """The best grade of MuJoCo Menagerie that the evidence carries, and each step of it.

    Menagerie's words: A+ = the values come from system identification; A = realistic values, not
    identified; B = stable, some values unrealistic; C = conditionally stable.
    """
    criteria = (
        _no_findings(report, "B", "it is stable", UNSTABLE),
        _physical_checks(report),
        _no_findings(report, "A", "masses, inertias and limits are realistic", UNREAL),
        _motors(control),
        _identified(control),
    )
    for level in ("B", "A", "A+"):
        if any(c.needed == level and not c.met for c in criteria):
            return {"B": "C", "A": "B", "A+": "A"}[level], criteria
    return "A+", criteria


def _no_findings(report: Report, needed: str, what: str, families: tuple[str, ...]) -> Criterion:
    findings = [f for f in report.findings if f.severity != "info" and f.rule.startswith(families)]
    waived = [f for f in report.findings if is_waived(f) and f.rule.startswith(families)]
    rules = ", ".join(dict.fromkeys(f.rule for f in [*findings, *waived]))
    met = not findings and not waived
    return Criterion(needed, what, met, "none of its rules warns" if met else f"not so: {rules}")


def _physical_checks(report: Report) -> Criterion:
    physical = ("free_fall", "stand", "trials", "mjcf_equal", "oracle")
    states = {name: report.checks[name].status for name in physical if name in report.checks}
    text = ", ".join(f"{name} {status}" for name, status in states.items()) or "no check ran"
    met = bool(states) and "fail" not in states.values()
    return Criterion("B", "the physical checks pass", met, text)


def _motors(control: Control) -> Criterion:
    driven = [a for a in control.actuators if a.model != "passive"]
    known = [a for a in driven if a.source and a.effort is not None and a.armature > 0.0]
    bare = [a.joint for a in driven if a not in known]
    shown = ", ".join(bare[:4]) + (", ..." if len(bare) > 4 else "")
    what = "each drive has a source, an effort limit and a reflected rotor inertia"
    if not bare:
        return Criterion("A", what, True, f"{len(driven)} of {len(driven)} drives")
    return Criterion("A", what, False, f"{len(bare)} of {len(driven)} have not: {shown}")


def _identified(control: Control) -> Criterion:
    """Rotor inertia and friction or damping of each drive, from logs of the real robot."""
    driven = [a for a in control.actuators if a.model != "passive"]
    met = [
        a for a in driven if "armature" in a.measured and {"friction", "damping"} & {*a.measured}
    ]
    what = "values come from system identification"
    if not any(a.measured for a in driven):
        return Criterion("A+", what, False, "none recorded")
    text = f"armature and friction or damping of {len(met)} of {len(driven)} drives are measured"
    return Criterion("A+", what, len(met) == len(driven), text)
