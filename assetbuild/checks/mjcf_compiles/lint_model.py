"""What a compiled model shows: poses and targets in range, drives, left and right alike."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from assetbuild.findings import Finding
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco

RANGE_TOLERANCE = 1e-6
"""rad or m; a number that was rounded from the limit itself is inside."""
TARGET_TOLERANCE = 1e-3
MASS_TOLERANCE, INERTIA_TOLERANCE = 0.02, 0.1
"""Relative; what CAD exports of two mirrored parts differ by is mostly below."""
PLACE_TOLERANCE_M, LIMIT_TOLERANCE = 5e-3, 5e-3
SIDES = (("left", "right"), ("FL", "FR"), ("RL", "RR"), ("HL", "HR"), ("LF", "RF"), ("LH", "RH"),
         ("L", "R"), ("l", "r"))  # fmt: skip
FLIP = np.diag([1.0, -1.0, 1.0])
"""Mirror at the plane y = 0 of the root body."""


def lint(model: mujoco.Model) -> Iterator[Finding]:
    """All that the compiled model shows without a step of simulation."""
    yield from _drives(model)
    for key in range(model.nkey):
        yield from _keyframe(model, key)
    yield from _mirror(model)


def _drives(model: mujoco.Model) -> Iterator[Finding]:
    moving = int((model.jnt_type >= 2).sum())
    if moving and not model.nu:
        yield Finding(
            "lint.no_actuator",
            "info",
            "robot",
            f"{moving} joints move and nothing drives them",
            hint="fine for a file that a framework adds drives to; else write <actuator>",
            data={"joints": moving},
        )


def _keyframe(model: mujoco.Model, key: int) -> Iterator[Finding]:
    name = mujoco.name_of(model, "key", key)
    qpos, ctrl = model.key_qpos[key], model.key_ctrl[key]
    for joint in range(model.njnt):
        value = float(qpos[model.jnt_qposadr[joint]])
        if model.jnt_limited[joint] and model.jnt_type[joint] >= 2:
            low, high = (float(v) for v in model.jnt_range[joint])
            if not low - RANGE_TOLERANCE <= value <= high + RANGE_TOLERANCE:
                yield _outside("lint.key_position", model, "joint", joint, name, value, low, high)
    for drive in range(model.nu):
        value = float(ctrl[drive])
        low, high = (float(v) for v in model.actuator_ctrlrange[drive])
        if (
            model.actuator_ctrllimited[drive]
            and not low - RANGE_TOLERANCE <= value <= high + RANGE_TOLERANCE
        ):
            yield _outside("lint.key_ctrl", model, "actuator", drive, name, value, low, high)
        yield from _target(model, drive, name, qpos, value)


def _outside(
    rule: str, model: mujoco.Model, kind: str, index: int, key: str, v: float, lo: float, hi: float
) -> Finding:
    return Finding(
        rule=rule,
        severity="warning",
        subject=f"{kind} {mujoco.name_of(model, kind, index)}",
        message=f"keyframe `{key}`: {v:g} is outside {lo:g}..{hi:g}",
        hint="choose a value inside",
        data={"keyframe": key, "value": v, "lower": lo, "upper": hi},
    )


def _target(
    model: mujoco.Model, drive: int, key: str, qpos: Array, value: float
) -> Iterator[Finding]:
    """A position drive that pulls away from the pose it starts in."""
    gain, bias = float(model.actuator_gainprm[drive, 0]), float(model.actuator_biasprm[drive, 1])
    joint = int(model.actuator_trnid[drive, 0])
    if int(model.actuator_trntype[drive]) != 0 or gain <= 0.0 or bias != -gain:
        return
    at = float(qpos[model.jnt_qposadr[joint]])
    if abs(at - value) > TARGET_TOLERANCE:
        yield Finding(
            "lint.key_target",
            "warning",
            f"actuator {mujoco.name_of(model, 'actuator', drive)}",
            f"keyframe `{key}`: its target is {value:g}, the joint stands at {at:g}",
            hint="give the keyframe a `ctrl` that equals its positions",
            data={"keyframe": key, "target": value, "position": at},
        )


# --- left and right -------------------------------------------------------------------------


@dataclass(frozen=True)
class _Side:
    """One body at qpos0 in the frame of the root. inertia: (3, 3) about its centre of mass."""

    index: int
    place: Array
    com: Array
    inertia: Array
    mass: float


def mirrored(name: str) -> str | None:
    """The name on the other side; None for a part in the middle."""
    words = re.split(r"([_./ -])", name)
    for left, right in SIDES:
        for a, b in ((left, right), (right, left)):
            if a in words:
                return "".join(b if word == a else word for word in words)
    for a, b in (("left", "right"), ("right", "left"), ("Left", "Right"), ("Right", "Left")):
        if a in name:
            return name.replace(a, b)
    return None


def _mirror(model: mujoco.Model) -> Iterator[Finding]:
    import mujoco as mj

    if model.nbody < 3:
        return
    data = mj.MjData(model)
    mj.mj_kinematics(model, data)
    names = {mujoco.name_of(model, "body", i): i for i in range(1, model.nbody)}
    for name, index in names.items():
        other = names.get(mirrored(name) or "")
        if other is None or other <= index:
            continue
        a, b = _side(model, data, index), _side(model, data, other)
        apart = float(np.linalg.norm(FLIP @ a.place - b.place))
        if apart > PLACE_TOLERANCE_M or abs(a.place[1]) < PLACE_TOLERANCE_M:
            continue  # not mirrored at the root's plane: an arm beside another, fingers of a hand
        there = mujoco.name_of(model, "body", other)
        yield from _bodies_alike(name, there, a, b)
        yield from _joints_alike(model, data, a, b)


def _side(model: mujoco.Model, data: mujoco.Data, index: int) -> _Side:
    root = np.array(data.xmat[1]).reshape(3, 3)
    origin = np.array(data.xpos[1])
    turn = root.T @ np.array(data.ximat[index]).reshape(3, 3)
    return _Side(
        index,
        root.T @ (np.array(data.xpos[index]) - origin),
        root.T @ (np.array(data.xipos[index]) - origin),
        turn @ np.diag(model.body_inertia[index]) @ turn.T,
        float(model.body_mass[index]),
    )


def _bodies_alike(name: str, other: str, a: _Side, b: _Side) -> Iterator[Finding]:
    wanted = FLIP @ a.inertia @ FLIP
    size = float(np.linalg.norm(wanted)) or 1.0
    for what, difference, limit, unit in (
        ("mass", abs(a.mass - b.mass) / max(a.mass, b.mass, 1e-12), MASS_TOLERANCE, "relative"),
        ("centre of mass", float(np.linalg.norm(FLIP @ a.com - b.com)), PLACE_TOLERANCE_M, "m"),
        (
            "inertia",
            float(np.linalg.norm(wanted - b.inertia)) / size,
            INERTIA_TOLERANCE,
            "relative",
        ),
    ):
        if difference > limit:
            yield Finding(
                "lint.mirror",
                "warning",
                f"link {name}",
                f"its {what} is not the mirror image of `{other}`'s: {difference:.3g} {unit}",
                hint="was one side edited, or a sign of a product of inertia lost?",
                data={"what": what, "difference": difference, "limit": limit},
            )


def _joints_alike(model: mujoco.Model, data: mujoco.Data, a: _Side, b: _Side) -> Iterator[Finding]:
    """Limits and the first pose. A mirrored hinge turns about minus the mirrored axis."""
    if not (model.body_jntnum[a.index] == model.body_jntnum[b.index] == 1):
        return
    i, j = int(model.body_jntadr[a.index]), int(model.body_jntadr[b.index])
    if model.jnt_type[i] != model.jnt_type[j] or model.jnt_type[i] < 2:
        return
    root = np.array(data.xmat[1]).reshape(3, 3)
    turns = -1.0 if model.jnt_type[i] == 3 else 1.0
    along = float((turns * FLIP @ root.T @ data.xaxis[i]) @ (root.T @ data.xaxis[j]))
    name, other = mujoco.name_of(model, "joint", i), mujoco.name_of(model, "joint", j)
    if abs(abs(along) - 1.0) > LIMIT_TOLERANCE:
        yield _unlike(name, f"its axis is not the mirror image of `{other}`'s", abs(along))
        return
    sign = 1.0 if along > 0 else -1.0
    low, high = sorted(sign * float(v) for v in model.jnt_range[i])
    found = [float(v) for v in model.jnt_range[j]]
    difference = max(abs(low - found[0]), abs(high - found[1]))
    if model.jnt_limited[i] != model.jnt_limited[j] or difference > LIMIT_TOLERANCE:
        yield _unlike(name, f"its limits are not the mirror image of `{other}`'s", difference)
    if model.nkey:
        q, p = (float(model.key_qpos[0, model.jnt_qposadr[k]]) for k in (i, j))
        if abs(sign * q - p) > TARGET_TOLERANCE:
            message = f"at the first keyframe it is not the mirror image of `{other}`"
            yield _unlike(name, message, abs(sign * q - p))


def _unlike(joint: str, message: str, difference: float) -> Finding:
    return Finding(
        "lint.mirror",
        "warning",
        f"joint {joint}",
        f"{message}: {difference:.3g}",
        hint="was one side edited, or the sign of an axis changed?",
        data={"difference": difference},
    )
