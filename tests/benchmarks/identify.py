"""Known truth: logs of thirteen robots of the library with hidden parameters, and what a fit finds.

python -m tests.benchmarks.identify [ROBOT ...] > fits.md

The commands are those of `assetbuild identify --excite`. The logs come from MuJoCo in steps of a
quarter of a millisecond, with a delay, noise and the ticks of an encoder; two robots carry a
payload that their recipe does not know. The fit sees the log and the recipe. *Called*: called
identifiable; *near*: of those, within 5 % of the truth; *inside*: within their 95 % interval;
*RMS*: of the position on the held-out fifth, rad.
"""

from __future__ import annotations

import io
import json
import os
import re
import resource
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

import mujoco
import numpy as np

from tests.benchmarks import assetbuild

RECIPES = Path(__file__).parents[2] / "recipes"
JOINTS = {
    "a1": ".*", "anymal_c": ".*", "b1": ".*", "go1": ".*", "go2": ".*", "g1": ".*",
    "panda": "panda_joint.*", "ur10": ".*", "xarm7": "joint[1-7]", "z1": "joint[1-6]",
    "so101": ".*", "allegro_right": ".*", "rover": "arm_joint[1-6]",
}  # fmt: skip
PAYLOAD = {"z1": ("link06", 0.5), "ur10": ("wrist_3_link", 2.0)}
"""Robot -> the body that carries it, kg."""
DT, NOISE, TICKS, DELAY = 0.00025, 3e-4, 2.0 * np.pi / 2**14, 0.005
SOFTER, LOOSER = 0.5, 0.15
"""Gains while recording, as shares of the recipe's kp and kd."""

FULL_ERROR = 0.3
"""rad: the error at which the drive gives all its effort, at least."""


@dataclass
class Row:
    """Counts of one robot: parameters fitted, called identifiable, of these good and inside."""

    name: str
    joints: int = 0
    asked: int = 0
    called: int = 0
    near: int = 0
    inside: int = 0
    before: float = 0.0
    after: float = 0.0
    cpu_s: float = 0.0
    worst: str = ""


def main(names: list[str]) -> None:
    """Print the page."""
    rows = [measured(name) for name in names or JOINTS]
    columns = "robot | joints | parameters | called | near | inside | RMS priors | identified"
    print(f"| {columns} | CPU s | worst |\n|{' --- |' * 10}")
    for r in rows:
        print(
            f"| {r.name} | {r.joints} | {r.asked} | {r.called} | {r.near} | {r.inside} | "
            f"{r.before:.2e} | {r.after:.2e} | {r.cpu_s:.0f} | {r.worst} |"
        )
    called, near, inside = (sum(getattr(r, k) for r in rows) for k in ("called", "near", "inside"))
    if called:
        print(
            f"\nOf {called} parameters that were called identifiable, {near} "
            f"({near / called:.1%}) are within 5 % of the truth and {inside} "
            f"({inside / called:.1%}) within their interval."
        )


def measured(name: str) -> Row:
    """One robot."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        os.environ["ASSETBUILD_CACHE"] = str(place / "store")  # a fit from a store costs nothing
        shutil.copytree(RECIPES, place, dirs_exist_ok=True)  # a composite names its parts
        recipe = place / f"{name}.yaml"
        text = recipe.read_text(encoding="utf-8")
        recipe.write_text(re.sub(r"(?m)^targets:.*$", "targets: [mjcf]", text), encoding="utf-8")
        assetbuild("build", recipe, "-o", place / "out", "--fail-on", "never")
        truth = Truth(place / "out" / "mjcf" / f"{name}.xml", name)
        entry = truth.entry()
        recipe.write_text(f"{text}\nidentify: {json.dumps([entry])}\n", encoding="utf-8")
        assetbuild("identify", recipe, "--excite", "-o", place / "ex")
        truth.record(place / "ex" / "excite.csv", place / "log.csv")
        begun = _cpu_s()
        fit = json.loads(assetbuild("identify", recipe, "--json"))[0]
        row = truth.evaluate(fit)
        row.cpu_s = _cpu_s() - begun
        return row


def _cpu_s() -> float:
    """Return the CPU seconds of all processes that were started and ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


