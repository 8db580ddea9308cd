"""Does the bare MJCF keep what mjlab 1.6 asks of a robot?"""

from __future__ import annotations

import re
from collections.abc import Iterator

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.simulators import mujoco

COLLISION = re.compile(r".*_collision\d*")
SENSORS = ("imu_ang_vel", "imu_lin_vel", "root_angmom")
"""What mjlab's velocity task reads."""

LOAD = Rule("mjlab.load", "error", "MuJoCo refuses the bare MJCF", "see `mjcf.load`")
CONTRACT = Rule(
    "mjlab.contract",
    "error",
    "the bare MJCF breaks what mjlab asks for",
    "report it: this is a bug",
)


class MjlabContract(Check):
    """One finding per broken promise."""

    isolated = True
    version = "2"
    preload = ("mujoco",)
    tools = ("mujoco",)
    needs = ("mjlab",)
    reads = ("tree.json",)

    robot: str

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `mjlab/mjcf/<robot>_bare.xml` and the module."""
        tree = RobotFiles(files.inputs).tree
        try:
            model = mujoco.load(
                files.inputs / "mjlab/mjcf" / f"{self.robot}_bare.xml", visuals=False
            ).model
        except StepError as error:
            write_figures(files, {"skipped": "it does not load"})
            yield LOAD("robot", f"MuJoCo refuses it: {error.message}")
            return
        broken = [*_foreign(model), *_names(model), *_task(model, tree)]
        for path in sorted((files.inputs / "mjlab/python").glob("*.py")):
            try:
                compile(path.read_text(encoding="utf-8"), path.name, "exec")
            except SyntaxError as error:
                broken.append(f"{path.name}:{error.lineno}: {error.msg}")
        write_figures(files, {"sensors": int(model.nsensor), "sites": int(model.nsite)})
        for message in broken:
            yield CONTRACT(
                "robot", message, hint="mjlab would refuse or misread it: please report it"
            )


def _foreign(model: mujoco.Model) -> Iterator[str]:
    for what, count in (("actuators", model.nu), ("keyframes", model.nkey)):
        if count:
            yield f"{count} {what} in the bare MJCF: mjlab's configs bring their own"


def _names(model: mujoco.Model) -> Iterator[str]:
    for i in range(model.ngeom):
        name = mujoco.name_of(model, "geom", i)
        collides = bool(model.geom_contype[i] or model.geom_conaffinity[i])
        if collides and not COLLISION.fullmatch(name):
            yield f"collision geom `{name}` is not called `*_collision`: no config finds it"


def _task(model: mujoco.Model, tree: Tree) -> Iterator[str]:
    if tree.base == "fixed":
        return
    there = {mujoco.name_of(model, "sensor", i) for i in range(model.nsensor)}
    for name in SENSORS:
        if name not in there:
            yield f"no sensor `{name}`, which mjlab's velocity task reads"
    if model.njnt == 0 or int(model.jnt_type[0]) != 0:
        yield "the first joint is not the free joint of the base"
    elif float(model.qpos0[2]) <= 0.0:
        yield "the root rests in the ground: mjlab counts its contacts before the first reset"
