"""What mjlab's module must say of a robot, from the robot, the recipe and mjlab's own rules."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from assetbuild.facts.readers.mjlab import said
from assetbuild.facts.reference import Reference, pose_value
from assetbuild.facts.statements import put_words
from assetbuild.facts.syntax import Module
from assetbuild.facts.table import Table, Value, Writer
from assetbuild.facts.trainers import (
    Event,
    delay_s,
    massive_bodies,
    randomize_of,
    ranges_of,
    stall_of,
    start_of,
)
from assetbuild.robot.model import Actuator
from assetbuild.robot.pose import Pose, rotation_of
from assetbuild.robot.ranges import Randomize, RandomMatter, RandomPayload, claimed, per_axis
from assetbuild.robot.tree import forward_kinematics

FORM = said.FORM
CLASSES = {model: name for name, model in said.MODELS.items()}
LOOPS = ("pd", "ideal_pd", "dc_motor")
"""Drives that hold a position, which mjlab's terms for gains and effort know."""
COLLISION = re.compile(r".*_collision\d*")
"""What mjlab's configurations call geoms that touch something."""


@dataclass(frozen=True)
class Foot:
    """A body with soles. site: its lowest sole link; geoms: its soles in the bare MJCF."""

    body: str
    site: str
    geoms: tuple[str, ...]


def expected_table(reference: Reference, robot: str) -> Table:
    """All facts and words of the module."""
    book = Writer()
    asked = {**said.TASK, **(reference.options.get("mjlab") or {})}
    drives = [a for a in reference.control.actuators if a.model in CLASSES]
    feet = _feet(reference)
    _robot(reference, robot, asked, feet, book)
    _drives(reference, asked["action"], drives, book)
    events = _events(reference, drives)
    for event in events:
        event.put(FORM, book)
    walks = reference.tree.base == "floating" and bool(feet) and bool(drives)
    if walks:
        _walk(asked["pose"], _groups(randomize_of(reference), drives), book)
    text = _text(reference, asked, drives, feet, events, walks=walks)
    put_words(Module.parsed(text, "expected"), FORM, book, said.READ)
    return said.with_task_facts(book).table()


def _feet(reference: Reference) -> list[Foot]:
    """One for each body that stands on something, in the order of the bodies."""
    pattern = (reference.options.get("feet") or {}).get("links")
    tree, start = reference.tree, start_of(reference)
    X_root_body = forward_kinematics(tree, dict(start.joints))
    names = _geom_names(reference)
    soles: dict[str, list[tuple[float, str, str]]] = {}
    for shape in reference.shapes.of("collision"):
        if pattern and re.fullmatch(pattern, shape.link):
            body, X_body_link = tree.placement(shape.link)
            X_world_link = tree.root_pose(start) @ X_root_body[body] @ X_body_link
            sole = (X_world_link.xyz[2], shape.link, names[shape.name])
            soles.setdefault(body, []).append(sole)
    return [
        Foot(body, min(own, key=lambda sole: sole[0])[1], tuple(geom for _, _, geom in own))
        for body, own in sorted(soles.items(), key=lambda item: [*tree.by_body].index(item[0]))
    ]


def _geom_names(reference: Reference) -> dict[str, str]:
    """What the bare MJCF calls collision shapes; a number tells new names apart from taken ones."""
    names: dict[str, str] = {}
    taken = {shape.name for shape in reference.shapes.shapes}
    for shape in reference.shapes.of("collision"):
        name = shape.name
        if not COLLISION.fullmatch(name):
            wanted = (f"{shape.name}_collision{n}" for n in ("", *range(2, len(taken) + 3)))
            name = next(one for one in wanted if one not in taken)
            taken.add(name)
        names[shape.name] = name
    return names


def _robot(
    reference: Reference,
    robot: str,
    asked: dict[str, Any],  # Any: JSON
    feet: list[Foot],
    book: Writer,
) -> None:
    tree, simulation = reference.tree, reference.control.simulation
    start = start_of(reference)
    imu = (reference.options.get("imu") or {}).get("link") or tree.root
    words: dict[str, Value] = {
        "XML": f"mjcf/{robot}_bare.xml",
        "ROOT_BODY": tree.root,
        "IMU_SITE": imu,
        "FOOT_SITES": tuple(foot.site for foot in feet),
        "FOOT_GEOMS": tuple(geom for foot in feet for geom in foot.geoms),
        "robot_cfg": "EntityCfg",
        "spec_fn": "spec",
        "init_state": "EntityCfg.InitialStateCfg",
        "articulation": "EntityArticulationInfoCfg",
        "length of rot": 1.0,
    }
    book.put("robot", "", {f"{FORM}:{name}": value for name, value in words.items()})
    base = start.base or tree.X_world_root
    soft = asked["soft_joint_pos_limit_factor"]
    book.put("robot", "", {"start pose": pose_value(base), "soft limits": soft})
    steps: dict[str, Value] = {
        "timestep": simulation.timestep,
        "decimation": simulation.decimation,
        "gravity": tuple(simulation.gravity),
    }
    book.put("simulation", "", steps)
    for joint, position in start.joints:
        book.put("joint", joint, {"start": position, f"{FORM}:start velocity": 0.0})


