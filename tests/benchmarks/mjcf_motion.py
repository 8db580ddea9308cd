"""Does our MJCF of an MJCF move as its source does? Nothing may differ in silence.

    python -m tests.benchmarks.mjcf_motion MODEL.xml...

Each file goes through `init` and `build` for the target `mjcf`. Then MuJoCo steps source and result
200 times under the same random commands, from the source's start, without contacts (whose shapes
are compared as facts) and with the constraint solver run to the end. A row is "equal" where all
joints agree to a relative 1e-6, "reported" where a warning or error of the build names something
that only a part of the source has, and "SILENT" otherwise; the program then ends with 1.

In some sources rounding decides the motion. A second run of the source, whose speeds are changed by
a relative 1e-14 in each step, finds them. Once it is off by 1e-6, the steps are compared one by
one: each begins at the source's state, and its speeds at the end must agree to 1e-6. The row gives
the number of steps before that, and of those after it in which even the second run of the source
ends with other speeds ("unsteady"); these are not compared.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

STEPS, CLOSE, NUDGE = 200, 1e-6, 1e-14
OF_JOINTS = (0, 1)
"""Transmissions `joint` and `jointinparent`, by MuJoCo's number."""
WIDTHS = {0: 7, 1: 4, 2: 1, 3: 1}
"""Positions of a joint by MuJoCo's number of its type: free, ball, slide, hinge."""
SPEEDS = {0: 6, 1: 3, 2: 1, 3: 1}
"""Speeds of the same."""
CAUSES = ("mjcf.dropped", "mjcf.scenery", "mjcf.uneven", "equal.", "actuator.guessed")
"""Starts of the rules that name a cause of another motion."""
LOOKS = ("rgba", "material", "texture")
"""Ends of those that move nothing."""
Model = Any  # mujoco.MjModel, whose extension module has no types
Numbers = Any  # an array: positions in m or rad, speeds in m/s or rad/s


def main(paths: list[str]) -> int:
    """One row per file."""
    print("| file | joints | drives | relative difference | verdict |")
    print("| --- | --- | --- | --- | --- |")
    verdicts = []
    for path in map(Path, paths):
        with tempfile.TemporaryDirectory() as folder:
            row = _row(path.resolve(), Path(folder))
        verdicts.append(row[-1].split(":")[0])
        print(f"| {path.parent.name}/{path.name} | {' | '.join(row)} |", flush=True)
    counts = {word: verdicts.count(word) for word in sorted(set(verdicts))}
    print(f"\n{len(paths)} files: {counts}")
    return 1 if "SILENT" in counts else 0


def _row(path: Path, folder: Path) -> tuple[str, str, str, str]:
    recipe, bundle = folder / "robot.yaml", folder / "bundle"
    told = _run("init", str(path), "-o", str(recipe))
    if not recipe.is_file():
        return "", "", "", f"refused: {_first(told)}"
    text = re.sub(r"(?m)^targets:.*$", "targets: [mjcf]", recipe.read_text())
    recipe.write_text(text if "\ntargets:" in text else text + "\ntargets: [mjcf]\n")
    told = _run("build", str(recipe), "-o", str(bundle))
    made = [d for d in (bundle, bundle.with_name("bundle.failed")) if (d / "mjcf").is_dir()]
    if not made:
        return "", "", "", f"refused: {_first(told)}"
    name = re.search(r"(?m)^robot: (\S+)", text)
    source = mujoco.MjModel.from_xml_path(str(path))
    result = mujoco.MjModel.from_xml_path(str(made[0] / f"mjcf/{name[1] if name else ''}.xml"))
    report = json.loads((made[0] / "report/report.json").read_text())
    causes = [
        f"{f['rule']} {f['subject']}"
        for f in report["findings"]
        if f["severity"] in ("warning", "error")
        and f["rule"].startswith(CAUSES)
        and not f["rule"].endswith(LOOKS)
    ]
    pair = Pair(source, result)
    worst, steps, unsteady = _difference(pair)
    verdict = "equal" if worst <= CLOSE else f"reported: {causes[0]}" if causes else "SILENT"
    if steps < STEPS:
        verdict += f": {steps} steps in a row, then one by one, {unsteady} unsteady"
    return str(len(pair.joints)), str(len(pair.drives)), f"{worst:.1e}", verdict


def _run(*words: str) -> str:
    command = [sys.executable, "-W", "ignore", "-m", "assetbuild", *words]
    unseen = {**os.environ, "MUJOCO_GL": "disable"}  # pictures say nothing about motion
    return subprocess.run(command, capture_output=True, text=True, check=False, env=unseen).stderr


def _first(text: str) -> str:
    lines = [line for line in text.splitlines() if "error" in line]
    return (lines or ["?"])[0].removeprefix("error: ").replace("|", "/")[:120]


def _joints(source: Model, result: Model) -> Iterator[tuple[int, int]]:
    """(number in the source, in the result) of each joint of the robot, by name."""
    unnamed: dict[str, int] = {}
    for joint in range(source.njnt):
        name = source.joint(joint).name
        if not name:  # called after its body, numbered from the second
            body = source.body(source.jnt_bodyid[joint]).name
            count = unnamed[body] = unnamed.get(body, 0) + 1
            name = f"{body}_joint" + (f"_{count}" if count > 1 else "")
            if int(source.jnt_type[joint]) == 0:
                name = next(
                    (result.joint(j).name for j in range(result.njnt) if not result.jnt_type[j]),
                    name,
                )
        found = mujoco.mj_name2id(result, mujoco.mjtObj.mjOBJ_JOINT, name)
        if found >= 0:
            yield joint, found


