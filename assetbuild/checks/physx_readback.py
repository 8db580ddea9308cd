"""Loaded into real PhysX, is it still the robot? And does it keep its numbers for five seconds?"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from assetbuild.engine.step import Files
from assetbuild.facts.compare import differences, equality_findings
from assetbuild.facts.held import PHYSX, Held, physx_expected, physx_table
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Table
from assetbuild.findings import Finding, Rule, known
from assetbuild.plugin_types import write_figures
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Tree
from assetbuild.simulators import physx
from assetbuild.simulators.experiments import Experiment, Outcome, load, standing
from assetbuild.simulators.physx import couplings as physx_couplings

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
