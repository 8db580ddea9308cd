"""Logs of a robot that was never there: simulated in small steps, with hidden parameters."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from robot_files import run_step

from assetbuild.findings import Finding
from assetbuild.identify.fit_logs import FitLogs
from assetbuild.identify.read_log import ReadLog
from assetbuild.robot.codec import decode_file, encode
from assetbuild.robot.identify import Columns, Fit, Parameter
from assetbuild.robot.model import Actuator, Body, Control, Inertial, Joint, Limits, Tree
from assetbuild.robot.pose import Pose

TWO_LINKS = """
<mujoco><compiler angle="radian"/><option timestep="{dt}" integrator="implicitfast"/><worldbody>
 <body pos="0 0 1"><joint name="shoulder" axis="0 1 0" armature="{a[0]}" damping="{d[0]}"
   frictionloss="{f[0]}" range="-2 2" limited="true"/>
  <inertial pos="0 0 -.15" mass="1" diaginertia=".008 .008 .001"/>
  <body pos="0 0 -.3"><joint name="elbow" axis="0 1 0" armature="{a[1]}" damping="{d[1]}"
    frictionloss="{f[1]}" range="-2 2" limited="true"/>
   <inertial pos="0 0 -.1" mass=".5" diaginertia=".002 .002 .0005"/></body></body>
</worldbody><actuator>
 <position joint="shoulder" kp="{kp}" kv="{kd}" forcerange="-50 50"/>
 <position joint="elbow" kp="{kp}" kv="{kd}" forcerange="-50 50"/></actuator></mujoco>
"""
TWO_LINKS_URDF = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 -.15"/><mass value="1"/>
 <inertia ixx=".008" iyy=".008" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -.1"/><mass value=".5"/>
 <inertia ixx=".002" iyy=".002" izz=".0005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
 <origin xyz="0 0 1"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="20"/>
</joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
 <origin xyz="0 0 -.3"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="20"/>
</joint></robot>
"""
JOINTS = ("shoulder", "elbow")
ARMATURE, DAMPING, FRICTION = (0.02, 0.01), (0.3, 0.15), (0.4, 0.2)
KP, KD, DELAY_S, RATE_HZ = 30.0, 1.0, 0.004, 250.0


HIDDEN = {
    "armature": ARMATURE, "damping": DAMPING, "friction": FRICTION,
    "kp": (KP, KP), "kd": (KD, KD), "delay": (DELAY_S, DELAY_S),
}  # fmt: skip


def text_of_two_links(
    dt: float = 0.0002,
    *,
    friction: tuple[float, float] = FRICTION,
    kp: float = KP,
    kd: float = KD,
) -> str:
    """The arm with the parameters above. dt: s."""
    return TWO_LINKS.format(dt=dt, a=ARMATURE, d=DAMPING, f=friction, kp=kp, kd=kd)


def truth(parameter: Parameter) -> float:
    """The hidden value of what was fitted."""
    return HIDDEN[parameter.name][JOINTS.index(parameter.joints[0])]


def chirps(seconds: float, joints: int = 2, rate: float = RATE_HZ) -> np.ndarray:
    """(N, joints) targets: a sweep to 5 Hz on a slow swing, other for each joint; rad."""
    t = np.arange(int(seconds * rate)) / rate
    sweep = [np.sin(2 * np.pi * (0.3 * t + 2.4 * t**2 / seconds) + j) for j in range(joints)]
    slow = [np.sin(2 * np.pi * (0.15 + 0.04 * j) * t) for j in range(joints)]
    return np.stack([0.2 * a + 0.4 * b for a, b in zip(sweep, slow, strict=True)], axis=1)


