"""Closed loops of a recipe, resolved on the bodies of a tree."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from pydantic import Field

from assetbuild.errors import Gather, did_you_mean
from assetbuild.quantities import Model, Name, Positive, Real
from assetbuild.robot.model import Joint, Loop, LoopEnd, Tree
from assetbuild.robot.motors import RowError
from assetbuild.robot.pose import Pose, quat_of_rpy

HINT_SAME = "a loop closes a chain of joints: name two links with moving joints between them"


class LoopFrame(Model):
    """A frame on a link, by which a loop holds it."""

    link: str = Field(description="link of the source, before merging")
    xyz: tuple[Real, Real, Real] = Field((0.0, 0.0, 0.0), description="in the link, m")
    rpy: tuple[Real, Real, Real] = Field(
        (0.0, 0.0, 0.0), description="roll, pitch, yaw in the link, rad; a `connect` ignores it"
    )


class LoopRow(Model):
    """One closed kinematic loop: what holds two links of the tree together."""

    name: Name = Field(description="name of the constraint, and of its sites `<name>_a`, `_b`")
    kind: Literal["connect", "weld"] = Field(
        "connect",
        description="connect: two points stay together, as in a ball joint; weld: two frames",
    )
    a: LoopFrame = Field(description="the frame on one side")
    b: LoopFrame = Field(description="the frame on the other side, which is to meet the first")
    solref: tuple[Positive, Positive] = Field(
        (0.005, 1.0), description="MuJoCo's softness: time constant in s, damping ratio"
    )
    solimp: tuple[Real, Real, Positive, Real, Positive] = Field(
        (0.999, 0.9999, 0.001, 0.5, 2.0), description="MuJoCo's impedance of the constraint"
    )


def resolve_loops(tree: Tree, rows: Sequence[LoopRow]) -> tuple[Loop, ...]:
    """The loops on the bodies that their links became part of.

    Raises RowError for an unknown link, a second loop of a name, and ends that nothing moves apart.
    """
    wrong, found = Gather(RowError), list[Loop]()
    for index, row in enumerate(rows):
        with wrong:
            if row.name in {loop.name for loop in found}:
                message = f"loops[{index}]: a second loop is named `{row.name}`"
                raise RowError(message, key=("loops", index, "name"), hint="choose another name")
            a, b = _end(tree, index, "a", row.a), _end(tree, index, "b", row.b)
            loop = Loop(row.name, row.kind, a, b, row.solref, row.solimp)
            if not _joints_between(tree, loop):
                message = f"loops[{index}]: no joint moves between `{row.a.link}` and "
                message += f"`{row.b.link}`, so loop `{row.name}` holds nothing"
                raise RowError(message, key=("loops", index), hint=HINT_SAME)
            found.append(loop)
    wrong.stop()
    return tuple(found)


def _end(tree: Tree, index: int, side: str, frame: LoopFrame) -> LoopEnd:
    try:
        body, X_body_link = tree.placement(frame.link)
    except KeyError:
        known = [body.name for body in tree.bodies] + [frame.name for frame in tree.frames]
        raise RowError(
            f"loops[{index}].{side}: no link `{frame.link}`",
            key=("loops", index, side, "link"),
            hint=did_you_mean(frame.link, known),
        ) from None
    return LoopEnd(body, X_body_link @ Pose(frame.xyz, quat_of_rpy(*frame.rpy)))


def site_names(tree: Tree, loops: Sequence[Loop]) -> dict[str, tuple[str, str]]:
    """The names of the sites at both ends of each loop in MJCF, none of which a frame has."""
    taken = {body.name for body in tree.bodies} | {frame.name for frame in tree.frames}
    found = {}
    for loop in loops:
        tail = ""
        while taken & {f"{loop.name}_a{tail}", f"{loop.name}_b{tail}"}:
            tail += "_"
        found[loop.name] = (f"{loop.name}_a{tail}", f"{loop.name}_b{tail}")
        taken |= set(found[loop.name])
    return found


def path_of(tree: Tree, loop: Loop) -> tuple[Joint, ...]:
    """The moving joints of the tree between the two bodies of a loop, in tree order."""
    between = _joints_between(tree, loop)
    return tuple(joint for joint in tree.moving_joints if joint.name in between)


def _joints_between(tree: Tree, loop: Loop) -> set[str]:
    """All joints but fixed ones."""
    above = [dict(_joints_above(tree, end.body)) for end in loop.ends]
    apart = above[0].keys() ^ above[1].keys()
    return {name for name in apart if tree.by_joint[name].kind != "fixed"}


def _joints_above(tree: Tree, body: str) -> list[tuple[str, Joint]]:
    found = []
    while (joint := tree.joint_above.get(body)) is not None:
        found.append((joint.name, joint))
        body = joint.parent
    return found
