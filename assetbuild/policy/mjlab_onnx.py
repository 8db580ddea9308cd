"""An ONNX file of mjlab, which states in its metadata what it was trained with.

Joints are named, in MuJoCo's order; numbers have three decimals. The file does not say how often
the policy acts: as its bundle's recipe does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from assetbuild.errors import UsageError
from assetbuild.policy.robot import Bot
from assetbuild.policy.stated import Policy, Term

DIGITS = (0.0, 5.0001e-4)
WORDS = {
    "base_lin_vel": "imu_lin_vel",
    "base_ang_vel": "imu_ang_vel",
    "joint_pos": "joint_pos_rel",
    "joint_vel": "joint_vel_rel",
    "actions": "last_action",
    "command": "velocity_commands",
    "phase": "gait_phase",
}
"""mjlab's names of observations -> those of `terms`; velocities come from sensors at the IMU."""
NEEDED = ("joint_names", "default_joint_pos", "action_scale", "observation_names")


def read_metadata(path: Path, metadata: Mapping[str, str], bot: Bot) -> Policy:
    """UsageError for what the metadata lacks, or state of a robot with other joints."""
    for key in NEEDED:
        if key not in metadata:
            raise UsageError(f"`{path.name}`: its metadata state no `{key}`")
    joints = tuple(map(str.strip, metadata["joint_names"].split(",")))
    acts_on = tuple(name for name in joints if name in bot.driven or name not in bot.orders["urdf"])
    kp, kd = (
        _by_joint(path, metadata, key, acts_on) for key in ("joint_stiffness", "joint_damping")
    )
    position = _by_joint(path, metadata, "default_joint_pos", joints)
    scale = _by_joint(path, metadata, "action_scale", acts_on)
    return Policy(
        file=path,
        network=path,
        joints=joints,
        acts_on=acts_on,
        follows="mujoco",
        position=position,
        scale=scale,
        offset={name: position[name] for name in acts_on},
        terms=tuple(_terms(path, metadata, joints)),
        step_s=None,
        kp=kp,
        kd=kd,
        digits=DIGITS,
    )


def _by_joint(
    path: Path, metadata: Mapping[str, str], key: str, joints: tuple[str, ...]
) -> dict[str, float]:
    """One number for all joints, or one for each."""
    if key not in metadata:
        return {}
    try:
        numbers = [float(word) for word in metadata[key].split(",")]
    except ValueError:
        raise UsageError(f"`{path.name}`: {key}: `{metadata[key][:60]}` are no numbers") from None
    numbers = numbers * len(joints) if len(numbers) == 1 else numbers
    if len(numbers) != len(joints):
        raise UsageError(
            f"`{path.name}`: {key}: expected {len(joints)} numbers, found {len(numbers)}"
        )
    return dict(zip(joints, numbers, strict=True))


def _terms(path: Path, metadata: Mapping[str, str], joints: tuple[str, ...]) -> Iterator[Term]:
    names = map(str.strip, metadata["observation_names"].split(","))
    scales, clips, histories, flat = (
        metadata.get(f"observation_terms_{key}", "").split(",")
        for key in ("scale", "clip", "history_length", "flatten_history_dim")
    )
    for index, name in enumerate(names):
        clip, history = _row(clips, index), int((_row(histories, index) or (1.0,))[0]) or 1
        if flat[index : index + 1] == ["False"] and history > 1:
            raise UsageError(f"`{path.name}`: the history of `{name}` is not flattened")
        yield Term(
            name,
            WORDS.get(name, name),
            joints=joints if name in ("joint_pos", "joint_vel") else (),
            scale=_row(scales, index) or (1.0,),
            clip=(clip[0], clip[1]) if len(clip) == 2 else None,
            history=history,
        )


def _row(words: list[str], index: int) -> tuple[float, ...]:
    """Numbers with semicolons between them; nothing of what is not stated."""
    try:
        return tuple(float(word) for word in words[index].split(";"))
    except (IndexError, ValueError):
        return ()
