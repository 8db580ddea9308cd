"""What the recipe's tables led to: where they say other things than the source, odd surfaces."""

from __future__ import annotations

import re
from collections.abc import Iterator

from assetbuild.errors import quoted
from assetbuild.findings import Finding, Rule
from assetbuild.robot.actuator_table import ActuatorRow
from assetbuild.robot.model import Actuator, Control, Joint, Tree
from assetbuild.robot.shapes import Shapes

NO_ACTUATOR = Rule(
    "actuator.none",
    "warning",
    "all moving joints are passive: nothing drives the robot, which is not ready for training",
    "add `actuators` with `effort` and gains; where nothing is meant to drive it, state "
    "`actuators: []` and give the reason as `because` of this rule in `rules`",
    blocks=True,
)
ON_PURPOSE = (
    "; where nothing is meant to drive it: `actuators: []` and "
    '`rules: {actuator.none: {severity: info, because: "..."}}`'
)
OVERRIDES = Rule(
    "actuator.overrides",
    "info",
    "a row states damping, friction, effort or velocity other than the source does",
    "nothing, where the recipe knows better",
)
TUNED = Rule(
    "actuator.tuned",
    "info",
    "gains that were computed from a frequency and a damping ratio",
    "nothing; copy them if you want to fix them",
)
GUESSED = Rule(
    "actuator.guessed",
    "warning",
    "the drives of a row are guesses, as the source states no plausible numbers",
    "give the motors' effort and gains from a data sheet, then remove `guessed`",
)


def row_findings(
    rows: tuple[ActuatorRow, ...], tree: Tree, actuators: tuple[Actuator, ...]
) -> Iterator[Finding]:
    """`actuator.guessed` of the table, at its first such row; what else is said of each row."""
    driven_by = [[a for a in actuators if re.fullmatch(row.joints, a.joint)] for row in rows]
    guessed = [index for index, row in enumerate(rows) if row.guessed]
    guesses = [a for a in actuators if any(a in driven_by[index] for index in guessed)]
    if guesses:
        names = tuple(a.joint for a in guesses)
        yield GUESSED(
            f"recipe actuators.{guessed[0]}",
            f"the drives of {len(names)} joint{'s' if len(names) > 1 else ''} are guesses"
            f", effort {_span([a.effort for a in guesses])}: {quoted(names, 6)}",
            data={"joints": names},
        )
    for index, (row, mine) in enumerate(zip(rows, driven_by, strict=True)):
        yield from _tuned(f"recipe actuators.{index}", row, mine)
        if not row.guessed:
            yield from _overridden(f"recipe actuators.{index}", row, mine, tree)


def _tuned(subject: str, row: ActuatorRow, actuators: list[Actuator]) -> Iterator[Finding]:
    """The numbers that a frequency or damping ratio led to."""
    if row.frequency is not None or row.damping_ratio is not None:
        kp, kd = [a.kp for a in actuators], [a.kd for a in actuators]
        moved = "the armature alone" if row.inertia == "armature" else "what moves at `home`"
        yield TUNED(
            subject,
            f"`{row.joints}`: kp {min(kp):.4g} to {max(kp):.4g}, kd {min(kd):.4g} to "
            f"{max(kd):.4g} from frequency and damping ratio on {moved}",
            data={"kp_min": min(kp), "kp_max": max(kp), "kd_min": min(kd), "kd_max": max(kd)},
        )


def _overridden(
    subject: str, row: ActuatorRow, actuators: list[Actuator], tree: Tree
) -> Iterator[Finding]:
    """One per quantity that the source states otherwise, its limits of 0 left out."""
    for name in ("damping", "friction", "effort", "velocity"):
        pairs = [(_of_source(tree.by_joint[a.joint], name), getattr(a, name)) for a in actuators]
        other = [(was, now) for was, now in pairs if was is not None and was != now]
        if other:
            source, recipe = (_span([pair[i] for pair in other]) for i in (0, 1))
            yield OVERRIDES(
                subject,
                f"`{row.joints}`: {name} {recipe} in place of the source's {source} "
                f"({len(other)} joints)",
                data={"own": recipe, "source": source, "joints": len(other)},
            )


def _of_source(joint: Joint, name: str) -> float | None:
    """None where the source states none; a limit of 0 says nothing."""
    if name in ("damping", "friction"):
        return float(value) if (value := getattr(joint, name)) is not None else None
    return getattr(joint.limits, name) or None


def _span(values: list[float | None]) -> str:
    """`0.1 to 0.2`; None = unlimited."""
    known = sorted({value for value in values if value is not None})
    words = (
        [f"{known[0]:.4g}" + (f" to {known[-1]:.4g}" if len(known) > 1 else "")] if known else []
    )
    return " or ".join([*words, *(["unlimited"] if None in values else [])])