def _drives(
    reference: Reference,
    action: Mapping[str, float],
    drives: list[Actuator],
    book: Writer,
) -> None:
    """Numbers of joints that mjlab can drive; passive ones are whole in the bare MJCF."""
    randomize, timestep = randomize_of(reference), reference.control.simulation.timestep
    kinds = {joint.name: joint.kind for joint in reference.tree.moving_joints}
    for drive in drives:
        delay = delay_s(ranges_of(randomize, drive.joint).delay, timestep)
        facts: dict[str, Value] = {
            "model": drive.model, "effort": drive.effort, "armature": drive.armature,
            "friction": drive.friction, "damping": drive.damping, "delay": delay,
        }  # fmt: skip
        if drive.model in LOOPS:
            facts["kp"] = drive.kp
        if drive.model in (*LOOPS, "velocity"):
            facts["kd"] = drive.kd
        if drive.model == "dc_motor":
            facts |= {"velocity": drive.velocity, "stall": stall_of(drive)}
        if drive.kp and drive.effort:
            most = action["m" if kinds[drive.joint] == "prismatic" else "rad"]
            scale = min(action["effort_share"] * drive.effort / drive.kp, most)
            facts[f"{FORM}:action scale"] = scale
        book.put("joint", drive.joint, facts)
    for group, joints in enumerate(_groups(randomize, drives)):
        for number, joint in enumerate(joints):
            words: dict[str, Value] = {"group": group, "place in its group": number}
            book.put("joint", joint, {f"{FORM}:{word}": value for word, value in words.items()})


def _groups(randomize: Randomize | None, drives: list[Actuator]) -> list[list[str]]:
    """Joints whose drives have equal numbers and ranges, which stand together."""
    groups: dict[tuple[Actuator, str], list[str]] = {}
    for drive in drives:
        numbers = replace(drive, joint="", name="", source="")
        drawn = ranges_of(randomize, drive.joint).model_dump_json()
        groups.setdefault((numbers, drawn), []).append(drive.joint)
    return list(groups.values())


def _walk(
    pose: dict[str, Any],  # Any: JSON
    groups: list[list[str]],
    book: Writer,
) -> None:
    """Which joints the velocity task keeps near their start, and how near."""
    names = [joint for joints in groups for joint in joints]
    knees = [name for name in names if re.fullmatch(pose["knees"], name)]
    for word, listed in (("JOINTS", names), ("KNEES", knees)):
        for number, joint in enumerate(listed):
            book.put("joint", joint, {f"{FORM}:place in {word}": number})
    for gait in ("standing", "walking", "running"):
        book.put("robot", "", {f"{FORM}:std_{gait}": tuple(pose[gait])})


# --- events -----------------------------------------------------------------------------------


def _events(reference: Reference, drives: list[Actuator]) -> list[Event]:
    randomize = randomize_of(reference)
    if randomize is None:
        return []
    found = [
        *_matter(reference, randomize),
        *_payloads(reference, randomize),
        *_joints(reference, randomize, drives),
    ]
    if randomize.friction is not None:
        drawn: dict[str, Value] = {
            "shape": (r".*_collision\d*",), "ranges": randomize.friction, "operation": "abs",
            "axes": (0,), "shared_random": True,
        }  # fmt: skip
        found.append(Event("friction", "dr.geom_friction", params=drawn))
    return found


def _matter(reference: Reference, randomize: Randomize) -> Iterator[Event]:
    """J' = U J Uᵀ with U = exp(alpha) [[A, t], [0, 1]]: the mass grows by exp(2 alpha)."""
    for index, (_, matter, bodies) in enumerate(
        claimed(randomize.links, massive_bodies(reference))
    ):
        params = {f"{name}_range": value for name, value in _cholesky(matter)}
        yield Event(f"matter_{index}", "dr.pseudo_inertia", "body", bodies, params)


def _cholesky(matter: RandomMatter) -> Iterator[tuple[str, tuple[float, float]]]:
    low, high = matter.density
    yield "alpha", (math.log(low) / 2, math.log(high) / 2)
    for axis, most in enumerate(per_axis(matter.com), start=1):
        yield f"t{axis}", (-most, most)
    if matter.stretch:
        yield "d", (-matter.stretch, matter.stretch)
    for pair in ("12", "13", "23") if matter.shear else ():
        yield f"s{pair}", (-matter.shear, matter.shear)


