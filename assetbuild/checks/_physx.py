"""What PhysX is asked: does it hold the robot and its numbers, and what MuJoCo is asked too."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from assetbuild.alignment.check import AlignmentCheck
from assetbuild.engine.step import Files
from assetbuild.facts.compare import differences, equality_findings
from assetbuild.facts.held import PHYSX, Held, physx_expected, physx_table
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Table
from assetbuild.findings import Finding, Rule, known
from assetbuild.plugin_types import write_figures
from assetbuild.policy.counting import OrdersCheck
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.mjcf_only import whole_gravity
from assetbuild.robot.model import Control, Tree
from assetbuild.simulators import physx
from assetbuild.simulators.experiments import Experiment, Outcome, load, standing
from assetbuild.simulators.free_fall import FreeFallCheck
from assetbuild.simulators.gripping import StageGripping
from assetbuild.simulators.loops import LoopCheck
from assetbuild.simulators.physx import FREE_FALL, ITERATIONS, PhysxCheck
from assetbuild.simulators.physx import couplings as physx_couplings
from assetbuild.simulators.slopes import SlopeCheck

CREEP = Rule(
    "physx.slope",
    "warning",
    "a standing robot slides in PhysX on a slope below the angle of friction",
    "are its drives too weak to hold it? does the friction of its feet reach the USD?",
)
LOST = Rule(
    "physx.grip",
    "warning",
    "a gripper loses an object in PhysX, or lets it slip",
    "more effort, collision pieces that do not fill the space between the fingers",
)
OFF = Rule(
    "alignment.physx.*",
    ("warning", "error"),
    "a row of the comparison with MuJoCo is off (an error beyond the coarse limit); the how-to "
    "on Isaac Lab describes the rows",
    "read the report's table of `alignment`",
)
FAILED_RUN = Rule(
    "alignment.physx.run",
    "error",
    "an experiment crashed or went to infinity",
    "see `physx.finite`",
)


class PhysxFreeFall(FreeFallCheck, PhysxCheck):
    """Compares the drop of the centre of mass with g/2 t (t + dt/N), N position iterations."""

    own_name = "physx_free_fall"
    recipe_fields: ClassVar[Mapping[str, str]] = ITERATIONS
    wrong: ClassVar[Rule] = FREE_FALL
    rounding: ClassVar[float] = 1e-6

    iterations: int = 8
    """Position iterations of the solver, as the USD target writes them."""

    def carried(self, control: Control) -> Mapping[str, float]:
        """All of it or nothing."""
        return dict.fromkeys(whole_gravity(control.mjcf_only), 1.0)


class PhysxOrders(OrdersCheck, PhysxCheck):
    """Does PhysX, and so Isaac Lab, count the joints as the policy's contract says?"""

    own_name = "physx_orders"
    order: ClassVar[str] = "isaaclab"


class PhysxLoops(LoopCheck, PhysxCheck):
    """Swings the driven joints of `usd/<robot>.usda` in PhysX and measures every gap."""

    own_name = "physx_loops"


class PhysxSlope(SlopeCheck, PhysxCheck):
    """Does in PhysX what `slope` does in MuJoCo, whose model says how steep it may be."""

    own_name = "physx_slope"
    creeps: ClassVar[Rule] = CREEP


class PhysxGripping(StageGripping, PhysxCheck):
    """Does each gripper of `usd/<robot>.usda` hold objects in PhysX as well?"""

    own_name = "physx_grip"
    lost: ClassVar[Rule] = LOST


class Alignment(AlignmentCheck, PhysxCheck):
    """`mjcf/` in MuJoCo and `usd/` in PhysX: how they fall, follow, stand and land."""

    own_name = "alignment"
    usual_s = 60.0
    engines: ClassVar[tuple[str, ...]] = ("mujoco", "physx")
    recipe_fields: ClassVar[Mapping[str, str]] = {**AlignmentCheck.recipe_fields, **ITERATIONS}
    off: ClassVar[Rule] = OFF
    failed: ClassVar[Rule] = FAILED_RUN

    iterations: int = 8
    """Position iterations of PhysX's solver."""


START = Rule(
    "physx.start",
    "error",
    "a joint starts outside its limits, where PhysX goes to NaN",
    "correct the initial keyframe: `home`, else the first",
)
DRIFT = Rule(
    "physx.drift",
    "error",
    "a fixed base moved",
    "the articulation root must be on the joint with the world",
)