def recorded(
    model: mujoco.MjModel,
    target: np.ndarray,
    *,
    rate: float = RATE_HZ,
    delay: float = DELAY_S,
    noise: float = 3e-4,
    ticks: float = 2 * np.pi / 2**14,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """(N, J) measured position and drive torque of the joints that `target` commands."""
    data, dt = mujoco.MjData(model), model.opt.timestep
    each, late = round(1 / rate / dt), round(delay / dt)
    fine = np.repeat(target, each, axis=0)
    fine = np.concatenate([np.repeat(target[:1], late, axis=0), fine])
    data.qpos[:] = target[0]
    position, torque = np.zeros_like(target), np.zeros_like(target)
    for n in range(len(target)):
        position[n], torque[n] = data.qpos, data.actuator_force
        for k in range(each):
            data.ctrl[:] = fine[n * each + k]
            mujoco.mj_step(model, data)
    random = np.random.default_rng(seed)
    position += random.normal(0, noise, position.shape)
    return np.round(position / ticks) * ticks, torque


def two_links(seconds: float, **how: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Target, position and torque of the arm with the parameters above."""
    target = chirps(seconds)
    model = mujoco.MjModel.from_xml_string(text_of_two_links())
    position, torque = recorded(model, target, **how)
    return target, position, torque


def write_csv(path: Path, columns: Mapping[str, Sequence[float]]) -> Path:
    """A log as CSV."""
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(columns)
        rows.writerows(
            [f"{value:.7g}" for value in row] for row in zip(*columns.values(), strict=True)
        )
    return path


def columns_of(target: np.ndarray, position: np.ndarray) -> dict[str, np.ndarray]:
    """time, position_<joint>, target_<joint>."""
    found = {"time": np.arange(len(target)) / RATE_HZ}
    for j, joint in enumerate(JOINTS):
        found |= {f"position_{joint}": position[:, j], f"target_{joint}": target[:, j]}
    return found


def read(
    folder: Path,
    log: Mapping[str, Sequence[float]] | Path,
    **keys: Any,  # Any: fields of the step
) -> tuple[Sequence[Finding], Mapping[str, np.ndarray]]:
    """The step `ReadLog` on columns or on a file: its findings and the records."""
    inputs = folder / "in"
    inputs.mkdir(exist_ok=True)
    (inputs / "tree.json").write_bytes(encode(arm()))
    if isinstance(log, Path):
        shutil.copyfile(log, inputs / "log")
    else:
        write_csv(inputs / "log", log)
    step = ReadLog(**{"file": "log.csv", "joints": JOINTS, "columns": Columns()} | keys)
    return run_step(step, inputs, folder / "out"), np.load(folder / "out/record.npz")


def assert_found(parameters: Sequence[Parameter], *, but: str = "") -> None:
    """Each within 5 % of its hidden value, which its interval holds. but: one that may not be."""
    for each in parameters:
        if each.name != but:
            assert each.value == pytest.approx(truth(each), rel=0.05), each
            assert each.low <= truth(each) <= each.high, each


def arm() -> Tree:
    """The arm of `TWO_LINKS`."""
    limits = Limits(-2.0, 2.0, 50.0, 20.0)
    upper = Inertial(1.0, (0.0, 0.0, -0.15), (0.008, 0.008, 0.001, 0.0, 0.0, 0.0))
    lower = Inertial(0.5, (0.0, 0.0, -0.1), (0.002, 0.002, 0.0005, 0.0, 0.0, 0.0))
    bodies = (Body("base"), Body("upper", upper), Body("lower", lower))
    y = (0.0, 1.0, 0.0)
    joints = (
        Joint("shoulder", "revolute", "base", "upper", Pose((0.0, 0.0, 1.0)), y, limits),
        Joint("elbow", "revolute", "upper", "lower", Pose((0.0, 0.0, -0.3)), y, limits),
    )
    return Tree("arm", "fixed", bodies, joints)


def prior(joint: str) -> Actuator:
    """A row of the table that knows nothing of the hidden parameters."""
    return Actuator(joint, "pd", KP, KD, 0.1, 0.1, 0.005, effort=50.0)


def fitted(
    folder: Path,
    target: np.ndarray,
    position: np.ndarray,
    torque: np.ndarray | None = None,
    kp: float = KP,
    base: np.ndarray | None = None,
    **keys: Any,  # Any: fields of the step
) -> tuple[Fit, Sequence[Finding]]:
    """The step `FitLogs` on one record."""
    inputs = folder / "in"
    for name in ("records", "about"):
        (inputs / name).mkdir(parents=True, exist_ok=True)
    (inputs / "tree.json").write_bytes(encode(arm()))
    rows = tuple(replace(prior(joint), kp=kp) for joint in keys.get("joints", JOINTS))
    (inputs / "prior.json").write_bytes(encode(Control(rows)))
    arrays = {"period_s": np.array(1 / RATE_HZ), "position_0": position, "target_0": target}
    measured = {"torque_0": torque, "base_0": base}
    arrays |= {name: values for name, values in measured.items() if values is not None}
    np.savez(inputs / "records/0.npz", **arrays)
    about = {"file": "log.csv", "rate_hz": RATE_HZ, "seconds": len(target) / RATE_HZ}
    (inputs / "about/0.json").write_text(json.dumps(about))
    names = ("armature", "damping", "friction", "delay")
    values = {
        "joints": JOINTS,
        "logs": ("log.csv",),
        "digests": ("0" * 64,),
        "fit": tuple((joint, names) for joint in JOINTS),
        "hold_out": 0.2,
        "gravity": (0.0, 0.0, -9.81),
        "max_relative_interval": 0.1,
    }
    findings = run_step(FitLogs(**values | keys), inputs, folder / "out")
    return decode_file(Fit, folder / "out/fit.json"), findings
