"""The full and the mjx model of built robots: pairs and speed; `cone` runs MJX and Warp.

    python -m tests.benchmarks.mjx BUNDLE...

Speed is MuJoCo's own on one core, of processor time: standing at the first keyframe under the
drives, and falling over without them; full and mjx take turns, the best of five counts.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from assetbuild.checks.mjx_pairs import figures

STEPS = 1000
TURNS = 5
LIFT_M = 0.1
TILT = (0.95, 0.2, 0.2, 0.1)


def main() -> None:
    """Print a row for each robot."""
    scenes = [(name, *_scenes(Path(name))) for name in sys.argv[1:]]
    print("| robot | pairs full | pairs mjx | fast on Warp | rows at home | stand | fall |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name, full, small in scenes:
        print(_row(name, full, small), flush=True)


def _scenes(bundle: Path) -> tuple[Path, Path]:
    pair = bundle / "mjcf/scene.xml", bundle / "mjcf/scene_mjx.xml"
    for path in pair:
        if not path.is_file():
            sys.exit(f"{path} is not there: build the robot with `targets: [mjcf, mjx]`")
    return pair


def _row(name: str, full: Path, small: Path) -> str:
    models = [mujoco.MjModel.from_xml_path(str(path)) for path in (full, small)]
    pairs = [figures(model) for model in models]
    rows = [_rows(model) for model in models]
    cells = [
        f"{pairs[0]['pairs']}",
        f"{pairs[1]['pairs']} ({_kinds(pairs[1])})",
        f"{pairs[1]['fast_on_warp']} of {pairs[1]['pairs']}",
        f"{rows[0]} / {rows[1]}",
        *(_speeds(models, falls=falls) for falls in (False, True)),
    ]
    return f"| {name} | {' | '.join(cells)} |"


def _kinds(found: dict[str, object]) -> str:
    kinds = found["by_kinds"]
    assert isinstance(kinds, dict)
    return ", ".join(f"{count} {kind}" for kind, count in kinds.items())


def _rows(model: mujoco.MjModel) -> int:
    """Rows of constraints at the first keyframe."""
    return int(_start(model, falls=False).nefc)


def _start(model: mujoco.MjModel, *, falls: bool) -> mujoco.MjData:
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    if falls and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        data.qpos[2] += LIFT_M
        data.qpos[3:7] = np.array(TILT) / np.linalg.norm(TILT)
    mujoco.mj_forward(model, data)
    return data


def _speeds(models: Sequence[mujoco.MjModel], *, falls: bool) -> str:
    """`full / mjx` in thousand steps per second of processor time."""
    best = [0.0 for _ in models]
    for _ in range(TURNS):
        for index, model in enumerate(models):
            drives = mujoco.mjtDisableBit.mjDSBL_ACTUATION
            flags = model.opt.disableflags
            model.opt.disableflags = flags | drives if falls else flags
            data = _start(model, falls=falls)
            before = time.process_time()
            mujoco.mj_step(model, data, STEPS)
            best[index] = max(best[index], STEPS / (time.process_time() - before))
            model.opt.disableflags = flags
            if not np.isfinite(data.qpos).all():
                return "diverged"
    return " / ".join(f"{rate / 1e3:.1f}k" for rate in best)


if __name__ == "__main__":
    main()
