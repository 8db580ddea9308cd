"""`deploy.yaml` of Unitree's unitree_rl_lab and unitree_rl_mjlab, beside a `policy.onnx`.

Joints are places on the motor bus: `joint_ids_map[i]` is the motor of the policy's joint i. Gains
stand in the order of the bus, all else in the policy's. Numbers have three significant digits.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from assetbuild.errors import UsageError
from assetbuild.policy.reading import Said, numbers_of, places, read_yaml
from assetbuild.policy.robot import Bot
from assetbuild.policy.stated import Policy, Term
from assetbuild.robot.orders import BUS

DIGITS = (5e-3, 0.0)
WORDS = {"keyboard_velocity_commands": "velocity_commands", "joint_vel": "joint_vel_rel"}
"""Its words for observations that are called otherwise in `terms`."""
SWITCHES = ("scale_first", "use_gym_history")


def read_deploy(path: Path, network: Path | None, bot: Bot) -> Policy:
    """UsageError for what the file lacks, or says of a robot with other motors."""
    config, bus = Said(path, read_yaml(path)), bot.orders[BUS]
    if "joint_ids_map" not in config.values:
        text = "neither a deploy.yaml, which has `joint_ids_map`, nor Isaac Lab's env.yaml"
        raise UsageError(f"`{path}` is {text}", hint="other descriptions of a policy are not read")
    config.need("joint_ids_map")
    joints = places(config, "joint_ids_map", bus)
    kp, kd = (_gains(config, key, bus, joints) for key in ("stiffness", "damping"))
    position = dict(zip(joints, config.numbers("default_joint_pos", len(joints)), strict=True))
    action = _action(config)
    acts_on = places(action, "joint_ids", joints)
    scale = action.numbers("scale", len(acts_on), 1.0)
    offset = action.numbers("offset", len(acts_on), 0.0)
    observations = _observations(config)
    return Policy(
        file=path,
        network=network,
        joints=joints,
        acts_on=acts_on,
        position=position,
        scale=dict(zip(acts_on, scale, strict=True)),
        offset=dict(zip(acts_on, offset, strict=True)),
        terms=tuple(_terms(observations, joints)),
        step_s=config.number("step_dt"),
        kp=kp,
        kd=kd,
        action_clip=_clips(action, acts_on),
        digits=DIGITS,
        by_time=bool(observations.values.get("use_gym_history")),
        scale_first=bool(observations.values.get("scale_first")),
    )


def _gains(
    config: Said, key: str, bus: tuple[str, ...], joints: tuple[str, ...]
) -> dict[str, float]:
    """Gains by joint; the list may leave out the last motors of the bus."""
    stated = config.need(key)
    count = len(stated) if isinstance(stated, list) else len(bus)
    last = max(bus.index(joint) for joint in joints) + 1
    if count < last:
        text = f"it ends at motor {count - 1} of the bus; the policy drives motor {last - 1}"
        raise config.wrong(key, text)
    values = config.numbers(key, min(count, len(bus)))
    return {joint: value for joint, value in zip(bus, values, strict=False) if joint in joints}


def _action(config: Said) -> Said:
    actions = config.at("actions")
    if list(actions.values) != ["JointPositionAction"]:
        listed = ", ".join(f"`{name}`" for name in actions.values) or "none"
        raise UsageError(
            f"{config.file.name}: actions: expected `JointPositionAction` alone, found {listed}"
        )
    return actions.at("JointPositionAction")


def _clips(action: Said, joints: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    stated = action.values.get("clip")
    if stated is None:
        return {}
    rows = stated if isinstance(stated, list) else [stated]
    if len(rows) != len(joints) or not all(isinstance(p, list) and len(p) == 2 for p in rows):
        raise action.wrong("clip", f"expected a pair for each of {len(joints)} joints")
    return {name: (float(a), float(b)) for name, (a, b) in zip(joints, rows, strict=True)}


def _observations(config: Said) -> Said:
    """The one group of terms; some files have several, by the names of the network's inputs."""
    observations = config.at("observations")
    if any("params" in observations.at(name).values for name in observations.values):
        return observations
    if len(observations.values) != 1:
        listed = ", ".join(f"`{name}`" for name in observations.values) or "none"
        raise observations.wrong("", f"expected one group of observations, found {listed}")
    return observations.at(next(iter(observations.values)))


def _terms(observations: Said, joints: tuple[str, ...]) -> Iterator[Term]:
    for name in observations.values:
        if name in SWITCHES:
            continue
        term = observations.at(name)
        params = term.at("params")
        term_joints = places(params.at("asset_cfg"), "joint_ids", joints)
        function = WORDS.get(name, name)
        yield Term(
            name,
            function,
            joints=term_joints if function.startswith("joint_") else (),
            scale=term.scale(),
            clip=term.clip(),
            history=int(term.number("history_length", 1.0)) or 1,
            params=numbers_of(params),
        )
