"""Does our MJCF of an MJCF move as its source does? Nothing may differ in silence.

    python -m tests.benchmarks.mjcf_motion MODEL.xml...

Each file goes through `init` and `build` for the target `mjcf`. Then MuJoCo steps source and result
200 times under the same random commands, from the source's start, without contacts (whose shapes
are compared as facts) and with the constraint solver run to the end. A row is "equal" where all
joints agree to a relative 1e-6, "reported" where a warning or error of the build names something
that only a part of the source has, and "SILENT" otherwise; the program then ends with 1.

A source whose motion is decided by rounding is compared as long as it is not: a second run of the
source goes along, whose speeds are rounded by 1e-14 in each step, and where that is off by 1e-6,
the row ends with its step.
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
WIDTHS = {0: 7, 1: 4, 2: 1, 3: 1}
"""Positions of a joint by MuJoCo's number of its type: free, ball, slide, hinge."""
CAUSES = ("mjcf.dropped", "mjcf.scenery", "mjcf.uneven", "equal.", "actuator.guessed")
"""Starts of the rules that name a cause of another motion."""
LOOKS = ("rgba", "material", "texture")
"""Ends of those that move nothing."""
Model = Any  # mujoco.MjModel, whose extension module has no types


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
    joints, drives = list(_joints(source, result)), list(_drives(source, result))
    worst, steps = _difference(source, result, joints, drives)
    verdict = "equal" if worst <= CLOSE else f"reported: {causes[0]}" if causes else "SILENT"
    if steps < STEPS:
        verdict += f": of {steps} steps, then the source parts from itself"
    return str(len(joints)), str(len(drives)), f"{worst:.1e}", verdict


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
    return kind, model.joint(target).name if kind == 0 else str(target)


def _difference(
    source: Model,
    result: Model,
    joints: list[tuple[int, int]],
    drives: list[tuple[int, int]],
) -> tuple[float, int]:
    """Largest difference of a position over the largest position, and the steps compared.

    inf where nothing can be compared.
    """
    if not joints or (source.nu and len(drives) < source.nu):
        return np.inf, STEPS
    for model in (source, result):
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        model.opt.iterations, model.opt.tolerance = 300, 1e-15
        model.opt.solver = int(mujoco.mjtSolver.mjSOL_NEWTON)
    one, twin, other = mujoco.MjData(source), mujoco.MjData(source), mujoco.MjData(result)
    rows = []  # (place in one, place in the other, width, what the source counts from)
    for a, b in joints:
        kind = int(source.jnt_type[a])
        at, there = int(source.jnt_qposadr[a]), int(result.jnt_qposadr[b])
        rest = float(source.qpos0[at]) if kind > 1 else 0.0
        rows.append((at, there, WIDTHS[kind], rest))
        other.qpos[there : there + WIDTHS[kind]] = one.qpos[at : at + WIDTHS[kind]] - rest
    rests = {a: row[3] for (a, _), row in zip(joints, rows, strict=True)}
    shifts = {a: _shift(source, a, rests) for a, _ in drives}
    random, noise = np.random.default_rng(1), np.random.default_rng(2)
    worst, size = 0.0, 1e-9
    for step in range(STEPS):
        for a, b in drives:
            low, high = source.actuator_ctrlrange[a] if source.actuator_ctrllimited[a] else (-1, 1)
            one.ctrl[a] = twin.ctrl[a] = random.uniform(low, high)
            other.ctrl[b] = one.ctrl[a] - shifts.get(a, 0.0)
        twin.qvel *= 1.0 + NUDGE * noise.standard_normal(source.nv)
        for model, data in ((source, one), (source, twin), (result, other)):
            mujoco.mj_step(model, data)
        own = [one.qpos[at : at + width] - rest for at, _, width, rest in rows]
        size = max(size, *(float(np.abs(each).max()) for each in own))
        if not np.allclose(one.qpos, twin.qpos, rtol=0.0, atol=CLOSE * size):
            return worst / size, step
        for each, (_, there, width, _) in zip(own, rows, strict=True):
            worst = max(worst, float(np.abs(each - other.qpos[there : there + width]).max()))
    return (worst / size if np.isfinite(worst) else np.inf), STEPS


def _shift(source: Model, drive: int, rests: dict[int, float]) -> float:
    """What a command of a drive that holds positions counts from: the `ref` of its joint."""
    if int(source.actuator_trntype[drive]) or not int(source.actuator_biastype[drive]):
        return 0.0
    holds = source.actuator_biasprm[drive, 1] != 0.0
    rest = rests.get(int(source.actuator_trnid[drive, 0]), 0.0)
    return rest * float(source.actuator_gear[drive, 0]) if holds else 0.0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
