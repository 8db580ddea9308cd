"""One log on a uniform clock, in the units of the robot, and looked over for what is wrong."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.identify.record import poses
from assetbuild.identify.table import element_names, read_columns
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.identify import Columns
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
GAP = 3.5
"""A gap is a step of so many periods; a shorter one is bridged by a straight line."""
SHORTEST_S = 2.0
"""Stretches between gaps that are shorter are left out."""
MOST_LOST = 0.2
"""Share of the time in gaps above which a log is refused."""

DROPPED = Rule(
    "identify.dropped",
    "warning",
    "samples are missing from a log; the stretches between the gaps are used",
    "record again, or choose an `interval` without gaps",
)


class ReadLog(Step):
    """`log`, `tree.json` -> `record.npz`: `period_s`, and for each stretch n `position_n`,
    `target_n` and, if measured, `torque_n`, (N, J) each, and `base_n`, (N, 6); `about.json`.

    rad or m, N m or N, in the order of `joints`. `info.json` of a LeRobot data set is read, too.
    """

    outputs = ("record.npz", "about.json")
    isolated = True
    usual_s = 1.0
    limits = Limits(wall_s=1800.0, memory_mb=4096)

    file: str
    joints: tuple[str, ...]
    names: dict[str, str] = Field(default_factory=dict)
    columns: Columns
    interval: tuple[float, float] | None = None
    episode: int | None = None
    time_unit: str = "s"
    angle_unit: str | int = "rad"
    torque_constants: tuple[float, ...] | None = None

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises StepError, in one sentence, for a log that cannot be what the recipe says."""
        tree, info = RobotFiles(files.inputs).tree, files.inputs / "info.json"
        table = read_columns(
            files.inputs / "log",
            self.file,
            self._names(),
            self.interval,
            SECONDS[self.time_unit],
            element_names(info.read_bytes(), self.file) if info.is_file() else {},
            self.episode,
        )
        time = table[:, 0]
        self._check_clock(time)
        count = len(self.joints)
        values = {name: table[:, 1 + n * count :][:, :count] for n, name in enumerate(self._kinds)}
        scale = np.array([self._scale(tree, joint) for joint in self.joints])
        for name in ("position", "target", "velocity"):
            if name in values:
                values[name] = values[name] * scale
        if "torque" in values and self.torque_constants is not None:
            values["torque"] = values["torque"] * np.array(self.torque_constants)
        for message, hint in suspicions(tree, self.joints, time, values):
            raise StepError(f"{self.file}: {message}", hint=hint)
        if self.columns.base_orientation:
            rest = table[:, 1 + len(self._kinds) * count :]
            values["base"] = poses(
                rest[:, :4], rest[:, 4:] if rest.shape[1] > 4 else None, self.file
            )
        stretches, period, lost = self._stretches(time)
        seconds = sum(float(time[last - 1] - time[first]) for first, last in stretches)
        if lost > 0.0:
            yield DROPPED(
                f"log {Path(self.file).name}",
                f"{self.file}: samples are missing for {lost:.3g} s in all; {len(stretches)} "
                f"stretches of {seconds:.3g} s are used",
                data={"lost_s": round(lost, 6), "stretches": len(stretches)},
            )
        arrays: dict[str, Array] = {"period_s": np.array(period)}
        for n, (first, last) in enumerate(stretches):
            for name in ("position", "target", "torque", "base"):
                if name in values:
                    arrays[f"{name}_{n}"] = _uniform(
                        time[first:last], values[name][first:last], period, held=name == "target"
                    )
        np.savez(files.outputs / "record.npz", **arrays)  # type: ignore[arg-type] # arrays by name
        about = {"file": self.file, "rate_hz": round(1.0 / period, 6), "seconds": round(seconds, 6)}
        files.write_json("about.json", about)

    @property
    def _kinds(self) -> tuple[str, ...]:
        optional = [name for name in ("velocity", "torque") if getattr(self.columns, name)]
        return ("position", "target", *optional)

    def _names(self) -> list[str]:
        """The columns in the order of the table: time, then each kind with all joints."""
        columns = [self.columns.time]
        for kind in self._kinds:
            pattern = str(getattr(self.columns, kind))
            columns += [pattern.replace("{joint}", self.names.get(j, j)) for j in self.joints]
        turned, moved = self.columns.base_orientation, self.columns.base_position
        columns += [turned.replace("{axis}", axis) for axis in "wxyz"] if turned else []
        columns += [moved.replace("{axis}", axis) for axis in "xyz"] if moved else []
        twice = {name for name in columns if columns.count(name) > 1}
        if twice:
            raise StepError(
                f"{self.file}: column `{min(twice)}` would be read for several joints",
                hint="`{joint}` in `columns` stands for the joint's name in the log",
            )
        return columns

    def _scale(self, tree: Tree, joint: str) -> float:
        """Radians in one unit of the log's angles; joints that slide are in metres."""
        if tree.by_joint[joint].kind == "prismatic" or self.angle_unit == "rad":
            return 1.0
        whole = 360.0 if self.angle_unit == "deg" else float(self.angle_unit)
        return 2.0 * math.pi / whole

    # --- the clock --------------------------------------------------------------------------

    def _check_clock(self, time: Array) -> None:
        """StepError for a clock that goes back, stands still, or counts in another unit."""
        steps = np.diff(time)
        back = np.flatnonzero(steps < 0)
        if len(back):
            raise StepError(
                f"{self.file}: the time goes back by {-steps[back[0]]:.4g} s after row "
                f"{back[0] + 1}, and in {len(back)} places in all",
                hint="rows with stamps of two clocks are mixed: write the stamp of one clock",
            )
        period = float(np.median(steps))
        if period <= 0.0:
            raise StepError(
                f"{self.file}: most rows have the same time",
                hint="write each sample once, with its own time",
            )
        if not 1e-4 <= period <= 0.2:
            raise StepError(
                f"{self.file}: one sample every {period:.4g} s",
                hint="check `time_unit`; samples every 0.1 ms to 0.2 s can be used",
            )

    def _stretches(self, time: Array) -> tuple[list[tuple[int, int]], float, float]:
        """(first, last) rows between gaps, the period in s, and the seconds lost in gaps."""
        steps = np.diff(time)
        period = float(np.median(steps))
        whole = steps[steps < GAP * period]
        period = float(np.mean(whole)) if len(whole) else period
        gaps = np.flatnonzero(steps >= GAP * period)
        ends = [0, *(int(g) + 1 for g in gaps), len(time)]
        stretches = [(a, b) for a, b in itertools.pairwise(ends) if (b - a) * period >= SHORTEST_S]
        lost = float(np.sum(steps[gaps]))
        if (time[-1] - time[0]) < SHORTEST_S:
            raise StepError(
                f"{self.file}: {time[-1] - time[0]:.3g} s long, at least {SHORTEST_S:g} s are used",
                hint="record longer; check `time_unit` and `interval`",
            )
        if not stretches or lost > MOST_LOST * (time[-1] - time[0]):
            raise StepError(
                f"{self.file}: samples are missing in {len(gaps)} places, {lost:.3g} s of "
                f"{time[-1] - time[0]:.3g} s",
                hint="record again; a logger that writes to disk in the control loop drops samples",
            )
        return stretches, round(period, 9), lost


