"""Keyframes of a robot with loops: moved until every loop closes, or refused with what is left."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

from assetbuild.findings import Finding, Rule
from assetbuild.robot.closure import CLOSED, Solution, close, gaps, locked_joints
from assetbuild.robot.loops import path_of
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Keyframe, Loop, LoopEnd, Tree
from assetbuild.robot.motors import RowError

VISIBLE_M = 1e-3
"""m or rad: a loop that a source's keyframe leaves open by more is a warning."""

SOLVED = Rule(
    "loop.home",
    "info",
    "joints that a keyframe does not state were moved until the loops close",
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


def placed_loops(tree: Tree, said: Sequence[Loop]) -> tuple[Loop, ...]:
    """Loops of a source, whose ends are links, on the bodies that these became part of."""

    def placed(end: LoopEnd) -> LoopEnd:
        body, X_body_link = tree.placement(end.body)
        return LoopEnd(body, X_body_link @ end.X_body_end)

    return tuple(replace(loop, a=placed(loop.a), b=placed(loop.b)) for loop in said)


def closed_pose(
    tree: Tree, loops: Sequence[Loop], pose: Keyframe, stated: Collection[str], own: Sequence[Loop],
    driven: Collection[str],
) -> Keyframe:  # fmt: skip
    """The pose with its unstated joints moved until all loops close; driven ones only if they must.

    stated: joints whose value the keyframe states; own: loops of the recipe, for the place of an
    error. Raises RowError with the gap that is left.
    """
    chain = {joint.name for loop in loops for joint in path_of(tree, loop)}
    free = chain - set(stated)
    for unknown in (free - set(driven), free):
        found = close(tree, loops, dict(pose.joints), unknown)
        if found.closed:
            return replace(pose, joints=tuple(found.positions.items()))
    raise _cannot_close(tree, loops, pose, found, own)


def _cannot_close(
    tree: Tree, loops: Sequence[Loop], pose: Keyframe, found: Solution, own: Sequence[Loop]
) -> RowError:
    """Whose fault it is: a loop's, two loops' together, or the keyframe's."""

    def at_best(some: Sequence[Loop]) -> Solution:
        chain = {joint.name for loop in some for joint in path_of(tree, loop)}
        return close(tree, some, dict(pose.joints), chain)

    names = [loop.name for loop in own]
    for loop in loops:
        if not (best := at_best([loop])).closed:
            index = (names.index(loop.name),) if loop.name in names else ()
            return RowError(
                f"loops: `{loop.name}` cannot close: the nearest that its ends "
                f"`{loop.a.body}` and `{loop.b.body}` come is {best.residual:.4g} m",
                key=("loops", *index),
                hint="check the frames of both ends, the lengths of the links and the axes",
            )
    for one, other in itertools.combinations(loops, 2):
        if not (best := at_best([one, other])).closed:
            index = (names.index(other.name),) if other.name in names else ()
            return RowError(
                f"loops: `{one.name}` and `{other.name}` contradict each other: each closes alone, "
                f"together they stay open by {best.residual:.4g} m",
                key=("loops", *index),
                hint="remove one of them, or correct its frames",
            )
    name, residual = _widest(tree, loops, found.positions)
    return RowError(
        f"keyframes.{pose.name}: loop `{name}` stays open by {residual:.4g} m with the values that "
        "the keyframe states",
        key=("keyframes", pose.name),
        hint="state driven joints alone; joints of the loop without a value are moved until it "
        "closes",
    )


def _widest(tree: Tree, loops: Sequence[Loop], q: Mapping[str, float]) -> tuple[str, float]:
    return max(gaps(tree, loops, q).items(), key=lambda item: item[1])


def check_start(tree: Tree, loops: Sequence[Loop], start: Keyframe) -> None:
    """RowError where a robot without keyframes would start with an open loop."""
    name, residual = _widest(tree, loops, dict(start.joints))
    if residual >= CLOSED:
        raise RowError(
            f"loops: `{name}` is open by {residual:.4g} m where the joints are 0, and the recipe "
            "has no keyframe",
            key=("loops",),
            hint="add `keyframes: {home: {}}`: joints without a value are moved until the loops "
            "close",
        )


def check_locked(
    tree: Tree, loops: Sequence[Loop], pose: Keyframe, driven: Collection[str]
) -> None:
    """RowError for a driven joint that the loops keep from moving."""
    for joint in locked_joints(tree, loops, dict(pose.joints), driven):
        index = next(i for i, p in enumerate(loops) if joint in {j.name for j in path_of(tree, p)})
        raise RowError(
            f"loops[{index}]: loop `{loops[index].name}` locks joint `{joint}`, which is driven",
            key=("loops", index),
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
    tree: Tree, loops: Sequence[Loop], keyframes: Sequence[Keyframe], driven: Collection[str]
) -> Iterator[Finding]:
    """How well the keyframes of an MJCF close its loops, and whether these lock a drive."""
    for key in keyframes:
        name, residual = _widest(tree, loops, with_mimics(tree, dict(key.joints)))
        if residual >= CLOSED:
            yield OPEN(
                "robot",
                f"keyframe `{key.name}` leaves loop `{name}` open by {residual:.3g} m, as in the "
                "source",
                severity="warning" if residual > VISIBLE_M else "info",
                data={"keyframe": key.name, "loop": name, "open": residual},
            )
    for key in keyframes[:1]:
        for joint in locked_joints(tree, loops, dict(key.joints), driven):
            yield LOCKED(f"joint {joint}", "the loops leave this driven joint no motion")
