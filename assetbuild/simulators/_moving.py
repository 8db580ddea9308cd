"""What an engine's program does with its runs: one loop, whatever moves the robot.

Runs in any Python, beside `_answering`. A world is a loaded stage: `held()` tells what the engine
holds; `start(positions)`, `command(targets, speeds)`, `push(table, force)` and `step(dt)` move it;
`look()` gives the root's pose, the centre of mass, joints by name in the order in which the engine
counts them, and a function from a name to a pose (of a body, or of the object). All is SI, poses
are xyz and a quaternion wxyz.
"""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import numpy as np

OBJECT = "/World/object"
TABLE = "/World/table"
"""Prims of what is gripped and of what it lies on, as `stage_world` defines them."""


def perform(world: Any, run: dict[str, Any]) -> dict[str, Any]:
    """What the engine holds, where the run asks so, and where it moved."""
    result: dict[str, Any] = {}
    if not run["steps"] or run.get("reads"):
        result["held"] = world.held()
    if run["pilot"]:
        piloted(world, run)
    elif run["steps"]:
        result["motion"] = moved(world, run)
    return result


def write(job: dict[str, Any], run: dict[str, Any], result: dict[str, Any]) -> None:
    """The answer of a run, whole or not at all."""
    path = Path(job["answers"]) / f"{run['name']}.json"
    path.with_suffix(".part").write_text(json.dumps(result), encoding="utf-8")
    path.with_suffix(".part").rename(path)


def moved(world: Any, run: dict[str, Any]) -> dict[str, Any]:
    """Trajectories, the start included, until something is not finite."""
    course = run["course"]
    track: dict[str, Any] = {"time": [], "root": [], "com": [], "seen": [], "joints": {}}
    track["finite"] = True
    world.start(run["start"])
    for step in range(run["steps"] + 1):
        if step:
            targets, speeds = (
                {name: row[step - 1] for name, row in run[word].items() if step <= len(row)}
                for word in ("targets", "speeds")
            )
            world.command(targets, speeds)
            if course:
                world.push(course["table"][step - 1], course["force"][step - 1])
            world.step(run["dt"])
        if step % run["every"] and step != run["steps"]:
            continue
        root, centre, joints, pose = world.look()
        track["time"].append(run["dt"] * step)
        track["root"].append([float(v) for v in root])
        track["com"].append([float(v) for v in centre])
        for name, value in joints.items():
            track["joints"].setdefault(name, []).append(value)
        if course:
            at = pose(OBJECT)[:3]
            track["seen"].append([into(pose(body), at) for body in course["watched"]])
        track["finite"] = bool(np.isfinite([*root, *centre, *joints.values()]).all())
        if not track["finite"]:
            break
    return track


def piloted(world: Any, run: dict[str, Any]) -> None:
    """Motion that somebody at the other end of a socket commands, who alone sees it.

    Each line that comes is {"targets": rad or m by joint, "steps": n}; each line that goes has the
    root's pose and the joints before the last of these steps, and after it. The end of the lines
    ends the run.
    """
    with socket.socket(socket.AF_UNIX) as line:
        line.connect(run["pilot"])
        with line.makefile("rw", encoding="utf-8") as talk:
            world.start(run["start"])
            before = after = world.look()
            while True:
                states = [
                    [[float(v) for v in root], joints] for root, _, joints, _ in (before, after)
                ]
                talk.write(json.dumps(states) + "\n")
                talk.flush()
                asked = json.loads(talk.readline() or "null")
                if asked is None:
                    break
                world.command(asked["targets"], {})
                for step in range(asked["steps"]):
                    before = world.look() if step == asked["steps"] - 1 else before
                    world.step(run["dt"])
                after = world.look()


def into(pose: Any, point: Any) -> list[float]:
    """A point of the world in the frame of a pose."""
    offset = np.asarray(point) - pose[:3]
    return [float(v) for v in turned([pose[3], *(-v for v in pose[4:])], offset)]


def turned(quat: Any, vector: Any) -> Any:
    """The vector in the world; quat: wxyz."""
    w, x = quat[0], np.asarray(quat[1:])
    half = 2.0 * np.cross(x, vector)
    return vector + w * half + np.cross(x, half)
