"""Loops that the names or places of a URDF's frames show, and which of their joints are driven.

Exporters that cut a loop leave a frame on both sides of the cut: `closedloop1_A` and `_B`,
`closing_knee_1` and `_2`, `constraint_A`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from assetbuild.init.draft import Draft, some
from assetbuild.init.drives import DriveRow
from assetbuild.init.look import InspectedRobot
from assetbuild.robot.actuator_table import RowError
from assetbuild.robot.closure import close, coordinates, locked_joints
from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.loops import LoopRow, path_of, resolve_loops
from assetbuild.robot.model import Loop, Tree

LOOP = re.compile(r"clos|loop|constraint|fermeture", re.IGNORECASE)
MOTOR = re.compile(r"mot|act|driv|crank|servo", re.IGNORECASE)
SIDES = (("A", "B"), ("a", "b"), ("1", "2"))


@dataclass(frozen=True)
class FoundLoops:
    """What is proposed. rows: of the recipe; passive: joints that the loops move.

    chain: all joints of the loops; remarks: what else looks like a loop, for comments.
    """

    rows: tuple[LoopRow, ...] = ()
    passive: frozenset[str] = frozenset()
    chain: frozenset[str] = frozenset()
    remarks: tuple[str, ...] = ()

    def drives(self, rows: tuple[DriveRow, ...]) -> tuple[DriveRow, ...]:
        """The drives, and one row for the joints that the loops move."""
        moved = tuple(sorted(self.passive))
        row = DriveRow(moved, None, None, "rad", 0.0, role="loop")
        return (*rows, row) if moved else rows

    def closed(
        self, tree: Tree, pose: Mapping[str, float]
    ) -> tuple[tuple[Loop, ...], Mapping[str, float]]:
        """The loops on this tree, and the pose in which a build closes them."""
        if not self.rows:
            return (), pose
        loops = resolve_loops(tree, self.rows)
        return loops, close(tree, loops, self.pose(pose), self.chain).positions

    def pose(self, pose: Mapping[str, float]) -> dict[str, float]:
        """The pose without joints of loops, which a build moves until these close."""
        return {name: value for name, value in pose.items() if name not in self.chain}

    def put(self, draft: Draft) -> None:
        """The section `loops`."""
        for row in self.rows:
            ends = row.model_dump(exclude_defaults=True)
            draft.add({"name": row.name, "kind": row.kind, **ends}, "loops")
        if self.rows:
            why = "as the frames or joints are called; joints without a drive follow"
            draft.beside["loops",] = why
        draft.note(*self.remarks, at=("loops",))


NO_LOOPS = FoundLoops()


def find_loops(robot: InspectedRobot) -> FoundLoops:
    """Pairs of frames that are named as the two sides of a cut and can meet; all others said."""
    tree = robot.tree
    rows, remarks = list[LoopRow](), list[str]()
    for stem, one, other in _pairs(robot.links):
        row, why = _row(tree, stem, one, other)
        if row is not None:
            rows.append(row)
        else:
            remarks.append(f"`{one}` and `{other}` are named as the ends of a loop, but {why}")
    if not rows:
        return FoundLoops(remarks=tuple(remarks))
    loops = resolve_loops(tree, rows)
    chain = {joint.name for loop in loops for joint in path_of(tree, loop)}
    solution = close(tree, loops, {}, chain)
    if not solution.closed:
        names = some([row.name for row in rows])
        remark = f"loops {names} stay open together, by {solution.residual:.3g} m"
        return FoundLoops(remarks=(*remarks, remark))
    stated = {joint.name for joint in tree.moving_joints if joint.limits.effort} & chain
    motors = {name for name in chain if MOTOR.search(name)} or stated
    robot_now = dynamics(tree, solution.positions, {})
    chosen = coordinates(loops, robot_now, motors)
    free = {name for name in chain & set(robot_now.joints) if robot_now.column(name) in chosen}
    driven = (free & motors) or free
    led = {joint.name for joint in tree.moving_joints if joint.mimic is not None}
    return FoundLoops(
        tuple(rows), frozenset(chain - driven - led), frozenset(chain), tuple(remarks)
    )


def _pairs(links: Tree) -> Iterator[tuple[str, str, str]]:
    """(name of the loop, link, link) of two links whose names differ in the side alone."""
    names = {body.name for body in links.bodies if LOOP.search(body.name)}
    taken: set[str] = set()
    for first, second in SIDES:
        for name in sorted(names):
            for at in [m.start() for m in re.finditer(re.escape(first), name)]:
                if not _stands_alone(name, at, first):
                    continue
                other = name[:at] + second + name[at + 1 :]
                if other in names and not {name, other} & taken:
                    taken |= {name, other}
                    stem = (name[:at].rstrip("_-") + name[at + 1 :]).strip("_-")
                    yield re.sub(r"[^A-Za-z0-9_.-]", "_", stem), name, other


def _stands_alone(name: str, at: int, side: str) -> bool:
    """A side is a letter or digit of its own: `_A`, `1A`, `_2`, not one of a word or number."""
    before, after = name[at - 1 : at], name[at + 1 : at + 2]
    if side.isdigit():
        return before in ("_", "-") and not after
    return not before.isalpha() and not after.isalnum()


def _row(tree: Tree, stem: str, one: str, other: str) -> tuple[LoopRow | None, str]:
    """A weld where that leaves every joint of the loop a motion, else a connect; or why not."""
    why = ""
    for kind in ("weld", "connect"):
        keys = {"name": stem, "kind": kind, "a": {"link": one}, "b": {"link": other}}
        row = LoopRow.model_validate(keys)
        try:
            loops = resolve_loops(tree, (row,))
        except RowError:
            return None, "no joint moves between them"
        chain = [joint.name for joint in path_of(tree, loops[0])]
        solution = close(tree, loops, {}, chain)
        if not solution.closed:
            why = f"they come no nearer than {solution.residual:.3g} m"
        elif kind == "connect" or not locked_joints(tree, loops, solution.positions, chain):
            return row, ""
    return None, why
