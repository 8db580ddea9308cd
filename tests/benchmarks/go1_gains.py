"""Three published sets of gains on the Go1: what the check `gains` says of each, and how it stands.

    python -m tests.benchmarks.go1_gains [recipes/go1.yaml]

Builds the variants gains_mjlab, gains_menagerie and gains_isaaclab (MJCF only) and lets each stand
for two seconds: as built (elliptic cone, impratio 50, soles of condim 6), and with MuJoCo's own
contact (pyramidal, impratio 1, condim 3), where the soles creep apart and the robot sinks further.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np

from assetbuild.robot.model import Actuator
from assetbuild.simulators.mujoco.motion import drive_as

VARIANTS = ("gains_mjlab", "gains_menagerie", "gains_isaaclab")
LEG = ("FR_hip_joint", "FR_thigh_joint", "FR_calf_joint")
FIGURES = {
    "frequency_hz": "Hz",
    "damping_ratio": "ratio",
    "sag": "sag at home rad",
    "holding": "holding N m",
    "stiffness": "kp dt2/I",
}
SECONDS = 2.0


def main(recipe: str = "recipes/go1.yaml") -> None:
    """Prints one table; hip / thigh / knee in each cell."""
    print(
        f"| gains | {' | '.join(FIGURES.values())} | as built: z, sag, torque | MuJoCo's contact |"
    )
    print("| --- " * (len(FIGURES) + 3) + "|")
    for variant in VARIANTS:
        with tempfile.TemporaryDirectory() as folder:
            bundle = _build(Path(recipe), variant, Path(folder))
            joints = json.loads((bundle / "report/report.json").read_text())["checks"]["gains"]
            joints = joints["figures"]["joints"]
            cells = [" / ".join(f"{joints[j][key]:.3g}" for j in LEG) for key in FIGURES]
            cells += [_stands(bundle, variant, plain=plain) for plain in (False, True)]
        print(f"| {variant.removeprefix('gains_')} | {' | '.join(cells)} |", flush=True)


def _build(recipe: Path, variant: str, folder: Path) -> Path:
    out = folder / "out"
    asked = ["build", str(recipe), "--variant", variant, "--fail-on", "never", "-o", str(out)]
    done = subprocess.run([sys.executable, "-m", "assetbuild", *asked], capture_output=True)
    if not out.is_dir():
        sys.exit(done.stderr.decode())
    return out


def _stands(bundle: Path, variant: str, *, plain: bool) -> str:
    model = mujoco.MjModel.from_xml_path(str(bundle / "mjcf/scene.xml"))
    if variant == "gains_isaaclab":  # its law acts outside of the simulator
        drive_as(
            model, {j: _servo(model, j) for j in map(_joint, range(1, model.njnt), [model] * 12)}
        )
    if plain:
        model.opt.cone, model.opt.impratio = mujoco.mjtCone.mjCONE_PYRAMIDAL, 1.0
        model.geom_condim[model.geom_condim == 6] = 3
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    target = np.array(data.qpos[7:])
    data.ctrl[:] = target
    mujoco.mj_step(model, data, round(SECONDS / model.opt.timestep))
    sag = np.abs(data.qpos[7:] - target).max()
    torque = np.abs(data.actuator_force).reshape(4, 3).max(axis=0)
    return f"{data.qpos[2]:.3f}, {sag:.2f}, {' / '.join(f'{t:.1f}' for t in torque)}"


def _joint(index: int, model: mujoco.MjModel) -> str:
    return str(model.joint(index).name)


def _servo(model: mujoco.MjModel, joint: str) -> Actuator:
    effort = float(model.actuator(joint.removesuffix("_joint")).ctrlrange[1])
    return Actuator(joint, "pd", kp=25.0, kd=0.5, effort=effort)


if __name__ == "__main__":
    main(*sys.argv[1:])
