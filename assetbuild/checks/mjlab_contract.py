"""Does mjlab find the feet and the IMU that its module names, does the robot start clear, and is
the bare MJCF without keyframes?

Everything else of the module and of the bare MJCF is compared by the readers of facts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.errors import StepError, UsageError
from assetbuild.facts.standins import Record, recorded, table_of, words_of
from assetbuild.findings import NOT_LOADED, Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import mujoco

TASK = "velocity_flat_cfg"

CONTRACT = Rule(
    "mjlab.contract",
    "error",
    "mjlab's module names feet or sites that the bare MJCF does not have, or in another order, or "
    "that file has keyframes",
    "mjlab would refuse or misread it; report it: this is a bug",
)
BURIED = Rule(
    "mjlab.buried",
    "error",
    "a floating robot rests in the ground, where mjlab counts its contacts before the first reset",
    "add a keyframe `home` with `base: on_ground`",
)


class MjlabContract(mujoco.WithMujoco):
    """One finding per broken promise."""

    needs = ("mjlab",)
    reads: ClassVar = ("tree.json",)

    robot: str

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `mjlab/mjcf/<robot>_bare.xml` and the module."""
        folder = files.inputs / "mjlab"
        try:
            model = mujoco.load(folder / f"mjcf/{self.robot}_bare.xml", visuals=False).model
            records = [recorded(file, (TASK,)) for file in sorted(folder.glob("python/*.py"))]
        except (StepError, UsageError) as error:
            write_figures(files, {NOT_LOADED: error.message})
            return  # the readers of both files say so
        write_figures(files, {"sensors": int(model.nsensor), "sites": int(model.nsite)})
        for record in records:
            for message in _broken(record, model):
                yield CONTRACT("robot", message)
        if model.nkey:
            yield CONTRACT("robot", "the bare MJCF has keyframes: those of a scene are its own")
        floats = RobotFiles(files.inputs).tree.base == "floating"
        if floats and float(model.qpos0[2]) <= 0.0:
            yield BURIED("robot", f"the root rests at a height of {float(model.qpos0[2]):.3g} m")


def _broken(record: Record, model: mujoco.Model) -> Iterator[str]:
    """Yield each name that stands for nothing, and feet that are in another order.

    mjlab's rewards take contacts, in the model's order, and sites of the feet in pairs.
    """
    kind, patterns = _contact(record)
    for constant, of, words in (
        ("IMU_SITE", "site", words_of(record.get("IMU_SITE"))),
        ("FOOT_SITES", "site", words_of(record.get("FOOT_SITES"))),
        ("FOOT_GEOMS", "geom", words_of(record.get("FOOT_GEOMS"))),
        ("the contact sensor", kind, patterns),
    ):
        for word in words:
            if not any(re.fullmatch(word, name) for name in _names(model, of)):
                yield f"{constant}: no {of} of the bare MJCF is called `{word}`"
    touching = [n for n in _names(model, kind) for word in patterns if re.fullmatch(word, n)]
    sites = [name for name in words_of(record.get("FOOT_SITES")) if name in _names(model, "site")]
    bodies = [_body_of(model, kind, name) for name in touching]
    standing = [_body_of(model, "site", name) for name in sites]
    if patterns and bodies != standing:
        yield (
            f"the contact sensor counts {len(bodies)} feet ({', '.join(bodies)}) where "
            f"`FOOT_SITES` has {len(standing)} ({', '.join(standing)})"
        )


def _contact(record: Record) -> tuple[str, Sequence[str]]:
    """(kind, names) of what the task's contact sensor watches; no names without one."""
    scene = table_of(table_of(record.get(f"{TASK}()")).get("scene"))
    for sensor in map(table_of, scene.get("sensors") or ()):
        watched = table_of(sensor.get("primary"))
        if watched:
            return str(watched.get("mode")), words_of(watched.get("pattern"))
    return "body", ()


def _names(model: mujoco.Model, kind: str) -> list[str]:
    """All of a kind, in the order of the model. kind: body, geom or site."""
    return [mujoco.name_of(model, kind, i) for i in range(int(getattr(model, f"n{kind}")))]


def _body_of(model: mujoco.Model, kind: str, name: str) -> str:
    if kind == "body":
        return name
    return mujoco.name_of(model, "body", int(getattr(model, kind)(name).bodyid[0]))
