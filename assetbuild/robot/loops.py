"""Closed loops of a recipe, resolved on the bodies of a tree."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from assetbuild.errors import Gather
from assetbuild.recipe_types import Model, Name, Positive, Real, Turns
from assetbuild.robot.actuator_table import RowError
from assetbuild.robot.model import MOVING, Joint, Loop, LoopEnd, Tree
from assetbuild.robot.pose import Pose, quat_of_rpy, vec3
from assetbuild.robot.tree import chain_to, link_names, link_placement

AXIS = "_axis"
"""Ending of the name of the second `connect` of a hinge."""
HINGE_M = 0.1
"""From the one point of a hinge's axis that is held to the other."""
HINT_SAME = "a loop closes a chain of joints: name two links with moving joints between them"


FAR = 1e4
"""m, rad: no coordinate of a loop is larger; squares of far larger ones overflow."""
Near = Annotated[Real, Field(ge=-FAR, le=FAR)]
Impedance = Annotated[Real, Field(ge=1e-4, le=0.9999)]
"""MuJoCo cuts an impedance beyond these bounds without a word."""


class LoopFrame(Model):
    """A frame on a link, by which a loop holds it."""

    link: str = Field(description="link of the source, before merging")
    xyz: tuple[Near, Near, Near] = Field((0.0, 0.0, 0.0), description="in the link, m")
    rpy: Turns = Field(
        (0.0, 0.0, 0.0), description="roll, pitch, yaw in the link, rad; a `connect` ignores it"
    )


class LoopRow(Model):
    """One closed kinematic loop: what holds two links of the tree together."""

    name: Name = Field(description="name of the constraint, and of its sites `<name>_a`, `_b`")
    kind: Literal["connect", "weld", "hinge"] = Field(
        "connect",
        description="connect: two points stay together, as in a ball joint; weld: two frames; "
        "hinge: two axes, by a second `connect` `<name>_axis` that is 0.1 m along them",
    )
    a: LoopFrame = Field(description="the frame on one side")
    b: LoopFrame = Field(description="the frame on the other side, which is to meet the first")
    solref: tuple[Positive, Positive] = Field(
        (0.005, 1.0), description="MuJoCo's softness: time constant in s, damping ratio"
    )
    solimp: tuple[Impedance, Impedance, Positive, Impedance, Annotated[Real, Field(ge=1.0)]] = (
        Field((0.999, 0.9999, 0.001, 0.5, 2.0), description="MuJoCo's impedance of the constraint")
    )
    axis: tuple[Near, Near, Near] | None = Field(
        None, description="of a hinge: its direction, in frame a as well as in frame b"
    )

    urdf: Literal["open", "mimic"] = Field(
        "open",
        description="in the URDF, which has no loops: open leaves the tree open; mimic lets each "
        "joint of the loop follow its one driven joint linearly, and reports the error",
    )

    @model_validator(mode="after")
    def _axis_of_hinge(self) -> Self:
        if (self.axis is not None) != (self.kind == "hinge"):
            raise ValueError("a hinge has an `axis`, and no other kind has one")
        if self.axis is not None and not np.linalg.norm(self.axis) > 1e-9:
            raise ValueError("`axis` has no direction")
        return self

    @property
    def loops(self) -> tuple[Loop, ...]:
        """What holds the links, whose names the ends have: of a hinge two points of its axis."""
        a, b = (
            LoopEnd(frame.link, Pose(frame.xyz, quat_of_rpy(*frame.rpy)))
            for frame in (self.a, self.b)
        )
        if self.axis is None:
            kind: Literal["connect", "weld"] = "weld" if self.kind == "weld" else "connect"
            return (Loop(self.name, kind, a, b, self.solref, self.solimp, urdf=self.urdf),)
        along = Pose(vec3(HINGE_M * np.asarray(self.axis) / np.linalg.norm(self.axis)))
        point = Loop(self.name, "connect", a, b, self.solref, self.solimp, urdf=self.urdf)
        a, b = (LoopEnd(end.body, end.X_body_end @ along) for end in (a, b))
        return point, replace(point, name=self.name + AXIS, a=a, b=b)


def resolve_loops(tree: Tree, rows: Sequence[LoopRow]) -> tuple[Loop, ...]:
    """The loops on the bodies that their links became part of; of a hinge there are two.

    Raises RowError for an unknown link, a second loop of a name, and ends that nothing moves apart.
    """
    wrong, resolved = Gather(RowError), list[Loop]()
    for index, row in enumerate(rows):
        with wrong:
            if {loop.name for loop in row.loops} & {loop.name for loop in resolved}:
                message = f"loops[{index}]: a second loop is named `{row.name}`"
                raise RowError(message, key=("loops", index, "name"), hint="choose another name")
            for side, frame in (("a", row.a), ("b", row.b)):
                key = ("loops", index, side, "link")
                link_placement(tree, frame.link, f"loops[{index}].{side}", key)
            placed = tuple(placed_loop(tree, loop) for loop in row.loops)
            if not _between(tree, placed[0]):
                message = f"loops[{index}]: no joint moves between `{row.a.link}` and "
                message += f"`{row.b.link}`, so loop `{row.name}` holds nothing"
                raise RowError(message, key=("loops", index), hint=HINT_SAME)
            resolved += placed
    wrong.stop()
    return tuple(resolved)


def placed_loop(tree: Tree, loop: Loop) -> Loop:
    """A loop between links, on the bodies that these became part of. KeyError: no such link."""

    def placed(end: LoopEnd) -> LoopEnd:
        body, X_body_link = tree.placement(end.body)
        return LoopEnd(body, X_body_link @ end.X_body_end)

    return replace(loop, a=placed(loop.a), b=placed(loop.b))


def row_numbers(rows: Sequence[LoopRow]) -> dict[str, int]:
    """The number of the row by the name of each loop that it makes."""
    return {loop.name: number for number, row in enumerate(rows) for loop in row.loops}


def by_constraint(loops: Iterable[Loop]) -> dict[str, tuple[Loop, ...]]:
    """The loops by name, and of a hinge both under its own."""
    by_name = dict[str, tuple[Loop, ...]]()
    for loop in loops:
        of_hinge = loop.name.removesuffix(AXIS)
        name = of_hinge if of_hinge in by_name else loop.name
        by_name[name] = (*by_name.get(name, ()), loop)
    return by_name


def site_names(tree: Tree, loops: Sequence[Loop]) -> dict[str, tuple[str, str]]:
    """The names of the sites at both ends of each loop in MJCF, none of which a frame has."""
    taken = set(link_names(tree))
    sites = {}
    for loop in loops:
        tail = ""
        while taken & {f"{loop.name}_a{tail}", f"{loop.name}_b{tail}"}:
            tail += "_"
        sites[loop.name] = (f"{loop.name}_a{tail}", f"{loop.name}_b{tail}")
        taken |= set(sites[loop.name])
    return sites


def joints_of(tree: Tree, loops: Iterable[Loop]) -> set[str]:
    """Names of the moving joints of the tree between the two bodies of each of these loops."""
    between = (joint for loop in loops for joint in _between(tree, loop))
    return {joint.name for joint in between if joint.kind in MOVING}


def _between(tree: Tree, loop: Loop) -> set[Joint]:
    """All joints but fixed ones."""
    a, b = (set(chain_to(tree, end.body)) for end in loop.ends)
    return {joint for joint in a ^ b if joint.kind != "fixed"}