def actuator_findings(tree: Tree, control: Control, *, has_table: bool) -> Iterator[Finding]:
    """`actuator.none`, of the finished table."""
    actuators = control.actuators
    if actuators and all(tree.by_joint[a.joint].is_locked for a in actuators):
        count = len(actuators)
        which = f"all {count} moving joints" if count > 1 else "the only moving joint"
        yield NO_ACTUATOR(
            f"joint {actuators[0].joint}",
            f"equal limits lock {which}: nothing can be driven",
            hint="give them their ranges: `edits: [{set_limits: {joint, lower, upper}}]`",
            data={"joints": len(actuators)},
        )
    elif actuators and all(a.model == "passive" for a in actuators):
        moving = sum(not tree.by_joint[a.joint].is_locked for a in actuators)
        only_mjcf = sum(item.place == "actuator" for item in control.mjcf_only)
        if only_mjcf and has_table:
            return
        passive = f"all {moving} moving joints are passive"
        message, hint = f"no actuator table: {passive}", "add `actuators:` to the recipe"
        data = {"joints": moving}
        if only_mjcf:
            data["in_mjcf"] = only_mjcf
            message = f"no actuator table: the source's drives ({only_mjcf}) exist in the MJCF "
            message += f"alone, in all other formats the {moving} moving joints are passive"
        elif has_table:
            message = f"{passive}: nothing drives the robot"
            hint = "give the rows of `actuators:` an `effort` and gains"
        hint += "" if only_mjcf else ON_PURPOSE
        yield NO_ACTUATOR("recipe actuators", message, hint, data=data, blocks=not only_mjcf)


SLIDING = (0.2, 3.0)
"""Coefficients of sliding friction between which real pairs of dry surfaces lie: Teflon on steel
and polished wet metal just below, racing tyres and gecko-like grippers just above."""
SHOWN = 5
DEFAULT_S = 0.02
"""MuJoCo's time constant of a constraint that states none."""
SAFE_STEPS = 2
"""MuJoCo's `refsafe`: a shorter time constant is raised to so many time steps, without a word."""

FRICTION = Rule(
    "contact.friction",
    "warning",
    "a surface's sliding friction is implausibly small or large (outside 0.2 to 3)",
    "rubber feet have 0.6 to 1.2, metal and plastic 0.2 to 0.6; a surface that is meant to be so "
    "needs a line in `rules`, or `condim: 1` if it has no friction",
)

RAISED = Rule(
    "contact.softness",
    "info",
    "MuJoCo takes two time steps in place of a shorter time constant (`solref`)",
    "a smaller `simulation.timestep`, or a longer time constant",
)


def contact_findings(shapes: Shapes, control: Control) -> Iterator[Finding]:
    """One for each value that is outside, with the links that have it."""
    links: dict[float, dict[str, None]] = {}
    for shape in shapes.of("collision"):
        surface = control.surface_of(shape)
        touches = surface.contype or surface.conaffinity
        if touches and surface.condim > 1 and not SLIDING[0] <= surface.friction[0] <= SLIDING[1]:
            links.setdefault(surface.friction[0], {})[shape.link] = None
    for friction, link_names in links.items():
        names, listed = list(link_names), quoted(link_names, SHOWN, " and {} more links")
        slides = friction < SLIDING[0]
        yield FRICTION(
            f"link {names[0]}",
            f"sliding friction of {friction:.4g} is {'below' if slides else 'above'} the plausible "
            f"range of {SLIDING[0]:g} to {SLIDING[1]:g}: {listed}",
            hint="is it 0.08 for 0.8? `contact.friction` is [sliding, torsional (m), rolling (m)]",
            data={"friction": friction, "lower": SLIDING[0], "upper": SLIDING[1]},
        )
    yield from _raised(shapes, control)


def _raised(shapes: Shapes, control: Control) -> Iterator[Finding]:
    """One for each time constant that is too short for the time step.

    A surface without priority is mixed with what it touches: the floor's, which is the default.
    """
    least = SAFE_STEPS * control.simulation.timestep
    stated: dict[float, dict[str, None]] = {}
    for shape in shapes.of("collision"):
        surface = control.surface_of(shape)
        constant = surface.solref[0] if surface.solref and surface.priority else DEFAULT_S
        stated.setdefault(constant, {})[f"link {shape.link}"] = None
    for loop in control.loops:
        stated.setdefault(loop.solref[0], {})[f"loop {loop.name}"] = None
    for constant, places in stated.items():
        if 0.0 < constant < least:
            names = list(places)
            yield RAISED(
                names[0],
                f"MuJoCo raises the time constant of {constant:g} s to two time steps, "
                f"{least:g} s: {quoted(names, SHOWN, ' and {} more places')}",
                hint=f"`simulation: {{timestep: {constant / SAFE_STEPS:g}}}`, or `solref: "
                f"[{least:g}, ...]` to state what is simulated",
                data={"stated_s": constant, "taken_s": least, "places": len(names)},
            )