def _payloads(reference: Reference, randomize: Randomize) -> Iterator[Event]:
    massive = massive_bodies(reference)
    for index, payload in enumerate(randomize.payloads):
        body, X_body_link = reference.tree.placement(payload.link)
        if body in massive:
            params: dict[str, Value] = {
                "mass_range": payload.mass, "box": _box(payload, X_body_link)
            }  # fmt: skip
            yield Event(f"payload_{index}", "carry_payload", "body", (body,), params)


def _box(payload: RandomPayload, X_body_link: Pose) -> tuple[float, ...]:
    """(16,) [[S, h], [h, 1]] of one kilogram: second moments e²/12 along its edges, m²."""
    turn = rotation_of(X_body_link.quat)
    centre = turn @ np.array(payload.at) + np.array(X_body_link.xyz)
    second = turn @ np.diag(np.square(payload.size) / 12.0) @ turn.T
    matter = np.eye(4)
    matter[:3, :3] = second + np.outer(centre, centre)
    matter[:3, 3] = matter[3, :3] = centre
    return tuple(map(float, matter.ravel()))


def _joints(reference: Reference, randomize: Randomize, drives: list[Actuator]) -> Iterator[Event]:
    moving = [joint.name for joint in reference.tree.moving_joints]
    for index, (_, ranges, joints) in enumerate(claimed(randomize.joints, moving)):
        loops = [a for a in drives if a.model in LOOPS and a.joint in joints]
        held = [a.joint for a in loops]
        if held and (ranges.kp, ranges.kd) != ((1.0, 1.0), (1.0, 1.0)):
            gains: dict[str, Value] = {"kp_range": ranges.kp, "kd_range": ranges.kd}
            yield Event(f"gains_{index}", "dr.pd_gains", "joint", held, gains)
        limited = [a.joint for a in loops if a.effort is not None]
        if limited and ranges.effort != (1.0, 1.0):
            share: dict[str, Value] = {"effort_limit_range": ranges.effort}
            yield Event(f"effort_{index}", "dr.effort_limits", "joint", limited, share)
        for quantity in ("damping", "friction", "armature"):
            factor = getattr(ranges, quantity)
            if factor != (1.0, 1.0):
                scale: dict[str, Value] = {"ranges": factor, "operation": "scale"}
                name, func = f"{quantity}_{index}", f"dr.joint_{quantity}"
                yield Event(name, func, "joint", joints, scale)
        if ranges.encoder_bias:
            bias: dict[str, Value] = {"bias_range": (-ranges.encoder_bias, ranges.encoder_bias)}
            yield Event(f"encoder_bias_{index}", "dr.encoder_bias", "joint", joints, bias)


# --- statements -------------------------------------------------------------------------------


def _text(
    reference: Reference,
    asked: dict[str, Any],  # Any: JSON
    drives: list[Actuator],
    feet: list[Foot],
    events: list[Event],
    *,
    walks: bool,
) -> str:
    """Imports and statements in mjlab's words; a 0 where values are facts."""
    carries = any(event.func == "carry_payload" for event in events)
    parts = [said.IMPORTS]
    classes = sorted({CLASSES[drive.model] for drive in drives})
    parts += [f"from mjlab.actuator import {name}" for name in classes]
    parts += [said.WALKING_IMPORTS] if walks else []
    parts += [said.EVENT_IMPORTS] if events else []
    if any(event.func.startswith("dr.") for event in events):
        parts.append("from mjlab.envs.mdp import dr")
    parts += [said.CARRY_IMPORTS] if carries else []
    parts.append(said.ROBOT)
    parts += [said.CARRY] if carries else []
    parts += [said.EVENTS] if events else []
    if walks:
        lines = "\n".join(f"    {line}" for line in _event_lines(reference, events))
        words = {**asked, **asked["foot_scan"], "soles": _match(feet), "events": lines}
        parts.append(said.VELOCITY.format(**words))
    return "\n".join(parts)


def _event_lines(reference: Reference, events: list[Event]) -> Iterator[str]:
    """Terms of mjlab's task that say the same as the recipe's would act twice."""
    randomize = randomize_of(reference)
    if randomize is not None:
        rows = claimed(randomize.links, massive_bodies(reference))
        twice = {
            "base_com": any(reference.tree.root in bodies for _, _, bodies in rows),
            "encoder_bias": any(ranges.encoder_bias for ranges in randomize.joints.values()),
            "foot_friction": randomize.friction is not None,
        }
        yield from (f'cfg.events.pop("{name}", None)' for name, found in twice.items() if found)
    if events:
        yield "cfg.events |= randomize_events()"


def _match(feet: list[Foot]) -> str:
    """Contacts count by foot: a foot of several shapes is its body."""
    if all(len(foot.geoms) == 1 for foot in feet):
        return 'mode="geom", pattern=FOOT_GEOMS'
    return f'mode="body", pattern={tuple(foot.body for foot in feet)!r}'