def _drives(source: Model, result: Model) -> Iterator[tuple[int, int]]:
    """The same of actuators; one without a name is the first of its joint that is left."""
    left = list(range(result.nu))
    for drive in range(source.nu):
        name = source.actuator(drive).name
        for other in left:
            known = (
                name == result.actuator(other).name
                if name
                else _moves(source, drive) == _moves(result, other)
            )
            if known:
                left.remove(other)
                yield drive, other
                break


def _moves(model: Model, drive: int) -> tuple[int, str]:
    kind, target = int(model.actuator_trntype[drive]), int(model.actuator_trnid[drive, 0])
    return (0, model.joint(target).name) if kind in OF_JOINTS else (kind, str(target))


class Pair:
    """Source and result with a state each. joints, drives: (number in the source, in the result).

    rests: what the source counts positions of a joint from: `ref`, where it has one.
    """

    def __init__(self, source: Model, result: Model) -> None:
        self.source, self.result = source, result
        self.joints, self.drives = list(_joints(source, result)), list(_drives(source, result))
        for model in (source, result):
            model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
            model.opt.iterations, model.opt.tolerance = 300, 1e-15
            model.opt.solver = int(mujoco.mjtSolver.mjSOL_NEWTON)
        self.one, self.other = mujoco.MjData(source), mujoco.MjData(result)
        one_number = {a for a, _ in self.joints if int(source.jnt_type[a]) > 1}
        starts = source.qpos0[source.jnt_qposadr]
        self.rests = {a: float(starts[a]) if a in one_number else 0.0 for a, _ in self.joints}
        self.shifts = {a: self._shift(a) for a, _ in self.drives}

    def _shift(self, drive: int) -> float:
        """What a command of a drive that holds positions counts from: the `ref` of its joint."""
        source = self.source
        of_joint = int(source.actuator_trntype[drive]) in OF_JOINTS
        stiffness = float(source.actuator_biasprm[drive, 1])
        holds = stiffness != 0.0 and stiffness == -float(source.actuator_gainprm[drive, 0])
        if not (of_joint and holds) or int(source.actuator_dyntype[drive]):
            return 0.0  # of such laws our MJCF has another constant force
        rest = self.rests.get(int(source.actuator_trnid[drive, 0]), 0.0)
        return rest * float(source.actuator_gear[drive, 0])

    def begin(self) -> None:
        """Give the result the source's state: positions, speeds, activations."""
        for own, their in (*self.positions(), *self.speeds()):
            their[:] = own
        for a, b in self.drives:
            at, there = self.source.actuator_actadr[a], self.result.actuator_actadr[b]
            width = max(int(self.source.actuator_actnum[a]), 0)
            if width:
                self.other.act[there : there + width] = self.one.act[at : at + width]

    def positions(self) -> Iterator[tuple[Numbers, Numbers]]:
        """Yield each joint's position in the source, counted from its rest, and in the result."""
        for a, b in self.joints:
            at, there = self.source.jnt_qposadr[a], self.result.jnt_qposadr[b]
            width = WIDTHS[int(self.source.jnt_type[a])]
            own = self.one.qpos[at : at + width] - self.rests[a]
            yield own, self.other.qpos[there : there + width]

    def speeds(self) -> Iterator[tuple[Numbers, Numbers]]:
        """Yield each joint's speed in the source and in the result."""
        for a, b in self.joints:
            at, there = self.source.jnt_dofadr[a], self.result.jnt_dofadr[b]
            width = SPEEDS[int(self.source.jnt_type[a])]
            yield self.one.qvel[at : at + width], self.other.qvel[there : there + width]


def _difference(pair: Pair) -> tuple[float, int, int]:
    """Largest relative difference, steps compared in a row, and unsteady ones of the others.

    Of positions over the largest position; of single steps, of speeds over the largest speed. inf
    where nothing can be compared.
    """
    source, one, other = pair.source, pair.one, pair.other
    if not pair.joints or (source.nu and len(pair.drives) < source.nu):
        return np.inf, STEPS, 0
    twin = mujoco.MjData(source)
    random, noise = np.random.default_rng(1), np.random.default_rng(2)
    worst, jolt, size, row, unsteady = 0.0, 0.0, 1e-9, STEPS, 0
    for step in range(STEPS):
        if step == 0 or step > row:
            pair.begin()
            twin.qpos[:], twin.qvel[:], twin.act[:] = one.qpos, one.qvel, one.act
        for a, b in pair.drives:
            low, high = source.actuator_ctrlrange[a] if source.actuator_ctrllimited[a] else (-1, 1)
            one.ctrl[a] = twin.ctrl[a] = random.uniform(low, high)
            other.ctrl[b] = one.ctrl[a] - pair.shifts[a]
        twin.qvel *= 1.0 + NUDGE * noise.standard_normal(source.nv)
        for model, data in ((source, one), (source, twin), (pair.result, other)):
            mujoco.mj_step(model, data)
        if step > row:
            fast = max(float(np.abs(one.qvel).max()), 1e-9)
            steady = float(np.abs(one.qvel - twin.qvel).max()) <= CLOSE * fast
            unsteady += not steady
            jolt = max(jolt, _farthest(pair.speeds()) / fast) if steady else jolt
            continue
        size = max(size, *(float(np.abs(own).max()) for own, _ in pair.positions()))
        if not np.allclose(one.qpos, twin.qpos, rtol=0.0, atol=CLOSE * size):
            row = step
        else:
            worst = max(worst, _farthest(pair.positions()))
    compared = row or STEPS - 1 - unsteady
    worst = max(worst / size, jolt)
    return (worst if np.isfinite(worst) and compared else np.inf), row, unsteady


def _farthest(pairs: Iterator[tuple[Numbers, Numbers]]) -> float:
    return max(float(np.abs(own - their).max()) for own, their in pairs)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
