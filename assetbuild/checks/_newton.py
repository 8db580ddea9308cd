"""The questions that Newton is asked as MuJoCo is: one class each, with the rule that it breaks.

Both have MuJoCo's dynamics, so that what is off is about what Newton read in the USD, or about a
default of its solver. Whether Newton holds the robot at all is the check `smoke_newton`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import ClassVar

from assetbuild.alignment.check import AlignmentCheck
from assetbuild.alignment.row import Row
from assetbuild.facts.held import Held, HeldModel
from assetbuild.findings import Rule
from assetbuild.policy.counting import OrdersCheck
from assetbuild.robot.model import Tree
from assetbuild.simulators import mujoco
from assetbuild.simulators.gripping import StageGripping
from assetbuild.simulators.loops import LoopCheck
from assetbuild.simulators.mujoco.pairs import explicit_pairs, touching_geoms
from assetbuild.simulators.newton import NewtonCheck
from assetbuild.simulators.slopes import SlopeCheck

CREEP = Rule(
    "newton.slope",
    "warning",
    "a standing robot slides in Newton on a slope below the angle of friction",
    "a shorter timestep: gravity tilts at once there, and what slides then may not stop; does the "
    "friction of its feet reach the USD?",
)
LOST = Rule(
    "newton.grip",
    "warning",
    "a gripper loses an object in Newton, or lets it slip",
    "more effort, stiffer contacts of the fingers; Newton's own cone is pyramidal",
)
OFF = Rule(
    "alignment.newton.*",
    ("warning", "error"),
    "a row of the comparison of Newton with MuJoCo is off (an error beyond the coarse limit)",
    "read the report's table of `newton_alignment`",
)
FAILED_RUN = Rule(
    "alignment.newton.run",
    "error",
    "Newton refuses the USD, or an experiment went to infinity in it",
    "the message is Newton's",
)


class NewtonOrders(OrdersCheck, NewtonCheck):
    """Does Newton count the joints of `usd/<robot>.usda` as the policy's contract says?"""

    own_name = "newton_orders"
    order: ClassVar[str] = "newton"


class NewtonLoops(LoopCheck, NewtonCheck):
    """Swings the driven joints of `usd/<robot>.usda` in Newton and measures every gap."""

    own_name = "newton_loops"


class NewtonSlope(SlopeCheck, NewtonCheck):
    """Does in Newton what `slope` does in MuJoCo, whose model says how steep it may be."""

    own_name = "newton_slope"
    creeps: ClassVar[Rule] = CREEP


class NewtonGripping(StageGripping, NewtonCheck):
    """Does each gripper of `usd/<robot>.usda` hold objects in Newton as well?"""

    own_name = "newton_grip"
    lost: ClassVar[Rule] = LOST


class NewtonAlignment(AlignmentCheck, NewtonCheck):
    """`mjcf/` in MuJoCo and `usd/` in Newton: how they fall, follow, stand, land, and touch."""

    own_name = "newton_alignment"
    off: ClassVar[Rule] = OFF
    failed: ClassVar[Rule] = FAILED_RUN

    def held_rows(self, model: mujoco.Model, held: Held, tree: Tree) -> Iterator[Row]:
        """Newton's solver is MuJoCo's, so its masks say what may touch."""
        yield touching_row(model, HeldModel(held), tree)


# --- which bodies may touch one another in MuJoCo, and which in Newton's solver -----------------


SHOWN = 3
Pairs = set[frozenset[str]]
"""A pair of bodies, by name."""


def touching_row(model: mujoco.Model, newton: mujoco.Model, tree: Tree) -> Row:
    """Off: number of pairs of bodies that may touch in one engine alone.

    A contact that only one engine has is an error, but for those that Newton cannot have: between
    the two bodies of a joint, and where an MJCF asks for it by a `<pair>`.
    """
    ours, theirs = (
        _named(each, (*touching_geoms(each), *explicit_pairs(each)), tree)
        for each in (model, newton)
    )
    asked = _named(model, explicit_pairs(model), tree)
    jointed = {frozenset((joint.parent, joint.child)) for joint in tree.joints}
    here, there = ours - theirs, theirs - ours
    impossible = not there and here <= jointed | asked
    return Row(
        "self_collision",
        "HIGH",
        "robot",
        _told(ours, here),
        _told(theirs, there),
        float(len(here) + len(there)),
        0.0,
        0.5,
        "pairs",
        because="Newton has no contacts between the bodies of a joint, nor `<pair>`"
        if impossible
        else "",
        advice="`collision.exclude.adjacent: true` lets both engines ignore them",
    )


def _named(model: mujoco.Model, pairs: Iterable[tuple[int, int]], tree: Tree) -> Pairs:
    names = {name: body for body, name in mujoco.body_names(tree).items()}
    named_pairs: Pairs = set()
    for pair in pairs:
        bodies = [int(model.geom_bodyid[geom]) for geom in pair]
        if all(bodies):  # 0 is the world
            body_names = (mujoco.name_of(model, "body", body) for body in bodies)
            named_pairs.add(frozenset(names.get(name, name) for name in body_names))
    return named_pairs


def _told(pairs: Pairs, alone: Pairs) -> str:
    listed = [" and ".join(f"`{name}`" for name in sorted(pair)) for pair in alone]
    more = f", and {len(listed) - SHOWN} more" if len(listed) > SHOWN else ""
    only = f" (here alone: {', '.join(sorted(listed)[:SHOWN])}{more})" if listed else ""
    return f"{len(pairs)} pairs of bodies may touch{only}"
