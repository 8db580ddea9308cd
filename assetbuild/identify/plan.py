"""The steps of `identify`: each log read, each entry fitted, the actuators with what came out.

log, tree -> record
tree, control -> prior -> fit
control, fits -> control
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner
from assetbuild.errors import did_you_mean, meant_pattern
from assetbuild.identify.excite import Excite
from assetbuild.identify.fit_logs import FitLogs
from assetbuild.identify.priors import POSITION, KeepPrior, UseFits
from assetbuild.identify.read_log import ReadLog
from assetbuild.identify.table import FORMATS, info_beside
from assetbuild.plugin_types import Target
from assetbuild.plugins import load_plugin
from assetbuild.recipe.models import Recipe
from assetbuild.recipe.validation import KeyedError
from assetbuild.robot.identify import Identify
from assetbuild.robot.model import Tree
from assetbuild.robot.ranges import by_joint


def identify(
    entries: Sequence[Identify], folder: Path, tree: Tree, merged: Ref, control: Ref, p: Planner
) -> tuple[Ref, tuple[Node, ...]]:
    """The actuators with the fitted numbers, and the fit of each entry. folder: of the recipe.

    KeyedError for patterns and files that are not there.
    """
    fits: list[Node] = []
    used: dict[str, Ref] = {}
    taken: dict[str, int] = {}
    for number, entry in enumerate(entries):
        joints = _joints(number, entry, tree)
        for joint in joints:
            if joint in taken:
                raise KeyedError(
                    ("identify", number, "joints"),
                    f"joint `{joint}` is in entry {taken[joint]} too",
                    "give the logs of one joint to one entry, or narrow a pattern",
                )
            taken[joint] = number
        fit = _fit(folder, number, entry, joints, merged, control, p)
        fits.append(fit)
        if entry.apply:
            used[f"fits/{len(used)}.json"] = fit["fit.json"]
    if used:
        step = UseFits(fits=len(used))
        control = p.add("use_fits", step, {"control.json": control, **used})["control.json"]
    return control, tuple(fits)


def excite(
    recipe: Recipe, tree: Tree, robot: Mapping[str, Ref], seconds: float, p: Planner
) -> Node:
    """What to record for the first entry of `identify`, or for all drives of a recipe without."""
    entry = next(iter(recipe.identify), None)
    if entry is None:
        entry = Identify.model_construct(logs=())
        driven = [row.joints for row in recipe.actuators if row.model in POSITION]
        names = [j.name for j in tree.moving_joints if any(re.fullmatch(d, j.name) for d in driven)]
        if not names:
            raise KeyedError(
                ("actuators",),
                "no row is a position controller: nothing says what could be commanded",
                "add `identify` with `joints` and `recorded`",
            )
        joints = tuple(names)
    else:
        joints = _joints(0, entry, tree)
    ports = {port: robot[port] for port in ("tree.json", "control.json")}
    prior = p.add("keep_prior", KeepPrior(joints=joints, recorded=entry.recorded), ports)
    target = load_plugin(Target, "mjcf")
    model = p.add("mjcf", target.configure(recipe), {port: robot[port] for port in target.reads})
    step = Excite(
        joints=joints,
        fit=tuple((joint, tuple(by_joint(entry.fit, joint) or ())) for joint in joints),
        gravity=entry.gravity,
        max_relative_interval=entry.max_relative_interval,
        seconds=seconds,
        # A floating robot hangs in a stand; a fixed one stands on its table.
        file="scene.xml" if tree.base == "fixed" else f"{recipe.robot}.xml",
    )
    inputs = ports | {"prior.json": prior["prior.json"], "mjcf/": model["mjcf/"]}
    return p.add("excite", step, inputs)


def _joints(number: int, entry: Identify, tree: Tree) -> tuple[str, ...]:
    free = [joint.name for joint in tree.moving_joints if joint.mimic is None]
    joints = tuple(name for name in free if re.fullmatch(entry.joints, name))
    key = ("identify", number)
    if not joints:
        hint = meant_pattern(entry.joints, free)
        raise KeyedError((*key, "joints"), f"`{entry.joints}` matches no moving joint", hint)
    for name in entry.names:
        if name not in joints:
            message = f"`{name}` is no joint that `{entry.joints}` matches"
            raise KeyedError((*key, "names", name), message, did_you_mean(name, joints))
    patterns = [("shared", pattern) for pattern in entry.shared]
    patterns += [("fit", pattern) for pattern in entry.fit] if isinstance(entry.fit, dict) else []
    for what, pattern in patterns:
        if not any(re.fullmatch(pattern, name) for name in joints):
            message = f"pattern `{pattern}` matches none of the entry's joints"
            raise KeyedError((*key, what), message, meant_pattern(pattern, joints))
    return joints


def _fit(
    folder: Path,
    number: int,
    entry: Identify,
    joints: tuple[str, ...],
    merged: Ref,
    control: Ref,
    p: Planner,
) -> Node:
    inputs, digests = {"tree.json": merged}, []
    for index, log in enumerate(entry.logs):
        key = ("identify", number, "logs", index, "file")
        path = folder / log.file
        if not log.file.endswith(FORMATS):
            raise KeyedError(key, f"`{log.file}`: a log is one of {', '.join(FORMATS)}")
        if not p.world.is_file(path):
            raise KeyedError(
                key, f"`{log.file}`: there is no such file", "paths begin at the recipe"
            )
        digests.append(p.world.digest(path))
        constants = [by_joint(entry.torque_constant, joint) for joint in joints]
        step = ReadLog(
            file=log.file,
            joints=joints,
            names=dict(entry.names),
            columns=entry.columns,
            interval=log.interval,
            episode=log.episode,
            time_unit=entry.time_unit,
            angle_unit=entry.angle_unit,
            torque_constants=None
            if None in constants
            else tuple(float(c or 0.0) for c in constants),
        )
        ports = {"tree.json": merged, **_files(path, p)}
        record = p.add(f"read_log {number}.{index}", step, ports)
        inputs[f"records/{index}.npz"] = record["record.npz"]
        inputs[f"about/{index}.json"] = record["about.json"]
    prior = p.add(
        f"keep_prior {number}",
        KeepPrior(joints=joints, recorded=entry.recorded),
        {"control.json": control, "tree.json": merged},
    )
    wanted = ((joint, by_joint(entry.fit, joint) or ()) for joint in joints)
    fit = FitLogs(
        joints=joints,
        logs=tuple(log.file for log in entry.logs),
        digests=tuple(digests),
        fit=tuple((joint, tuple(names)) for joint, names in wanted),
        shared=entry.shared,
        hold_out=entry.hold_out,
        gravity=entry.gravity,
        max_relative_interval=entry.max_relative_interval,
        effective=entry.values == "effective",
        simulator_step=entry.simulator_step,
        moving=entry.base == "measured",
    )
    return p.add(f"fit_logs {number}", fit, {**inputs, "prior.json": prior["prior.json"]})


def _files(log: Path, p: Planner) -> dict[str, Ref]:
    """The log, and what describes the data set that it belongs to."""
    files, info = {"log": p.source(log)}, info_beside(log)
    if info is not None and p.world.is_file(info):
        files["info.json"] = p.source(info)
    return files
