"""A policy's robot in an engine that reads USD, in that engine's own process: PhysX or Newton.

The engine steps and reports poses; velocities are their differences over the last step, as in an
engine that moves by its new velocity.
"""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import numpy as np
from scipy.spatial.transform import Rotation

from assetbuild.engine.world import World as Files
from assetbuild.errors import MachineError, StepError, UsageError
from assetbuild.plugin_types import lacking
from assetbuild.policy.in_mujoco import InMujoco
from assetbuild.policy.robot import Bot
from assetbuild.policy.stated import Policy
from assetbuild.policy.terms import Seen
from assetbuild.robot.pose import Pose, normalised_quat, rotation_of, vec3
from assetbuild.simulators import mujoco, newton, physx
from assetbuild.simulators.experiments import CLEARANCE_M, Experiment, standing
from assetbuild.simulators.stages import Start, perform_on_stages

STARTS_S, STEPS_S = 180.0, 60.0
"""Wall-clock limits: until an engine has loaded the robot, and for one step of a policy."""
MOST_S = 3600.0
"""Wall-clock limit of an engine's process."""
ENGINES: Mapping[str, Start] = {
    "newton": newton.NewtonCheck.start,
    "physx": physx.PhysxCheck.start,
}


def unavailable_reason(engine: str) -> str:
    """What this machine lacks for an engine, and how to get it; "" = nothing."""
    if engine == "physx":
        return lacking(physx.PhysxCheck.requires, Files())
    if engine == "newton" and newton.HOME.python(Files()) is None:
        return "run `assetbuild smoke RECIPE --consumer newton` once"
    return ""


def require(engine: str) -> None:
    """MachineError where this machine lacks an engine; MuJoCo is always there."""
    reason = unavailable_reason(engine)
    if reason:
        raise MachineError(f"{engine} is not installed here", hint=reason)


class InStages:
    """`usd/<robot>.usda` on a floor: a `replay.World`; a context manager.

    MachineError where the engine is not there; UsageError where the USD is not; StepError where the
    engine fails.
    """

    def __init__(self, bot: Bot, policy: Policy, engine: str) -> None:
        require(engine)
        self._main = bot.bundle / "usd" / f"{bot.name}.usda"
        if not self._main.is_file():
            raise UsageError(f"no `{self._main}`", hint="build the target `usd`")
        self._engine, self._start, self._failure = engine, ENGINES[engine], ""
        self._dt, self._time = bot.control.simulation.timestep, 0.0
        self._experiment = _experiment(bot, policy)

    def __enter__(self) -> Self:
        self._folder = TemporaryDirectory(prefix="policy-")
        path = str(Path(self._folder.name) / "pilot")
        self._listening = socket.socket(socket.AF_UNIX)
        self._listening.bind(path)
        self._listening.listen(1)
        self._listening.settimeout(1.0)
        self._experiment = replace(self._experiment, pilot=path)
        self._working = threading.Thread(target=self._work, daemon=True)
        self._working.start()
        with ExitStack() as undo:
            undo.callback(self._close)
            line = self._accepted()
            line.settimeout(STEPS_S)
            self._talk = line.makefile("rw", encoding="utf-8")
            self._states = self._answer()
            undo.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._talk.close()
        self._close()

    def _close(self) -> None:
        """End the engine's run and take away its folder."""
        self._listening.close()
        self._working.join(STEPS_S)
        self._folder.cleanup()

    def _work(self) -> None:
        """Work in a thread of its own, until the engine's process has ended."""
        try:
            done = perform_on_stages(self._start, self._main, [self._experiment], MOST_S)
            self._failure = done[self._experiment.name].failure
        except (StepError, MachineError) as error:
            self._failure = error.message

    def _accepted(self) -> socket.socket:
        for _ in range(int(STARTS_S)):
            try:
                return self._listening.accept()[0]
            except TimeoutError:
                if not self._working.is_alive():
                    break
        raise StepError(f"{self._engine}: {self._failure or 'it did not load the robot'}")

    def _answer(self) -> list[Any]:  # Any: JSON
        """[[root, joints], [root, joints]] before and after the last step."""
        try:
            line = self._talk.readline()
        except OSError:
            line = ""
        if not line:
            self._working.join(STEPS_S)
            raise StepError(f"{self._engine}: {self._failure or 'it stopped without a word'}")
        states: list[Any] = json.loads(line)
        return states

    def seen(self) -> Seen:
        """Poses as the engine reports them; velocities as they changed."""
        (root, joints), (now, q) = self._states
        place, quat = np.array(now[:3]), np.array(now[3:])
        turn = rotation_of(normalised_quat(tuple(now[3:])))
        before = rotation_of(normalised_quat(tuple(root[3:])))
        return Seen(
            time=self._time,
            place=place,
            quat=quat,
            linear=np.asarray(turn.T @ (place - np.array(root[:3]))) / self._dt,
            angular=Rotation.from_matrix(before.T @ turn).as_rotvec() / self._dt,
            q=q,
            v={name: (value - joints[name]) / self._dt for name, value in q.items()},
        )

    def drive(self, targets: Mapping[str, float], seconds: float) -> None:
        """Drive in whole steps of the bundle's timestep."""
        steps = max(1, round(seconds / self._dt))
        self._talk.write(json.dumps({"targets": dict(targets), "steps": steps}) + "\n")
        self._talk.flush()
        self._states = self._answer()
        self._time += seconds

    def strain(self) -> tuple[float, float]:
        """These engines do not report it."""
        return float("nan"), float("nan")


def _experiment(bot: Bot, policy: Policy) -> Experiment:
    """The policy's pose where MuJoCo has it on the floor, with servos of its gains."""
    stood = InMujoco(bot, policy)
    x, y, z = (float(v) for v in stood.data.xpos[1])
    w, i, j, k = (float(v) for v in stood.data.xquat[1])
    gains = bot.servos(policy)
    setting = standing(bot.tree, bot.control)
    at = (
        Pose(vec3((x, y, z + CLEARANCE_M)), (w, i, j, k))
        if bot.tree.base == "floating"
        else setting.at
    )
    setting = replace(
        setting,
        at=at,
        drives={**(setting.drives or {}), **gains},
        solver=mujoco.contact_solver(stood.model),
    )
    start = {name: value for name, value in policy.position.items() if name in bot.tree.by_joint}
    return Experiment("policy", setting, 1, start=start)
