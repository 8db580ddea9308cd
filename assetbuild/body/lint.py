"""Look over links and joints: as the source states them, and the bodies that will be simulated.

Wrong mass properties and limits are warnings at most in the source, and errors afterwards.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from assetbuild.body.inertia_rules import inertia_findings
from assetbuild.engine.step import Files, Step
from assetbuild.errors import quoted
from assetbuild.findings import Finding, Rule, Severity
from assetbuild.robot.chains import made_links
from assetbuild.robot.codec import decode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import InertiaBounds
from assetbuild.robot.mimic import common_range, leading, led_range
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.shapes import SourceShapes
from assetbuild.robot.tree import PLACEHOLDER_KG, unit_of

CONTRADICTION = 0.01
"""Share of a range by which a mimic joint may be led over its limits: rounding in the source."""

MIMIC_LIMITS = Rule(
    "joint.mimic_limits",
    "warning",
    "a mimic joint is driven beyond its own limits: PhysX blows up on it, MuJoCo holds both "
    "joints back (not ready where no range of the leader suits both)",
    "`set_limits` of the leader, to the range in which all joints keep theirs; check the sign of "
    "the multiplier",
)
LOCKED = Rule(
    "joint.locked",
    "warning",
    "lower = upper: the joint cannot move; in the MJCF an equality holds it",
    "if it is meant to move, give it a range: edit `set_limits`; else make it `fixed`",
)
RANGE = Rule(
    "joint.range",
    ("warning", "info"),
    "a revolute joint turns by more than 4 pi (info: by more than 2 pi, as many arms do, or "
    "without end, as wheels do), or a prismatic one slides by more than 10 m",
    "check whether degrees were written for radians, or millimetres for metres",
)
DEGREES = 720.0
"""The widest range in degrees that is written for radians, from -360 to 360; more stops nothing."""
LONGEST_SLIDE_M = 10.0
"""Longer than the rails of robots but for a few cranes."""
EFFORT_ZERO = Rule(
    "joint.effort_zero",
    "warning",
    "the effort limit is 0, with which nothing moves: it is taken as unlimited",
    "give it in the actuator table",
)
VELOCITY_ZERO = Rule(
    "joint.velocity_zero",
    "warning",
    "the velocity limit is 0, with which nothing moves: it is taken as unlimited",
    "give it in the actuator table",
)
NAMED = 6
"""Links that one finding names."""
NO_COLLISION = Rule(
    "link.no_collision",
    ("info", "warning"),
    "links with mass and visual geometry have no collision geometry (a warning for more than half "
    "of them)",
    "`from: visual` in the recipe's collision rule makes one from what is seen",
)


INVENTED = Rule(
    "inertia.invented",
    "warning",
    "every mass of the robot is a guess of the recipe's edits, so the robot is not ready",
    "give the real masses under `edits`, then remove `guessed`",
    blocks=True,
)


class LintLinks(Step):
    """`links.json`, `shapes.json` -> findings only; of the source and again after the edits.

    Mass properties and crossed limits are warnings at most: an edit can heal them, merging fixed
    joints a placeholder, and `lint_bodies` judges what will be simulated.
    """

    shares = True
    own_name = "lint_links"
    bounds: InertiaBounds = InertiaBounds()
    guessed: tuple[str, ...] = ()
    """Patterns of links whose mass an edit has guessed."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Findings in the order of the source's tree."""
        robot = RobotFiles(files.inputs)
        yield from invented(robot.links, self.guessed)
        yield from inertia_findings(robot.links, robot.source_shapes, self.bounds, "warning")
        for joint in robot.links.moving_joints:
            yield from _range(joint)
            yield from _drive(joint)
            yield from _led(robot.links, joint)
        yield from _without_collision(robot.links, robot.source_shapes)


def invented(tree: Tree, guessed: tuple[str, ...]) -> Iterator[Finding]:
    """A robot of which no mass is known. guessed: patterns of links whose mass an edit guessed."""
    heavy = [body for body in tree.bodies if body.inertial and body.inertial.mass_kg > 0.0]
    guesses = [b for b in heavy if any(re.fullmatch(pattern, b.name) for pattern in guessed)]
    if heavy and len(guesses) == len(heavy):
        yield INVENTED(
            "robot",
            f"all masses are guesses (links: {len(heavy)}), as the source states none: weights, "
            "torques and balance mean nothing",
            data={"links": len(heavy)},
        )


def _range(joint: Joint) -> Iterator[Finding]:
    lower, upper = joint.limits.lower, joint.limits.upper
    if lower is None or upper is None:
        return
    subject, data = f"joint {joint.name}", {"lower": lower, "upper": upper}
    if joint.is_locked:
        both = f"both limits are {lower:g} {unit_of(joint)}"
        yield LOCKED(subject, f"{both}: taken literally, the joint is locked", data=data)
    elif lower > upper:
        yield from crossed_limits(joint, "warning")
    elif joint.kind == "revolute" and upper - lower > 2 * math.pi * (1 + 1e-6):
        endless = upper - lower > DEGREES
        message = f"range {upper - lower:.4g} rad is more than one turn"
        message += ": so wide a range stops nothing" * endless
        hint = "" if endless else "right for some arms; else were degrees written for radians?"
        usual = endless or upper - lower <= 4 * math.pi * (1 + 1e-3)
        yield RANGE(subject, message, hint, data=data, severity="info" if usual else "warning")
    elif joint.kind == "prismatic" and upper - lower > LONGEST_SLIDE_M:
        message = f"range {upper - lower:.4g} m is longer than {LONGEST_SLIDE_M:g} m"
        hint = "right for a few rails and cranes; else were millimetres written for metres?"
        yield RANGE(subject, message, hint, data=data)


