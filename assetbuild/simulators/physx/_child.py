"""The program that runs PhysX: one process, one job, native crashes and all.

`ovphysx` brings a USD runtime of its own and may crash, hang or return NaN; so it never shares a
process with `pxr` or with a step. The answers are files beside the job: `<run>.json` (what PhysX
holds after loading) and `<run>.npz` (what it did). Everything here is in the units of the
interface: degrees for joints, quaternions xyzw; `simulators.physx` makes SI.
"""

from __future__ import annotations

import gc
import json
import math
import os
from collections.abc import Sequence
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import numpy as np

TABLE, OBJECT = "/World/table", "/World/object"
"""As `scene` defines them."""
Sim = Any  # ovphysx.PhysX: its types are not checked here
Stage = Any  # ovstage.Stage: as above

ROOT = ("isFixedBase", "dofCount", "shapeCount", "rootPosition", "rootOrientation")
LINK = (
    "mass",
    "inertia",
    "centerOfMassPosition",
    "shapeCount",
    "staticFriction",
    "dynamicFriction",
    "restitution",
)
Table = dict[str, dict[str, list[float]]]


def answer(job: dict[str, Any]) -> dict[str, Any]:  # Any: JSON
    """Do all runs; the answers are files."""
    sim = _start()
    for run in job["runs"]:
        _perform(sim, run, job["joint_numbers"], Path(job["answers"]))
    sim.destroy()
    return {}


def _start() -> Sim:
    """A CPU simulation that steps in this thread: a pool of threads crawls on a shared machine."""
    import ovstage
    from ovphysx import GlobalConfigKey, PhysX, set_global_config

    PhysX.set_cpu_mode(True)
    set_global_config(GlobalConfigKey.NUM_THREADS, 0)
    sim = PhysX()
    # Newton's schema stays unregistered: its spelling of a number would hide the loss of PhysX's.
    schemas = distribution("physx-usd-schemas")
    names = ("PhysxSchema", "OmniUsdPhysicsDeformableSchema")
    folders = [schemas.locate_file(f"physx_usd_schemas/{name}/resources") for name in names]
    ovstage.population.register_usd_schemas([str(folder) for folder in folders])
    return sim


def _perform(sim: Sim, run: dict[str, Any], numbers: list[str], answers: Path) -> None:
    # Any: JSON
    """Load one stage, say what it holds, step it, write down where it went."""
    import ovstage

    stage = ovstage.Stage(run["name"])
    ovstage.population.open_usd(
        stage, run["stage"], ordinal=1, domains=ovstage.PopulationDomain.ALL
    )
    stage.advance_write_floor(ordinal=1).wait()
    sim.wait_task(sim.attach_ovstage(stage, read_ordinal=1))
    sim.wait_all()
    paths = ovstage.PathDictionary(stage)
    try:
        held = _held(sim, paths, numbers)
        text = json.dumps(held if run["steps"] else held | _places(sim, paths, run["turn"]))
        (answers / f"{run['name']}.json").write_text(text, encoding="utf-8")
        if run["steps"]:
            track = _simulate(sim, paths, run)
            np.savez(answers / f"{run['name']}.npz", **track)  # type: ignore[arg-type] # arrays only
            if not all(np.isfinite(track[key]).all() for key in ("root", "turn", "com", "joints")):
                # PhysX does not come back from a NaN: the next stage gets a fresh process.
                (answers / f"{run['name']}.done").touch()
                (answers / "answer.json").write_text("{}", encoding="utf-8")
                os._exit(0)
    finally:
        del paths
        gc.collect()
        sim.wait_task(sim.detach_ovstage())
        stage.destroy()
    (answers / f"{run['name']}.done").touch()


# --- what PhysX holds -----------------------------------------------------------------------