class PhysxReadback(physx.PhysxCheck):
    """`usd/<robot>.usda` in PhysX: bodies, joints, gains, limits; then 5 s on a floor."""

    own_name = "physx_readback"
    reads: ClassVar[tuple[str, ...]] = Reader.reads
    recipe_fields: ClassVar[Mapping[str, str]] = {
        "drive_type": "usd.drive_type",
        "mimics": "usd.mimics",
    }

    seconds: float = 5.0
    """How long it must keep its numbers on the floor."""
    drive_type: str = "force"
    """Or `acceleration`."""
    mimics: bool = True
    """Whether the USD couples the joints that mimic others."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: what PhysX holds, joint by joint, beside the robot's."""
        robot = Reference.of_ports(files.inputs, {})
        tree, control = robot.tree, robot.control
        loaded, start, dt = load(control), initial_pose(tree, control), control.simulation.timestep
        floor = replace(standing(tree, control), drives=None)
        on_floor = floor if tree.base == "floating" and start.name else loaded.setting
        steps, joints = round(self.seconds / dt), dict(start.joints)
        experiments = (
            loaded,
            Experiment("alone", loaded.setting, steps=round(0.2 / dt), every=10),
            Experiment("floor", on_floor, steps=steps, every=10, start=joints),
        )
        coupled = physx_couplings.experiments(tree, control) if self.mimics else ()
        outcomes = self.perform(files.inputs, (*experiments, *coupled))
        held = outcomes["load"].held
        if held is None:
            write_figures(files, {"loaded": False})
            yield physx.LOAD(
                "robot", f"PhysX does not load it: {outcomes['load'].failure or 'it holds nothing'}"
            )
            return
        table = physx_table(held, tree, physx_couplings.measured(tree, outcomes))
        alone, moved = outcomes["alone"], outcomes["floor"]
        write_figures(
            files,
            {
                **{word: held[word] for word in ("articulations", "dof", "shapes", "fixed_base")},
                "bodies": len(held["bodies"]),
                "mass_kg": known(sum(link["mass"][0] for link in held["bodies"].values())),
                "finite_alone": alone.finite,
                "finite_on_floor": moved.finite,
                "joints": {
                    name: {
                        word: known(value)
                        for word, value in table.of("joint", name).items()
                        if isinstance(value, float | None)
                    }
                    for name in held["joints"]
                },
            },
        )
        expected = physx_expected(robot, drive_type=self.drive_type, mimics=self.mimics)
        yield from _differing(held, table, expected)
        for experiment, where in zip(
            experiments[1:], ("as the asset starts, without a floor", "on a floor"), strict=True
        ):
            yield from _judge_motion(tree, outcomes[experiment.name], where)


def _differing(held: Held, table: Table, expected: Table) -> Iterator[Finding]:
    """Everything that PhysX holds against the robot."""
    if held["articulations"] != 1:
        yield physx.ARTICULATION("robot", f"PhysX holds {held['articulations']} articulations")
    for name in held["loose"]:
        yield physx.LOOSE_BODY(f"link {name}", "PhysX holds it outside of the articulation")
    yield from equality_findings(differences(expected, table, PHYSX), "physx", "PhysX", {})
    for name, joint in held["joints"].items():
        at = joint["start"]
        low = -math.inf if joint["lower"] is None else joint["lower"]
        high = math.inf if joint["upper"] is None else joint["upper"]
        if not low - 1e-5 <= at <= high + 1e-5:
            yield START(
                f"joint {name}",
                f"starts at {at:.5g} in PhysX, outside of {low:.5g}..{high:.5g}",
                data={"position": at},
            )


def _judge_motion(tree: Tree, outcome: Outcome, where: str) -> Iterator[Finding]:
    if not outcome.finite:
        failure = outcome.failure or "its state is not finite"
        yield physx.NOT_FINITE("robot", f"{where}: {failure}")
    elif outcome.motion is not None and tree.base == "fixed":
        drift = float(np.abs(outcome.motion.root - outcome.motion.root[0]).max())
        if drift > 0.0:
            yield DRIFT(
                "robot",
                f"{where}: its fixed base drifted by {drift:.3g} m",
                data={"drift_m": drift},
            )
