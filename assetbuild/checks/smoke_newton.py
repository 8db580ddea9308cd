"""Does Newton read the same robot from the USD and from the MJCF, and does it step?

In Newton's own environment (MuJoCo 3.17). The dynamics are MuJoCo's: this judges what is read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar

from assetbuild.engine.step import Files
from assetbuild.facts.compare import differences, equality_findings
from assetbuild.facts.held import NEWTON, newton_expected, newton_table
from assetbuild.facts.reference import Assets, Reference
from assetbuild.findings import Finding
from assetbuild.kinds import write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.shapes import Shapes
from assetbuild.simulators.consumers import FAILED, NOT_FINITE, ConsumerCheck
from assetbuild.simulators.environments import Environment
from assetbuild.simulators.newton import HOME
from assetbuild.simulators.usd_names import body_identifiers, joint_identifiers, usd_identifiers

BEYOND_IMPORTS = ("assetbuild.simulators.newton._child",)
LIGHT = (
    "Newton adds 1e-6 kg m2 to all moments of a body whose least is below 1e-10 kg m2, or below "
    "1e-6 of its largest: the edits `set_inertia`, or `share_mass` with `moments: 2e-10`"
)
NO_PGS = "Newton has no solver PGS, which the source asks for: `mjcf: {solver: Newton}`"
FLAT = (
    "Newton turns an inertia in single precision, where A + B of a flat body may come out below C; "
    "the USD leaves room for that; for the MJCF, `set_inertia` with its least moment a millionth up"
)
HINTS = {"'pgs'": NO_PGS, "A + B >= C": FLAT}
"""Hints by the words that Newton's message contains."""
Reading = Mapping[str, Any]  # Any: JSON of the child


class SmokeNewton(ConsumerCheck):
    """Loads `usd/<robot>.usda` and `mjcf/<robot>.xml`, reads them back, steps them."""

    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "shapes.json", "control.json")
    consumer: ClassVar[str] = "newton"
    home: ClassVar[Environment] = HOME

    told: ClassVar[Mapping[str, str]] = {"mimics": "usd.mimics"}

    steps: int = 100
    mimics: bool = True
    """Whether the USD couples the joints that mimic others."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: bodies, joints and numbers compared, per format."""
        robot = RobotFiles(files.inputs)
        paths = {"usd": f"usd/{self.robot}.usda", "mjcf": f"mjcf/{self.robot}.xml"}
        job: dict[str, object] = {
            "files": {kind: str((files.inputs / path).absolute()) for kind, path in paths.items()},
            "steps": self.steps,
            "dt": robot.control.simulation.timestep,
        }
        answer, failure = self.answer("newton/_child.py", job)
        if answer is None:
            answer = {kind: {"failure": failure} for kind in paths}
        figures: dict[str, object] = {}
        told = []
        for kind in paths:
            reading = answer[kind]
            assert isinstance(reading, dict)  # noqa: S101 # as the child writes it
            findings = list(
                judged(kind, reading, robot.tree, robot.control, robot.shapes, mimics=self.mimics)
            )
            yield from findings
            figures[kind] = reading.get("failure") or {
                "mass_kg": round(math.fsum(b["mass"] for b in reading["bodies"].values()), 4),
                "dof": reading["dof"],
                "joints": len(reading["joints"]),
                "differences": len(findings),
            }
            what = "refused" if "failure" in reading else f"{len(findings)} differences"
            told.append(f"{kind.upper()}: {what}")
        write_figures(files, figures | {"summary": f"read back and stepped: {', '.join(told)}"})


def judged(
    kind: str,
    reading: Reading,
    tree: Tree,
    control: Control,
    shapes: Shapes,
    *,
    mimics: bool = True,
) -> Iterator[Finding]:
    """What Newton holds of one file, beside the robot; separate, to be tried on bad readings."""
    if "failure" in reading:
        yield FAILED(
            "robot",
            f"Newton does not take the {kind.upper()}: {reading['failure']}",
            hint=next(
                (hint for words, hint in HINTS.items() if words in reading["failure"]),
                "the message is Newton's",
            ),
        )
        return
    if not reading["finite"]:
        message = f"Newton: the {kind.upper()} steps to numbers that are not finite"
        yield NOT_FINITE("robot", message, "a gain or timestep too large?")
    alike = kind == "mjcf"
    table = newton_expected(
        Reference(tree, tree, Shapes(), control, Assets(), {}),
        shapes,
        coupled=alike or mimics,
        usd=not alike,
    )
    bodies = {file: name for name, file in body_identifiers(tree).items()}
    joints = {file: name for name, file in joint_identifiers(tree).items()}
    solid = {usd: name for name, usd in usd_identifiers(s.name for s in shapes.shapes).items()}
    if alike:  # of an MJCF's names Newton changes this alone
        bodies = {body.name.replace("-", "_"): body.name for body in tree.bodies}
        joints = {joint.name.replace("-", "_"): joint.name for joint in tree.joints}
        solid = {shape.name.replace("-", "_"): shape.name for shape in shapes.shapes}
    held = newton_table(reading, bodies, joints, solid, table)
    found = differences(table, held, NEWTON)
    for finding in equality_findings(found, "newton", f"the {kind.upper()} as Newton holds it", {}):
        light = finding.rule.endswith(".inertia")
        yield replace(finding, hint=LIGHT) if light else finding
