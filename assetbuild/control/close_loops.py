"""Keyframes of a robot with loops: moved until every loop closes, or refused with what is left."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

from assetbuild.findings import Finding, Rule
from assetbuild.robot.actuator_table import ActuatorRow, RowError
from assetbuild.robot.chains import angles_of, split
from assetbuild.robot.closure import CLOSED, Solution, close, gaps, locked_joints
from assetbuild.robot.loops import by_constraint, joints_of, placed_loop
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Actuator, Keyframe, Loop, Tree
from assetbuild.robot.pose import IDENTITY, Quat, quat_multiply, quat_of_rpy
from assetbuild.robot.sides import Side, moving_by_source

VISIBLE_M = 1e-3
"""m or rad: a loop that a source's keyframe leaves open by more is a warning."""

ROUGHLY = 0.1
"""rad or m: so far from its stated value a joint that nothing drives may close the loops."""

SOLVED = Rule(
    "loop.home",
    "info",
    "joints that a keyframe does not state, or states roughly, were moved until the loops close",
    "state their values in the keyframe, where you want the other way in which the loops close",
)
OPEN = Rule(
    "loop.open_keyframe",
    ("info", "warning"),
    "a keyframe of the source's MJCF does not close the loops exactly (a warning above 1 mm); it "
    "is kept as it is, and the simulation pulls the loops together",
    "state the keyframe in the recipe with the driven joints alone: the others are solved",
)
LOCKED = Rule(
    "loop.locked",
    "warning",
    "the source's loops leave a driven joint no motion",
    "check the ends of the loops",
)


def driven_joints(
    tree: Tree,
    rows: Sequence[ActuatorRow],
    sides: Sequence[Side] = (),
    source: Sequence[Actuator] = (),
) -> set[str]:
    """Joints that a row of the table drives, or the source's own drives."""
    patterns = [row.joints for row in rows if row.model != "passive"]
    by_row = {j.name for j in tree.moving_joints if any(re.fullmatch(p, j.name) for p in patterns)}
    by_source = {actuator.joint for actuator in source if actuator.model != "passive"}
    return by_row | (by_source & moving_by_source(sides, by_source))


def placed_loops(
    tree: Tree, loops: Sequence[Loop], stated: Sequence[Loop] = ()
) -> tuple[Loop, ...]:
    """Loops of a source, whose ends are links, on the bodies that these became part of.

    stated: the recipe's, of which one takes the place of the source's of that name.
    """

    names = {loop.name for loop in stated}
    return tuple(placed_loop(tree, loop) for loop in loops if loop.name not in names)


def _hinged(tree: Tree, pose: Keyframe) -> tuple[Tree, dict[str, float]]:
    """The tree with every ball joint as three hinges, and the position of each joint, rad or m."""
    balls = frozenset(joint.name for joint in tree.joints if joint.kind == "ball")
    whole, positions = split(tree, balls), dict(pose.joints)
    for name, turn in pose.turns:
        positions |= {f"{name}_{axis}": q for axis, q in zip("xyz", angles_of(turn), strict=True)}
    return whole, with_mimics(whole, positions)


def _posed(tree: Tree, pose: Keyframe, positions: Mapping[str, float]) -> Keyframe:
    """The keyframe with the positions of a hinged tree."""
    turns = list[tuple[str, Quat]]()
    for joint in tree.joints:
        if joint.kind == "ball":
            x, y, z = (positions[f"{joint.name}_{axis}"] for axis in "xyz")
            about_x, about_y = quat_of_rpy(x, 0.0, 0.0), quat_of_rpy(0.0, y, 0.0)
            turn = quat_multiply(quat_multiply(about_x, about_y), quat_of_rpy(0.0, 0.0, z))
            turns += [(joint.name, turn)] if turn != IDENTITY.quat else []
    joints = tuple((joint.name, positions[joint.name]) for joint in tree.moving_joints)
    return replace(pose, joints=joints, turns=tuple(turns))


def closed_pose(
    tree: Tree, loops: Sequence[Loop], pose: Keyframe, stated: Collection[str],
    rows: Mapping[str, int], last: Sequence[Collection[str]],
) -> Keyframe:  # fmt: skip
    """The pose with its unstated joints moved until all loops close.

    stated: joints whose value the keyframe states; rows: the recipe's row by the name of a loop,
    for the place of an error; last: joints that move only if the others do not suffice, the latest
    first. Stated joints but the first of `last` may be rough: which way the loops close is said by
    rounded values. Raises RowError with the gap that is left.
    """
    whole, start = _hinged(tree, pose)
    chain = joints_of(whole, loops)
    free = chain - set(stated)
    for index in range(len(last) + 1):
        unknown = free.difference(*last[: len(last) - index])
        solution = close(whole, loops, start, unknown)
        if solution.closed:
            return _posed(tree, pose, solution.positions)
    near = close(whole, loops, start, chain.difference(*last[:1]))
    rough = chain & set(stated)
    if near.closed and all(abs(near.positions[joint] - start[joint]) < ROUGHLY for joint in rough):
        return _posed(tree, pose, near.positions)
    raise _cannot_close(whole, loops, replace(pose, joints=tuple(start.items())), solution, rows)


