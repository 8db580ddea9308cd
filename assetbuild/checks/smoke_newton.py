"""Does Newton read the same robot from the USD and from the MJCF, and does it step?

In Newton's own environment (MuJoCo 3.17). The dynamics are MuJoCo's: this judges what is read.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.facts.compare import differences, equality_findings
from assetbuild.facts.held import NEWTON, newton_expected, newton_table
from assetbuild.facts.reference import Reference
from assetbuild.findings import Finding
from assetbuild.plugin_types import write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import stages
from assetbuild.simulators.consumers import FAILED, NOT_FINITE
from assetbuild.simulators.experiments import Experiment, Outcome, StageNames, load
from assetbuild.simulators.newton import NewtonCheck
from assetbuild.simulators.usd_names import body_identifiers, joint_identifiers, usd_identifiers

LIGHT = (
    "Newton adds 1e-6 kg m2 to all moments of a body whose least is below 1e-10 kg m2, or below "
    "1e-6 of its largest: the edits `set_inertia`, or `share_mass` with `moments: 2e-10`"
)


class SmokeNewton(NewtonCheck):
    """Loads `usd/<robot>.usda` and `mjcf/<robot>.xml`, reads them back, steps them."""

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
            done = stages.answers(self.start, Path(folder).resolve(), runs)
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
