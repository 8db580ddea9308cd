"""`model_card.md`: what the robot is, in tables that a reviewer can check."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from assetbuild.recipe.models import Recipe
from assetbuild.report.document import Report
from assetbuild.robot.model import Control, Joint, Shapes, Tree


def model_card(
    recipe: Recipe,
    pin: Mapping[str, object],
    tree: Tree,
    shapes: Shapes,
    control: Control,
    report: Report,
) -> str:
    """The card as Markdown. pin: what the lock says of the source."""
    return (
        "\n\n".join(
            (
                f"# {recipe.robot}",
                _identity(recipe, pin, tree, shapes, control),
                "## Bodies\n\n" + _bodies(tree),
                "## Joints and actuators\n\n" + _joints(tree, control),
                "## Keyframes\n\n" + _keyframes(control),
                "## Checks\n\n" + _checks(report),
                "## Changed against the source\n\n" + _changes(report),
            )
        )
        + "\n"
    )


def _table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    head = list(head)
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    lines += ["| " + " | ".join(_cell(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def _cell(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, tuple):
        return ", ".join(_cell(item) for item in value)
    return str(value).replace("|", "\\|")


def _identity(
    recipe: Recipe, pin: Mapping[str, object], tree: Tree, shapes: Shapes, control: Control
) -> str:
    mass = sum(body.inertial.mass_kg for body in tree.bodies if body.inertial)
    rows: list[tuple[str, object]] = [
        ("source", recipe.source.origin),
        ("description", recipe.source.description),
        *sorted(pin.items()),
        ("licence", recipe.source.license or "not stated"),
        ("base", tree.base),
        ("bodies", len(tree.bodies)),
        ("moving joints", len(tree.moving_joints)),
        ("actuators", sum(a.model != "passive" for a in control.actuators)),
        ("total mass, kg", mass),
        ("visual shapes", len(shapes.of("visual"))),
        ("collision shapes", len(shapes.of("collision"))),
        ("timestep, s", control.simulation.timestep),
    ]
    return _table(("", ""), rows)


def _bodies(tree: Tree) -> str:
    rows = [
        (b.name, b.inertial.mass_kg, b.inertial.com_m, b.inertial.inertia_com_kg_m2)
        if b.inertial
        else (b.name, None, None, None)
        for b in tree.bodies
    ]
    head = ("body", "mass, kg", "centre of mass, m", "inertia xx, yy, zz, xy, xz, yz, kg m2")
    return _table(head, rows)


def _joints(tree: Tree, control: Control) -> str:
    def row(joint: Joint) -> tuple[object, ...]:
        actuator = control.by_joint.get(joint.name)
        limits = (joint.limits.lower, joint.limits.upper)
        if actuator is None:
            return (joint.name, joint.kind, *limits, *[None] * 7)
        a = actuator
        gains = (a.kp, a.kd, a.damping, a.friction, a.armature)
        return (joint.name, f"{joint.kind}, {a.model}", *limits, a.effort, a.velocity, *gains)

    limits = ("lower", "upper", "effort", "velocity")
    head = ("joint", "kind", *limits, "kp", "kd", "damping", "friction", "armature")
    return _table(head, (row(joint) for joint in tree.moving_joints))


def _keyframes(control: Control) -> str:
    if not control.keyframes:
        return "None."
    rows = [
        (k.name, k.base.xyz if k.base else None, ", ".join(f"{n} {v:.6g}" for n, v in k.joints))
        for k in control.keyframes
    ]
    return _table(("keyframe", "base, m", "joints"), rows)


def _checks(report: Report) -> str:
    rows = [(name, check.status, check.note) for name, check in sorted(report.checks.items())]
    return _table(("check", "status", "note"), rows)


def _changes(report: Report) -> str:
    changes = [f for f in report.findings if f.rule.startswith(("edit.", "merge.", "urdf.dropped"))]
    return "\n".join(f"- `{f.rule}` {f.subject}: {f.message}" for f in changes) or "Nothing."