def _cannot_close(
    tree: Tree, loops: Sequence[Loop], pose: Keyframe, solution: Solution, rows: Mapping[str, int]
) -> RowError:
    """Whose fault it is: that of a loop alone, or of the keyframe and the loops together."""
    for name, some in by_constraint(loops).items():
        chain = joints_of(tree, some)
        if not (best := close(tree, some, dict(pose.joints), chain)).closed:
            a, b = some[0].ends
            return RowError(
                f"loops: `{name}` cannot close: the nearest that its ends "
                f"`{a.body}` and `{b.body}` come is {best.residual:.4g} m",
                key=_place(rows, name),
                hint="check the frames of both ends, the lengths of the links and the axes",
            )
    name, residual = _widest(loops, tree, solution.positions)
    return RowError(
        f"keyframes.{pose.name}: loop `{name}` stays open by {residual:.4g} m with the values that "
        "the keyframe states",
        key=("keyframes", pose.name),
        hint="state driven joints alone; joints of the loop without a value are moved until it "
        "closes, unless two loops contradict each other",
    )


def _place(rows: Mapping[str, int], name: str) -> tuple[str | int, ...]:
    """The key of a loop in the recipe; of a source's the section."""
    return ("loops", rows[name]) if name in rows else ("loops",)


def _widest(loops: Sequence[Loop], tree: Tree, q: Mapping[str, float]) -> tuple[str, float]:
    return max(gaps(tree, loops, q).items(), key=lambda item: item[1])


def check_start(tree: Tree, loops: Sequence[Loop], start: Keyframe) -> None:
    """RowError where a robot without keyframes would start with an open loop."""
    name, residual = _widest(loops, *_hinged(tree, start))
    if residual >= CLOSED:
        raise RowError(
            f"loops: `{name}` is open by {residual:.4g} m where the joints are 0, and the recipe "
            "has no keyframe",
            key=("loops",),
            hint="add `keyframes: {home: {}}`: joints without a value are moved until the loops "
            "close",
        )


def check_locked(
    tree: Tree,
    loops: Sequence[Loop],
    pose: Keyframe,
    driven: Collection[str],
    rows: Mapping[str, int],
) -> None:
    """RowError for a driven joint that the loops keep from moving."""
    whole, q = _hinged(tree, pose)
    for joint in locked_joints(whole, loops, q, driven):
        name = next(loop.name for loop in loops if joint in joints_of(tree, (loop,)))
        raise RowError(
            f"loops: `{name}` locks joint `{joint}`, which is driven",
            key=_place(rows, name),
            hint="a loop must leave its driven joints a motion: check the axes, or hold less "
            "(`connect` in place of `weld`)",
        )


def solved_findings(before: Keyframe, after: Keyframe) -> Iterator[Finding]:
    """What a keyframe did not state and the loops decided."""
    was = dict(before.joints)
    moved = {name: q for name, q in after.joints if q != was[name]}
    if moved:
        shown = ", ".join(f"`{name}` {q:.4g}" for name, q in list(moved.items())[:6])
        more = ", ..." if len(moved) > 6 else ""
        yield SOLVED(
            "robot",
            f"keyframe `{after.name}`: {len(moved)} joints were moved until the loops close: "
            f"{shown}{more}",
            data={"keyframe": after.name, **moved},
        )


def source_findings(
    tree: Tree,
    loops: Sequence[Loop],
    keyframes: Sequence[Keyframe],
    start: Keyframe,
    driven: Collection[str],
) -> Iterator[Finding]:
    """How well the keyframes of an MJCF close its loops, and whether these lock a drive."""
    for key in keyframes:
        name, residual = _widest(loops, *_hinged(tree, key))
        if residual >= CLOSED:
            yield OPEN(
                "robot",
                f"keyframe `{key.name}` leaves loop `{name}` open by {residual:.3g} m, as in the "
                "source",
                severity="warning" if residual > VISIBLE_M else "info",
                data={"keyframe": key.name, "loop": name, "open": residual},
            )
    whole, q = _hinged(tree, start)
    for joint in locked_joints(whole, loops, q, driven):
        yield LOCKED(f"joint {joint}", "the loops leave this driven joint no motion")
