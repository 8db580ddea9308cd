"""Does a policy that drove this robot before still do what it is asked to?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import ClassVar

from pydantic import Field

from assetbuild.engine.step import Files, Limits
from assetbuild.errors import StepError, UsageError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.recipe_types import Positive, Real
from assetbuild.robot.actuator_table import Key, RowError
from assetbuild.robot.files import RobotFiles
from assetbuild.simulators import mujoco

FAILS = Rule(
    "policy.fails",
    "error",
    "a policy that the recipe names falls on this robot, or does not follow its command",
    "`assetbuild policy replay` looks for the wiring fault; else the robot itself has changed",
)
FOLDER = "own_policy/"


class PolicyCheck(mujoco.InMujoco):
    """Replays a policy on the built scene. Figures: how it moved, and what it was asked for."""

    section: ClassVar[str] = "validate.policy"
    about: ClassVar[str] = "a policy that must drive this robot; null = none"
    enabled_by_default: ClassVar[bool] = False
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    also: ClassVar[tuple[str, ...]] = ("policy",)
    requires: ClassVar[Mapping[str, str]] = {"onnxruntime": "policy"}
    recipe_fields: ClassVar[Mapping[str, str]] = {"imu": "imu.link"}
    limits: ClassVar[Limits] = Limits(wall_s=900.0, memory_mb=8192)

    robot: str
    """Name of the robot: the stem of its files."""
    imu: str | None = None
    files: tuple[str, ...] = Field(
        min_length=1,
        max_length=8,
        description="paths from the recipe: an ONNX file of mjlab, or the network and its "
        "`deploy.yaml` or `env.yaml`",
    )
    command: tuple[Real, Real, Real] = Field(
        (0.5, 0.0, 0.0), description="forward and left, m/s, and turn to the left, rad/s"
    )
    seconds: Positive = Field(10.0, le=120.0, description="how long it must do so")

    def own_files(self) -> Mapping[str, tuple[Key, str]]:
        """All of them, side by side. RowError for two of one name."""
        names = [PurePosixPath(file).name for file in self.files]
        for index, name in enumerate(names):
            if name in names[:index]:
                key = ("validate", "policy", "files", index)
                raise RowError(f"validate.policy.files: `{name}` is named twice", key=key)
        return {
            f"{FOLDER}{PurePosixPath(file).name}": (("validate", "policy", "files", index), file)
            for index, file in enumerate(self.files)
        }

    def run(self, files: Files) -> Iterator[Finding]:
        """StepError for a policy that cannot be replayed."""
        from assetbuild.policy.compare import compare  # few recipes name a policy
        from assetbuild.policy.in_mujoco import InMujoco
        from assetbuild.policy.opening import open_policy, runnable
        from assetbuild.policy.replay import replay
        from assetbuild.policy.robot import bot_from

        robot = RobotFiles(files.inputs)
        try:
            bot = bot_from(files.inputs, self.robot, robot.tree, robot.control, self.imu)
            policy = open_policy(files.inputs / FOLDER, bot)
            yield from compare(policy, bot)
            with runnable(policy, bot) as network:
                world = InMujoco(bot, policy)
                done = replay(policy, bot, network, world, self.command, self.seconds)
        except UsageError as error:
            raise StepError(error.message, hint=error.hint) from None
        figures = {
            "verdict": done.verdict,
            "seconds": done.seconds,
            "velocity": done.velocity,
            "moved_m": done.moved,
            "tilt_rad": done.tilt,
        }
        write_figures(files, figures)
        if not done.follows:
            speed, asked = done.velocity[0], self.command[0]
            text = f"it {done.verdict}: {speed:.2f} m/s forward, {asked:g} m/s asked for"
            yield FAILS("policy", text, data={"seconds": done.seconds, "error": done.error})