def _uniform(time: Array, values: Array, period: float, *, held: bool) -> Array:
    """Sample at each period from the first time on. held: a command, which lasts until the next.

    Of a command that comes within a period, the mean over the period is taken: it has the same
    impulse, while the nearest tick would shift it.
    """
    count = math.floor((time[-1] - time[0]) / period + 1e-6) + 1
    at = time[0] + period * np.arange(count + held)
    if held:
        ends = np.append(time, at[-1] + period)
        areas = values * np.diff(ends)[:, None]
        area = np.concatenate([np.zeros((1, values.shape[1])), areas]).cumsum(axis=0)
        until = np.stack([np.interp(at, ends, column) for column in area.T], axis=1)
        means: Array = np.diff(until, axis=0) / period
        return means
    return np.stack([np.interp(at, time, column) for column in values.T], axis=1)


# --- what is wrong with the columns: signs, units, joints that are swapped or stand still -----

OUTSIDE = 0.05
"""rad or m beyond its limits that a joint may be: limits are soft, zeros a little off."""
STILL = 0.01
"""A joint whose command moves by so much (rad or m, standard deviation) should move as well."""
MOVES = 0.02
"""Share of the command's motion that a joint follows at least, unless it stands still."""
LAGS_S = (0.01, 0.03, 0.1)
"""So far behind its command a position may be, s."""
FOLLOWS = 0.6
"""Correlation of position and command from which the one follows the other."""


Suspicion = tuple[str, str]
"""One thing that is wrong, and the next move."""