class Truth:
    """The robot on its stand with parameters that the recipe does not know."""

    def __init__(self, file: Path, name: str) -> None:
        spec = mujoco.MjSpec.from_file(str(file))
        spec.compiler.discardvisual = True
        for joint in list(spec.joints):
            if joint.type == mujoco.mjtJoint.mjJNT_FREE:
                spec.delete(joint)
        for key in list(spec.keys):
            spec.delete(key)
        if name in PAYLOAD:
            body, mass = PAYLOAD[name]
            load = spec.body(body).add_body(ipos=[0.05, 0.0, 0.03], mass=mass)
            load.inertia, load.explicitinertial = np.full(3, 1e-9), True
        m = self.model = spec.compile()
        self.name, self.random = name, np.random.default_rng(crc32(name.encode()))
        moved = [m.joint(int(joint)) for joint in m.actuator_trnid[:, 0]]
        self.drives = [a for a, j in enumerate(moved) if re.fullmatch(JOINTS[name], j.name)]
        joints = [moved[a] for a in self.drives]
        self.names = [joint.name for joint in joints]
        self.at = np.array([int(joint.qposadr[0]) for joint in joints])
        self.dof = np.array([int(joint.dofadr[0]) for joint in joints])
        self.effort = m.actuator_forcerange[self.drives, 1]
        kp = m.actuator_gainprm[self.drives, 0]
        self.kp = np.minimum(SOFTER * kp, self.effort / FULL_ERROR)
        self.kd = LOOSER * -m.actuator_biasprm[self.drives, 2] * self.kp / (SOFTER * kp)
        self._hide()

    def _hide(self) -> None:
        """Parameters by name, (J,) each."""
        m, count = self.model, len(self.drives)
        draw = self.random.uniform
        mass = np.zeros((m.nv, m.nv))
        data = mujoco.MjData(m)
        mujoco.mj_forward(m, data)
        mujoco.mj_fullM(m, data, mass)
        inertia = np.diag(mass)[self.dof]
        armature = np.where(m.dof_armature[self.dof] > 0, m.dof_armature[self.dof], 0.2 * inertia)
        self.hidden = {
            "armature": armature * draw(0.6, 1.6, count),
            "damping": self.kd * draw(0.1, 0.5, count) + 1e-3,
            "friction": np.minimum(0.02 * self.kp, 0.1 * self.effort) * draw(0.3, 1.2, count),
        }
        m.dof_armature[self.dof] = self.hidden["armature"]
        m.dof_damping[self.dof] = self.hidden["damping"]
        m.dof_frictionloss[self.dof] = self.hidden["friction"]
        m.actuator_gainprm[self.drives, 0] = self.kp
        m.actuator_biasprm[self.drives, 1] = -self.kp
        m.actuator_biasprm[self.drives, 2] = -self.kd
        m.actuator_ctrllimited[:] = 0
        m.opt.timestep = DT
        m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        mujoco.mj_setConst(m, mujoco.MjData(m))

    def entry(self) -> dict[str, Any]:
        """The recipe's entry."""
        return {
            "joints": JOINTS[self.name],
            "logs": [{"file": "log.csv"}],
            "recorded": {
                "kp": {n: float(v) for n, v in zip(self.names, self.kp, strict=True)},
                "kd": {n: float(v) for n, v in zip(self.names, self.kd, strict=True)},
            },
        }

    def record(self, commands: Path, out: Path) -> None:
        """Play the commands and write the log."""
        lines = commands.read_text(encoding="utf-8").splitlines()
        head = lines[0].split(",")[1:]
        table = np.loadtxt(io.StringIO("\n".join(lines[1:])), delimiter=",")
        order = [head.index(f"target_{name}") for name in self.names]
        t, u = table[:, 0], table[:, 1:][:, order]
        m, data = self.model, mujoco.MjData(self.model)
        data.qpos[self.at] = u[0]
        each, late = round((t[1] - t[0]) / DT), round(DELAY / DT)
        fine = np.concatenate([np.repeat(u[:1], late, axis=0), np.repeat(u, each, axis=0)])
        data.ctrl[self.drives] = u[0]
        mujoco.mj_step(m, data, 4000)
        q = np.empty_like(u)
        for n in range(len(u)):
            q[n] = data.qpos[self.at]
            for k in range(each):
                data.ctrl[self.drives] = fine[n * each + k]
                mujoco.mj_step(m, data)
        q += self.random.normal(0.0, NOISE, q.shape)
        q = np.round(q / TICKS) * TICKS
        columns = [f"{what}_{name}" for what in ("position", "target") for name in self.names]
        head = ",".join(["time", *columns])
        np.savetxt(out, np.column_stack([t, q, u]), "%.6f", ",", header=head, comments="")

    def evaluate(self, fit: dict[str, Any]) -> Row:
        """The counts."""
        row, off = Row(self.name, len(self.names)), 0.0
        for each in fit["parameters"]:
            joint = self.names.index(each["joints"][0])
            true = DELAY if each["name"] == "delay" else float(self.hidden[each["name"]][joint])
            row.asked += 1
            error = abs(each["value"] - true) / true
            inside = each["low"] <= true <= each["high"]
            if each["refused"]:
                continue
            row.called += 1
            row.near += error <= 0.05
            row.inside += inside
            if error > off:
                off, row.worst = error, f"{each['name']} of {each['joints'][0]} {error:.1%}"
        rms = [[p[key] for p in fit["predictions"]] for key in ("before", "after")]
        row.before, row.after = (float(np.sqrt(np.mean(np.square(r)))) for r in rms)
        return row


if __name__ == "__main__":
    main(sys.argv[1:])
