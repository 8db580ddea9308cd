"""Experiments in engines that read USD: a stage and a run for each, done in a child process.

A run says in SI and by the robot's names what to do; the child answers in `<run>.json` with what
the engine holds (a run without steps) or with where it moved.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import numpy as np

from assetbuild.robot.pose import Array
from assetbuild.simulators.experiments import (
    Experiment,
    Motion,
    Outcome,
    SimulatorCheck,
    StageNames,
)

TURN = 0.5
"""rad or m; a position of joints at which their axes show."""
Start = Callable[[dict[str, object], Path, float], str]
"""See `StageCheck.start`."""


class StageCheck(SimulatorCheck):
    """Base of the checks that ask an engine which reads USD, in a process of its own."""

    needs: ClassVar[tuple[str, ...]] = ("usd",)

    @staticmethod
    def start(job: dict[str, object], folder: Path, seconds: float) -> str:
        """Do a job in a folder, within a time in s; how the engine died, or ""."""
        raise NotImplementedError

    def perform(self, inputs: Path, experiments: Sequence[Experiment]) -> Mapping[str, Outcome]:
        """Run experiments on `usd/`."""
        main = inputs / f"usd/{self.robot}.usda"
        return perform_on_stages(self.start, main, experiments, self.limits.wall_s / 2.0)


def perform_on_stages(
    start: Start,
    main: Path,
    experiments: Sequence[Experiment],
    seconds: float,
    *,
    copied: bool = True,
) -> dict[str, Outcome]:
    """Run experiments on the asset `main`, by name. A crash or a NaN ends only its own.

    seconds: wall-clock limit of a process. copied: with its whole folder, as the inputs of a step
    must be: they are links into the store, and a resolver that follows them gets lost.
    """
    from assetbuild.simulators.stage_world import write_world  # with OpenUSD

    with TemporaryDirectory(prefix="stages-") as temporary:
        folder = Path(temporary).resolve()
        asset = main.resolve()
        if copied:
            shutil.copytree(main.parent, folder / "asset")
            asset = folder / "asset" / main.name
        runs = []
        for experiment in experiments:
            stage = folder / f"{experiment.name}.usda"
            names = write_world(stage, asset, experiment.setting)
            runs.append(run_of(experiment, names, stage))
        return answers(start, folder, runs, seconds)


def answers(
    start: Start, folder: Path, runs: Sequence[Mapping[str, object]], seconds: float
) -> dict[str, Outcome]:
    """What an engine makes of runs, by name; it is started again after one that ended it."""
    waiting, failures = {str(run["name"]): run for run in runs}, dict[str, str]()
    while waiting:
        died = start({"answers": str(folder), "runs": list(waiting.values())}, folder, seconds)
        left = {n: run for n, run in waiting.items() if not (folder / f"{n}.json").exists()}
        if left and (died or len(left) == len(waiting)):
            failures[next(iter(left))] = died or "it stopped without a word"
            left.pop(next(iter(left)))
        waiting = left
    return {
        name: Outcome(None, None, failures[name])
        if name in failures
        else _outcome(json.loads((folder / f"{name}.json").read_bytes()))
        for name in (str(run["name"]) for run in runs)
    }


def run_of(experiment: Experiment, names: StageNames, stage: Path) -> dict[str, object]:
    """What a child does with a file; with the robot's names by those of the file."""
    dt, joints = experiment.setting.timestep, set(names.joints.values())
    start = {name: q for name, q in (experiment.start or {}).items() if name in joints}
    course, speeds, pushed = experiment.course, dict[str, Array](), None
    if course is not None:
        rows = {"table": course.table, "force": course.force}
        pushed = {word: row[1:].tolist() for word, row in rows.items()}
        pushed |= {"watched": list(course.watched)}
        targets = {name: row[1:] for name, row in course.targets.items()}
    elif experiment.sine.middle:
        targets, speeds = experiment.sine.commands(experiment.steps, dt)
    else:  # servos that the asset does not know have no target there: hold the start
        servos = experiment.setting.drives or {}
        targets = {name: np.array([q]) for name, q in start.items() if name in servos}
    return {
        "name": experiment.name,
        "stage": str(stage),
        "dt": dt,
        "steps": experiment.steps,
        "every": experiment.every,
        "contacts": experiment.setting.contacts,
        "solver": dict(experiment.setting.solver),
        "bodies": dict(names.bodies),
        "joints": dict(names.joints),
        "angular": sorted(names.angular),
        "start": start,
        "turn": TURN,
        "targets": {name: row.tolist() for name, row in targets.items() if name in joints},
        "speeds": {name: row.tolist() for name, row in speeds.items() if name in joints},
        "course": pushed,
        "pilot": experiment.pilot,
    }


def _outcome(result: dict[str, Any]) -> Outcome:  # Any: JSON
    held, moved, failure = result.get("held"), result.get("motion"), result.get("failure", "")
    if moved is None:
        return Outcome(held, None, failure)
    root = np.array(moved["root"], dtype=float)
    motion = Motion(
        np.array(moved["time"]),
        {name: np.array(row, dtype=float) for name, row in moved["joints"].items()},
        root[:, :3],
        root[:, 3:],
        np.array(moved["com"], dtype=float),
        seen=np.array(moved["seen"], dtype=float) if moved["seen"] else None,
    )
    lost = "" if motion.finite else f"it lost its numbers (NaN) after {motion.time[-1]:.3g} s"
    return Outcome(held, motion, lost)