def suspicions(
    tree: Tree, joints: Sequence[str], time: Array, values: Mapping[str, Array]
) -> Iterator[Suspicion]:
    """What is wrong, the most telling first. values: (N, J) by the kind of column, rad or m."""
    position, target = values["position"], values["target"]
    alike = _correlations(position, target)
    yield from _swapped(joints, np.abs(alike))
    for joint, value in zip(joints, np.diag(alike), strict=True):
        if value < -FOLLOWS:
            yield (
                f"`{joint}` moves against its command (correlation {value:.2f}): the sign of its "
                "position or of its command is wrong",
                "turn the sign of the column in the log",
            )
    yield from _ahead(time, position, target)
    for joint, q, u in zip(joints, position.T, target.T, strict=True):
        if np.std(u) > STILL and np.std(q) < MOVES * np.std(u):
            yield (
                f"`{joint}` never moves: its position varies by {np.std(q):.2g} while its command "
                f"varies by {np.std(u):.2g}",
                "leave it out by the pattern `joints` of the entry, or correct its column",
            )
    yield from _outside(tree, joints, position)
    if (velocity := values.get("velocity")) is not None:
        alike = _correlations(np.gradient(position, time, axis=0), velocity)
        for i, joint in enumerate(joints):
            if np.std(velocity[:, i]) > 0.0 and alike[i, i] < -FOLLOWS:
                yield (
                    f"the velocity of `{joint}` has the opposite sign of the slope of its position",
                    "turn the sign of one of the two columns",
                )


def _correlations(a: Array, b: Array) -> Array:
    """(J, J) correlation of each column of a with each of b; 0 for one that is constant."""
    every = max(1, len(a) // 5000)
    a, b = a[::every] - a[::every].mean(axis=0), b[::every] - b[::every].mean(axis=0)
    spread = np.outer(np.linalg.norm(a, axis=0), np.linalg.norm(b, axis=0))
    correlations: Array = (a.T @ b) / np.maximum(spread, 1e-12)
    return correlations


def _swapped(joints: Sequence[str], alike: Array) -> Iterator[Suspicion]:
    left = 1.0 - alike**2  # share of the motion that the command leaves open
    for i, joint in enumerate(joints):
        best = int(np.argmax(alike[i]))
        mutual = int(np.argmax(alike[best])) == i
        clear = all(left[a, b] < 0.5 * left[a, a] for a, b in ((i, best), (best, i)))
        if i < best and mutual and clear and alike[i, best] > 0.9:
            yield (
                f"the position of `{joint}` follows the command of `{joints[best]}` and the other "
                "way round: two columns are swapped",
                "correct `names`, or the columns of the log",
            )


def _ahead(time: Array, position: Array, target: Array) -> Iterator[Suspicion]:
    """Every joint that moves is where its command comes to be only later."""
    moving = (np.std(target, axis=0) > STILL) & (np.std(position, axis=0) > STILL)
    a, b = position[:, moving], target[:, moving]
    lags = {max(1, round(lag_s / float(np.median(np.diff(time))))) for lag_s in LAGS_S}

    def left(after: Array, before: Array) -> Array:
        """What the earlier of two leaves open of the later one's motion, at the best lag."""
        open_ = [1.0 - np.diag(_correlations(after[n:], before[:-n])) ** 2 for n in sorted(lags)]
        return np.asarray(np.min(open_, axis=0))

    if moving.any() and len(time) > 2 * max(lags) and (left(b, a) < 0.5 * left(a, b)).all():
        yield (
            "the commands follow the positions: the columns of position and command are exchanged",
            "correct `columns`, `position` and `target`",
        )


def _outside(tree: Tree, joints: Sequence[str], position: Array) -> Iterator[Suspicion]:
    for i, name in enumerate(joints):
        joint = tree.by_joint[name]
        endless = math.inf if joint.kind == "prismatic" else 100.0
        lower, upper = joint.range or (-endless, endless)
        low, high = (float(v) for v in np.quantile(position[:, i], (0.005, 0.995)))
        if lower - OUTSIDE <= low and high <= upper + OUTSIDE:
            continue
        yield (
            f"`{name}` is at {low:.4g}..{high:.4g}, outside of its limits {lower:.4g}..{upper:.4g}",
            "state `angle_unit: deg`, or the encoder ticks of one turn; or its sign, its zero or "
            "its column is wrong",
        )
