"""`params/env.yaml`, which Isaac Lab writes beside its checkpoints: the whole environment.

Joints are found by patterns among those of the robot, in Isaac Lab's order, breadth first. Where a
pattern is given twice, the last one counts, as in Isaac Lab.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from assetbuild.errors import UsageError
from assetbuild.policy.reading import Said, numbers_of, read_yaml
from assetbuild.policy.robot import Bot
from assetbuild.policy.stated import Policy, Term
from assetbuild.robot.orders import breadth_first

WORDS = {"generated_commands": "velocity_commands", "joint_vel": "joint_vel_rel"}
"""Its functions that are called otherwise in `terms`."""


def read_env(path: Path, network: Path | None, bot: Bot) -> Policy:
    """UsageError for what the file lacks, or says of a robot with other joints."""
    config = Said(path, read_yaml(path))
    robot = config.at("scene").at("robot")
    joints = _driven(robot.at("actuators"), bot)
    start = robot.at("init_state")
    position = dict.fromkeys(joints, 0.0) | _by_pattern(start.values.get("joint_pos"), joints)
    kp, kd = dict[str, float](), dict[str, float]()
    for name in robot.at("actuators").values:
        drive = robot.at("actuators").at(name)
        drive_joints = _matching(drive.values.get("joint_names_expr"), joints)
        kp |= _by_pattern(drive.values.get("stiffness"), drive_joints)
        kd |= _by_pattern(drive.values.get("damping"), drive_joints)
    action = _action(config.at("actions"))
    config.at("observations").need("policy")
    acts_on = _named(action, joints)
    offset = dict.fromkeys(acts_on, 0.0) | _by_pattern(action.values.get("offset"), acts_on)
    if action.values.get("use_default_offset", True):
        offset = {name: position[name] for name in acts_on}
    clips = action.at("clip").values
    timestep = config.at("sim").number("dt")
    quat = start.values.get("rot")
    return Policy(
        file=path,
        network=network,
        joints=joints,
        acts_on=acts_on,
        follows="isaaclab",
        position=position,
        scale=dict.fromkeys(acts_on, 1.0) | _by_pattern(action.values.get("scale"), acts_on),
        offset=offset,
        terms=tuple(_terms(config.at("observations").at("policy"), joints)),
        step_s=timestep * config.number("decimation"),
        kp=kp,
        kd=kd,
        action_clip={
            name: (float(low), float(high))
            for pattern, (low, high) in clips.items()
            for name in _matching([pattern], acts_on)
        },
        start_quat=tuple(map(float, quat)) if isinstance(quat, list) and len(quat) == 4 else None,
    )


def _driven(drives: Said, bot: Bot) -> tuple[str, ...]:
    """The joints that its robot has: each has a drive; this robot may have more."""
    known, driven = bot.orders["isaaclab"], set[str]()
    for name in drives.values:
        driven |= set(_matching(drives.at(name).values.get("joint_names_expr"), known))
    return breadth_first(bot.tree, driven) if driven else known


def _action(actions: Said) -> Said:
    """The one action that is a target of joints."""
    named = {name: str(actions.at(name).values.get("class_type")) for name in actions.values}
    # Others end so as well: `RelativeJointPositionAction` counts from where the joint is.
    if [kind.rpartition(":")[2] for kind in named.values()] != ["JointPositionAction"]:
        listed = ", ".join(f"`{name}` ({kind.rpartition(':')[2]})" for name, kind in named.items())
        raise actions.wrong("", f"expected one JointPositionAction, found {listed or 'none'}")
    return actions.at(next(iter(named)))


def _matching(patterns: Any, joints: Sequence[str]) -> tuple[str, ...]:  # Any: plain YAML
    """Joints that any of the patterns matches whole, in their own order; all without patterns."""
    words = [patterns] if isinstance(patterns, str) else patterns
    if not isinstance(words, list):
        return tuple(joints)
    try:
        return tuple(n for n in joints if any(re.fullmatch(str(word), n) for word in words))
    except re.error as error:
        raise UsageError(f"`{words}` are no patterns of joints: {error}") from None


def _named(entity: Said, joints: Sequence[str]) -> tuple[str, ...]:
    """The joints that an action or an observation is about, in its order."""
    patterns = entity.values.get("joint_names")
    if not entity.values.get("preserve_order") or not isinstance(patterns, list):
        return _matching(patterns, joints)
    return tuple(dict.fromkeys(name for p in patterns for name in _matching([p], joints)))


def _by_pattern(value: Any, joints: Sequence[str]) -> dict[str, float]:  # Any: as above
    """One number for all joints, or numbers by pattern."""
    if isinstance(value, dict):
        by_joint: dict[str, float] = {}
        for pattern, number in value.items():
            by_joint |= _by_pattern(number, _matching([pattern], joints))
        return by_joint
    if isinstance(value, int | float) and not isinstance(value, bool):
        return dict.fromkeys(joints, float(value))
    return {}


def _terms(group: Said, joints: tuple[str, ...]) -> Iterator[Term]:
    """The group's own history length, where it states one, is that of all its terms."""
    common = group.values.get("history_length")
    for name in group.values:
        term = group.at(name)
        if not term.values:  # a switch of the group
            continue
        function = str(term.values.get("func", name)).rpartition(":")[2]
        function = WORDS.get(function, function)
        if term.values.get("modifiers"):
            raise term.wrong("modifiers", "observations that are modified cannot be replayed")
        term_joints = _named(term.at("params").at("asset_cfg"), joints)
        length = term.values.get("history_length") if common is None else common
        yield Term(
            name,
            function,
            joints=term_joints if function.startswith("joint_") else (),
            scale=term.scale(),
            clip=term.clip(),
            history=int(length or 1),
            params=numbers_of(term.at("params")),
        )