def _drive(joint: Joint) -> Iterator[Finding]:
    """A limit of 0 means "unknown" in most exports; no target writes it."""
    newton = "N" if joint.kind == "prismatic" else "N m"
    for rule, name, value, unit in (
        (EFFORT_ZERO, "effort", joint.limits.effort, newton),
        (VELOCITY_ZERO, "velocity", joint.limits.velocity, f"{unit_of(joint)}/s"),
    ):
        if value == 0.0 and joint.mimic is None:
            yield rule(
                f"joint {joint.name}",
                f"{name} limit is 0 {unit}, with which nothing moves: it is taken as unlimited",
                hint=f"give `{name}` in the recipe's actuator table",
                data={name: value, "missing": (name,)},
            )


def _led(tree: Tree, joint: Joint) -> Iterator[Finding]:
    """A mimic joint whose limits forbid where its leader takes it: two orders, one joint."""
    led, lower, upper = led_range(tree, joint), joint.limits.lower, joint.limits.upper
    if led is None or lower is None or upper is None or joint.kind == "continuous":
        return
    over = max(lower - led[0], led[1] - upper)
    if joint.mimic is None or over <= CONTRADICTION * max(led[1] - led[0], upper - lower):
        return
    unit, (leader, _, _) = unit_of(joint), leading(tree, joint)
    common = common_range(tree, leader)
    whole = (leader.limits.upper or 0.0) - (leader.limits.lower or 0.0)
    apart = common is not None and common[1] - common[0] <= CONTRADICTION * whole
    conflict = f"no position of `{leader.name}` suits both: " if apart else ""
    hint = "has the multiplier a wrong sign? correct the limits of one by `set_limits`"
    if not apart and common is not None:
        hint = f"`set_limits: {{joint: {leader.name}, lower: {common[0]:.4g}, "
        hint += f"upper: {common[1]:.4g}}}` keeps all joints in their ranges; or has the "
        hint += "multiplier a wrong sign?"
    yield MIMIC_LIMITS(
        f"joint {joint.name}",
        f"mimics `{joint.mimic.joint}` from {led[0]:.4g} to {led[1]:.4g} {unit}, but its "
        f"limits are {lower:g} to {upper:g}: {conflict}PhysX blows up on the contradiction, MuJoCo "
        "holds both back",
        hint,
        data={"led_lower": led[0], "led_upper": led[1], "lower": lower, "upper": upper},
        blocks=apart,
    )


def _without_collision(tree: Tree, shapes: SourceShapes) -> Iterator[Finding]:
    """One finding for all such links; a warning for more than half of what is seen."""
    seen = {shape.link for shape in shapes.of("visual")}
    solid = {shape.link for shape in shapes.of("collision")}
    drawn = [
        body.name
        for body in tree.bodies
        if body.name in seen and body.inertial and body.inertial.mass_kg >= PLACEHOLDER_KG
    ]
    bare = [name for name in drawn if name not in solid]
    if not bare:
        return
    yield NO_COLLISION(
        f"link {bare[0]}",
        f"{len(bare)} of {len(drawn)} links with mass and a visual have no collision geometry in "
        f"the source: {quoted(bare, NAMED, ' and {} more')}",
        severity="warning" if 2 * len(bare) > len(drawn) > 1 else "info",
        data={"links": tuple(bare), "seen": len(drawn)},
    )


EMPTY = Rule(
    "robot.empty",
    "warning",
    "nothing of the robot moves and nothing of it has a shape, so it is not ready",
    "give it joints or shapes; is this the right file?",
    blocks=True,
)


class LintBodies(Step):
    """`tree.json`, `shapes.json` -> findings only, by the same rules as `lint_links`.

    `source_links.json`, where it is there, tells the links to which edits give a mass.
    """

    shares = True
    own_name = "lint_bodies"
    bounds: InertiaBounds = InertiaBounds()

    def run(self, files: Files) -> Iterator[Finding]:
        """Findings in tree order."""
        robot = RobotFiles(files.inputs)
        made, source = frozenset[str](), files.inputs / "source_links.json"
        if source.exists():
            made = made_links(decode(Tree, source.read_bytes()))
        yield from inertia_findings(robot.tree, robot.source_shapes, self.bounds, "error", made)
        for joint in robot.tree.moving_joints:
            yield from crossed_limits(joint, "error")
        moves = any(joint.kind != "fixed" for joint in robot.tree.joints)
        if not moves and not robot.source_shapes.shapes:
            message = "no joint moves and no link has a shape: there is nothing to simulate"
            yield EMPTY("robot", message)


# --- limits the wrong way round ---------------------------------------------------------------

CROSSED_LIMITS = Rule(
    "joint.limits",
    ("warning", "error"),
    "the lower limit is above the upper one, so the MJCF gives the joint no range (a warning in "
    "the source, an error after the edits)",
    "edit `set_limits` gives it both; make the joint `fixed` if it is not meant to move",
)


def crossed_limits(joint: Joint, severity: Severity) -> Iterator[Finding]:
    """`joint.limits` where the lower limit is above the upper one."""
    lower, upper = joint.limits.lower, joint.limits.upper
    if lower is None or upper is None or lower <= upper:
        return
    unit = unit_of(joint)
    yield CROSSED_LIMITS(
        f"joint {joint.name}",
        f"lower limit {lower:g} {unit} is not below upper limit {upper:g} {unit}",
        severity=severity,
        data={"lower": lower, "upper": upper},
    )