def _held(sim: Sim, paths: Any, joint_numbers: list[str]) -> dict[str, Table]:
    # Any: ovstage.PathDictionary
    from ovphysx.types import SimObjectType

    return {
        "articulations": _read_each(sim, paths, SimObjectType.ARTICULATION, ROOT),
        "links": _read_each(sim, paths, SimObjectType.ARTICULATION_LINK, LINK),
        "joints": _read_each(sim, paths, SimObjectType.ARTICULATION_JOINT, joint_numbers),
        "loose": _read_each(sim, paths, SimObjectType.RIGID_BODY, ("mass",)),
    }


def _places(sim: Sim, paths: Any, turn: dict[str, float]) -> dict[str, Table]:
    # Any: as above
    """Where each link is with every joint at 0, and with every joint at its `turn`."""
    from ovphysx.types import SimObjectType

    found, here = {}, _joints(sim, paths, "jointPosition")
    turned = {path: turn.get(path, 0.0) for path in here}
    for name, positions in (("zero", dict.fromkeys(here, 0.0)), ("turned", turned)):
        # This moves the links; `update_articulations_kinematic` would let drives and limits pull.
        _write_joints(sim, paths, "jointPosition", positions)
        kind = SimObjectType.ARTICULATION_LINK
        found[name] = _read_each(sim, paths, kind, ("position", "orientation"))
    return found


def _read_each(sim: Sim, paths: Any, kind: Any, attributes: Sequence[str]) -> Table:
    # Any: as above, and ovphysx's enumeration
    """Values by prim path and attribute; one read per attribute keeps groups and names simple."""
    table: Table = {}
    for attribute in attributes:
        for path, values in _read(sim, paths, kind, attribute):
            table.setdefault(path, {})[attribute] = values.ravel().astype(float).tolist()
    return table


def _read(sim: Sim, paths: Any, kind: Any, attribute: str) -> list[tuple[str, np.ndarray]]:
    # Any: as above
    """(path, values) per prim. Copied at once: a live alias keeps the simulation from closing."""
    from ovphysx.types import ObjectScope

    found = []
    with sim.read_sync(kind, [attribute], scope=ObjectScope.ALL) as result:
        for group in result.groups:
            if group.is_delete or not group.tensors:
                continue
            names = [str(name) for name in paths.get_path_strings(group.prim_list)]
            arrays = [np.array(tensor.numpy(), copy=True) for tensor in group.tensors]
            # A fixed group stacks its prims in one array, an array group has one for each prim.
            rows = arrays if len(arrays) == len(names) else list(arrays[0])
            found += list(zip(names, rows, strict=True))
    return found


# --- what it does ---------------------------------------------------------------------------


def _simulate(sim: Sim, paths: Any, run: dict[str, Any]) -> dict[str, np.ndarray]:
    # Any: as above, JSON
    """Trajectories of `run["steps"]` steps, the start included, until something is not finite."""
    from ovphysx.types import SimObjectType

    dt, drive = float(run["dt"]), run["targets"]
    here = _joints(sim, paths, "jointPosition") | run["start"]
    asked = _joints(sim, paths, "jointPositionTarget")
    speeds = _joints(sim, paths, "jointVelocityTarget") if drive["speeds"] else {}
    _write_joints(sim, paths, "jointPosition", here)
    sim.update_articulations_kinematic()
    times: list[float] = []
    tracks: dict[str, list[np.ndarray]] = {"root": [], "turn": [], "com": [], "joints": []}
    kind = SimObjectType.ARTICULATION
    names: list[str] = []
    course = dict(np.load(run["course"])) if run["course"] else None
    for step in range(int(run["steps"]) + 1):
        if step:
            if course is not None:
                _follow(sim, paths, course, step, asked)
            if drive["joints"] and (drive["frequency"] or step == 1):
                asked |= targets_at(drive, dt * step)
                _write_joints(sim, paths, "jointPositionTarget", asked)
                _write_joints(
                    sim, paths, "jointVelocityTarget", speeds | speeds_at(drive, dt * step)
                )
            sim.step_sync(dt)
        if step % int(run["every"]) and step != int(run["steps"]):
            continue
        joints = _read(sim, paths, SimObjectType.ARTICULATION_JOINT, "jointPosition")
        names = [name for name, _ in joints]
        positions = [values.ravel()[:1] for _, values in joints]
        tracks["joints"].append(np.concatenate(positions) if positions else np.zeros(0))
        for key, attribute in (
            ("root", "rootPosition"),
            ("turn", "rootOrientation"),
            ("com", "centerOfMassWorld"),
        ):
            tracks[key].append(_read(sim, paths, kind, attribute)[0][1].ravel())
        if course is not None:
            tracks.setdefault("seen", []).append(_seen(sim, paths, course["watched"]))
        times.append(dt * step)
        if not all(np.isfinite(track[-1]).all() for track in tracks.values()):
            break
    out = {key: np.array(track, dtype=np.float64) for key, track in tracks.items()}
    return out | {"time": np.array(times), "names": np.array(names, dtype=str)}


