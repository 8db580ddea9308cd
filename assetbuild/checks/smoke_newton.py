"""Does Newton read the same robot from the USD and from the MJCF, and does it step?

In Newton's own environment (MuJoCo 3.17). The dynamics are MuJoCo's: this judges what is read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control, Tree
from assetbuild.simulators.consumers import FAILED, NOT_FINITE, ConsumerCheck
from assetbuild.simulators.environments import Environment
from assetbuild.simulators.usd_names import body_identifiers, joint_identifiers

SAME = 2e-6
"""Relative: Newton holds float32, and USD states angles in degrees."""
WITH_GAINS = frozenset({"pd", "velocity"})
"""Models whose drive the simulator integrates; others have none in one of the files."""

Reading = Mapping[str, Any]  # Any: JSON of the child

READING = Rule(
    "smoke.reading",
    "error",
    "what the trainer reads from the USD or the MJCF differs from the robot",
    "report it: this is a bug",
)


class SmokeNewton(ConsumerCheck):
    """Loads `usd/<robot>.usda` and `mjcf/<robot>.xml`, reads them back, steps them."""

    version = "2"
    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    consumer: ClassVar[str] = "newton"
    home: ClassVar[Environment] = Environment("newton", ("newton[sim,importers]==1.8.0",))

    steps: int = 100

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: bodies, joints and numbers compared, per format."""
        robot = RobotFiles(files.inputs)
        paths = {"usd": f"usd/{self.robot}.usda", "mjcf": f"mjcf/{self.robot}.xml"}
        job: dict[str, object] = {
            "files": {kind: str((files.inputs / path).absolute()) for kind, path in paths.items()},
            "steps": self.steps,
            "dt": robot.control.simulation.timestep,
        }
        answer, failure = self.answer("_newton_child.py", job)
        if answer is None:
            answer = {kind: {"failure": failure} for kind in paths}
        figures: dict[str, object] = {}
        told = []
        for kind in paths:
            reading = answer[kind]
            assert isinstance(reading, dict)  # noqa: S101 # as the child writes it
            findings = list(judged(kind, reading, robot.tree, robot.control))
            yield from findings
            figures[kind] = reading.get("failure") or {
                "mass_kg": round(math.fsum(reading["masses"].values()), 4),
                "dof": reading["dof"],
                "joints": len(reading["joints"]),
                "differences": len(findings),
            }
            what = "refused" if "failure" in reading else f"{len(findings)} differences"
            told.append(f"{kind.upper()}: {what}")
        write_figures(files, figures | {"summary": f"read back and stepped: {', '.join(told)}"})


def judged(kind: str, reading: Reading, tree: Tree, control: Control) -> Iterator[Finding]:
    """What Newton holds of one file, beside the robot; separate, to be tried on bad readings."""
    if "failure" in reading:
        yield FAILED(
            "robot",
            f"Newton does not take the {kind.upper()}: {reading['failure']}",
            hint="the message is Newton's",
        )
        return
    if not reading["finite"]:
        message = f"Newton: the {kind.upper()} steps to numbers that are not finite"
        yield NOT_FINITE("robot", message, "a gain or timestep too large?")
    bodies = body_identifiers(tree) if kind == "usd" else {n: n for n in tree.by_body}
    for body in tree.bodies:
        mass = body.inertial.mass_kg if body.inertial else 0.0
        if mass > 0.0:  # the others may be merged away
            found = reading["masses"].get(bodies[body.name])
            yield from _differs(kind, f"link {body.name}", "mass", mass, found)
    joints = joint_identifiers(tree) if kind == "usd" else {n: n for n in tree.by_joint}
    free = 6 if tree.base == "floating" else 0
    expected = len(tree.moving_joints) + free
    yield from _differs(kind, "robot", "dof", expected, reading["dof"])
    for joint in tree.moving_joints:
        held = reading["joints"].get(joints[joint.name])
        if held is None:
            yield _finding(kind, f"joint {joint.name}", "the joint is not there", "joint")
            continue
        for name, value in _expected(tree, control, joint.name).items():
            yield from _differs(kind, f"joint {joint.name}", name, value, held[name])


def _expected(tree: Tree, control: Control, name: str) -> dict[str, float | None]:
    """What both files must say of a joint, in SI and radians."""
    joint, drive = tree.by_joint[name], control.by_joint[name]
    said: dict[str, float | None] = {"armature": drive.armature, "friction": drive.friction}
    if drive.model in WITH_GAINS:
        said |= {"kp": drive.kp, "kd": drive.kd, "effort": drive.effort, "damping": drive.damping}
    if joint.kind != "continuous":
        said |= {"lower": joint.limits.lower, "upper": joint.limits.upper}
    return said


def _differs(
    kind: str, subject: str, name: str, expected: float | None, found: float | None
) -> Iterator[Finding]:
    if expected is None or (found is None and name == "effort" and expected >= 1e6):
        return
    near = found is not None and math.isclose(expected, found, rel_tol=SAME, abs_tol=1e-6)
    if not near:
        text = "nothing" if found is None else f"{found:.7g}"
        yield _finding(kind, subject, f"`{name}` is {text} instead of {expected:.7g}", name)


def _finding(kind: str, subject: str, what: str, name: str) -> Finding:
    return READING(
        subject,
        f"Newton reads the {kind.upper()} otherwise: {what}",
        hint="it trains another robot than MuJoCo and PhysX do",
        data={"format": kind, "value": name},
    )
