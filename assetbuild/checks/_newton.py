"""What Newton is asked: does it read the same robot from our files, and what MuJoCo is asked too.

In Newton's own environment (MuJoCo 3.17). Both have MuJoCo's dynamics, so that what is off is about
what Newton read, or about a default of its solver.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from assetbuild.alignment.check import AlignmentCheck
from assetbuild.alignment.row import Row
from assetbuild.engine.step import Files
from assetbuild.facts.compare import differences, equality_findings
from assetbuild.facts.held import NEWTON, Held, HeldModel, newton_expected, newton_table
from assetbuild.facts.reference import Reference
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.policy.counting import OrdersCheck
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.simulators import mujoco, stages
from assetbuild.simulators.consumers import FAILED, NOT_FINITE
from assetbuild.simulators.experiments import Experiment, Outcome, StageNames, load
from assetbuild.simulators.gripping import StageGripping
from assetbuild.simulators.loops import LoopCheck
from assetbuild.simulators.mujoco.pairs import explicit_pairs, touching_geoms
from assetbuild.simulators.newton import NewtonCheck
from assetbuild.simulators.slopes import SlopeCheck
from assetbuild.simulators.usd_names import body_identifiers, joint_identifiers, usd_identifiers

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
        _pairs_text(ours, here),
        _pairs_text(theirs, there),
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


def _pairs_text(pairs: Pairs, alone: Pairs) -> str:
    listed = [" and ".join(f"`{name}`" for name in sorted(pair)) for pair in alone]
    more = f", and {len(listed) - SHOWN} more" if len(listed) > SHOWN else ""
    only = f" (here alone: {', '.join(sorted(listed)[:SHOWN])}{more})" if listed else ""
    return f"{len(pairs)} pairs of bodies may touch{only}"


LIGHT = (
    "Newton adds 1e-6 kg m2 to all moments of a body whose least is below 1e-10 kg m2, or below "
    "1e-6 of its largest: the edits `set_inertia`, or `share_mass` with `moments: 2e-10`"
)


class SmokeNewton(NewtonCheck):
    """Loads `usd/<robot>.usda` and `mjcf/<robot>.xml`, reads them back, steps them."""

    own_name = "smoke_newton"
    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "shapes.json", "control.json")
    recipe_fields: ClassVar[Mapping[str, str]] = {"mimics": "usd.mimics"}

    steps: int = 100
    mimics: bool = True
    """Whether the USD couples the joints that mimic others."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: bodies, joints and numbers compared, per format."""
        robot = RobotFiles(files.inputs)
        paths = {"usd": f"usd/{self.robot}.usda", "mjcf": f"mjcf/{self.robot}.xml"}
        runs = [
            # Not resolved: the inputs are links into the store.
            run_of(kind, (files.inputs / path).absolute(), robot, self.steps)
            for kind, path in paths.items()
        ]
        with tempfile.TemporaryDirectory(prefix="newton-") as folder:
            seconds = self.limits.wall_s / 2.0
            done = stages.answers(self.start, Path(folder).resolve(), runs, seconds)
        figures: dict[str, object] = {}
        summaries = []
        for kind, outcome in done.items():
            findings = [*evaluate(kind, outcome, robot, mimics=self.mimics)]
            yield from findings
            held = outcome.held
            figures[kind] = outcome.failure if held is None else {
                "mass_kg": round(math.fsum(held["body_mass"]), 4),
                "dof": held["nv"],
                "joints": sum(kind in (2, 3) for kind in held["jnt_type"]),  # slide, hinge
                "differences": len(findings),
            }  # fmt: skip
            what = "refused" if held is None else f"{len(findings)} differences"
            summaries.append(f"{kind.upper()}: {what}")
        write_figures(
            files, figures | {"summary": f"read back and stepped: {', '.join(summaries)}"}
        )


def run_of(name: str, file: Path, robot: RobotFiles, steps: int) -> dict[str, object]:
    """Read a file and step it; with the robot's names by those of the file."""
    solid = usd_identifiers(shape.name for shape in robot.shapes.shapes)
    named = [body_identifiers(robot.tree), joint_identifiers(robot.tree), solid]
    if file.suffix == ".xml":  # of an MJCF's names Newton changes `-` alone
        named = [{n: n.replace("-", "_") for n in names} for names in named]
    bodies, joints, shapes = ({ours: n for n, ours in names.items()} for names in named)
    asked = Experiment(name, load(robot.control).setting, steps, every=steps)
    run = stages.run_of(asked, StageNames(bodies, joints, frozenset()), file)
    return run | {"reads": True, "shapes": shapes}


def evaluate(
    kind: str, done: Outcome, robot: RobotFiles, *, mimics: bool = True
) -> Iterator[Finding]:
    """What Newton holds of one file, beside the robot; separate, to be tried on bad readings."""
    if done.held is None:
        yield FAILED(
            "robot",
            f"Newton does not take the {kind.upper()}: {done.failure}",
            hint="the message is Newton's; `mjcf: {solver: Newton}` where it knows no PGS",
        )
        return
    if not done.finite:
        message = f"Newton: the {kind.upper()} steps to numbers that are not finite"
        yield NOT_FINITE("robot", message, "a gain or timestep too large?")
    alike, tree = kind == "mjcf", robot.tree
    table = newton_expected(
        Reference(tree, tree, control=robot.control),
        robot.shapes,
        coupled=alike or mimics,
        usd=not alike,
    )
    held = newton_table(done.held).only(
        lambda key: (
            key in table.facts or not (key.kind == "shape" or key.quantity == "newton:solreflimit")
        )
    )
    mismatches = differences(table, held, NEWTON)
    for finding in equality_findings(
        mismatches, "newton", f"the {kind.upper()} as Newton holds it", {}
    ):
        light = finding.rule.endswith(".inertia")
        yield replace(finding, hint=LIGHT) if light else finding