def _follow(
    sim: Sim, paths: Any, course: dict[str, np.ndarray], step: int, asked: dict[str, float]
) -> None:  # Any: as above
    """Command drives, move the table and shake the object as the course says for this step."""
    from ovphysx.types import SimObjectType

    targets = course["targets"][step].tolist()
    asked |= dict(zip(course["drives"].tolist(), targets, strict=True))
    _write_joints(sim, paths, "jointPositionTarget", asked)
    for path, attribute, value in (
        (TABLE, "kinematicTargetPosition", course["table"][step]),
        (OBJECT, "force", course["force"][step]),
    ):
        with sim.write_sync(SimObjectType.RIGID_BODY, attribute, pattern=path) as writing:
            for group in writing.groups:
                group.tensors[0].numpy()[...] = value
                writing.commit_sync(group)


def _seen(sim: Sim, paths: Any, watched: np.ndarray) -> np.ndarray:  # Any: as above
    """(k, 3) place of the object in the frames of links."""
    from ovphysx.types import SimObjectType

    link = SimObjectType.ARTICULATION_LINK
    places, turns = (dict(_read(sim, paths, link, key)) for key in ("position", "orientation"))
    at = dict(_read(sim, paths, SimObjectType.RIGID_BODY, "position"))[OBJECT].ravel()
    seen = []
    for path in watched.tolist():
        x, w = -turns[path].ravel()[:3], turns[path].ravel()[3]
        offset = at - places[path].ravel()
        half = 2.0 * np.cross(x, offset)
        seen.append(offset + w * half + np.cross(x, half))
    return np.array(seen)


def _joints(sim: Sim, paths: Any, attribute: str) -> dict[str, float]:
    # Any: as above
    """One number of every joint, by path."""
    from ovphysx.types import SimObjectType

    rows = _read(sim, paths, SimObjectType.ARTICULATION_JOINT, attribute)
    return {path: float(values.ravel()[0]) for path, values in rows}


def targets_at(drive: dict[str, Any], time: float) -> dict[str, float]:  # Any: JSON
    """Position target of each driven joint: middle + amplitude sin(2 pi f t)."""
    wave = math.sin(2.0 * math.pi * float(drive["frequency"]) * time)
    return {path: middle + swing * wave for path, (middle, swing) in drive["joints"].items()}


def speeds_at(drive: dict[str, Any], time: float) -> dict[str, float]:  # Any: JSON
    """Speed target of each joint that takes one: 2 pi f amplitude cos(2 pi f t)."""
    omega = 2.0 * math.pi * float(drive["frequency"])
    wave = omega * math.cos(omega * time)
    return {path: drive["joints"][path][1] * wave for path in drive["speeds"]}


def _write_joints(sim: Sim, paths: Any, attribute: str, values: dict[str, float]) -> None:
    # Any: as above
    """Write one value for each joint; `values` must name them all: there is no mask."""
    from ovphysx.types import SimObjectType

    if not values:
        return
    with sim.write_sync(SimObjectType.ARTICULATION_JOINT, attribute) as writing:
        for group in writing.groups:
            # Each group has its own order, so the names are asked of this very group.
            names = paths.get_path_strings(group.prim_list)
            for name, tensor in zip(names, group.tensors, strict=True):
                tensor.numpy()[...] = values[str(name)]
            writing.commit_sync(group)
