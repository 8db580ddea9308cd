"""`assetbuild identify`: actuator numbers from logs of the real robot."""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import yaml

from assetbuild.cli.progress import at_work
from assetbuild.cli.summary import print_findings
from assetbuild.engine.planner import Planner
from assetbuild.engine.store import OUT_OPTION, machine_errors
from assetbuild.errors import RecipeError, UsageError
from assetbuild.identify.for_recipe import as_ranges
from assetbuild.identify.plan import excite as add_excite
from assetbuild.pipeline.opening import Opened
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.validation import follow
from assetbuild.recipe.yaml_tree import plain
from assetbuild.report.html import fit_tables
from assetbuild.report.tables import table, text_table
from assetbuild.robot.codec import decode
from assetbuild.robot.identify import Fit
from assetbuild.robot.model import Actuator, Control


def run(arguments: argparse.Namespace) -> int:
    """Print the table; with `--write` also change the recipe."""
    loaded = load_recipe(arguments.recipe, arguments.variant)
    if arguments.excite:
        return _excite(arguments, loaded)
    if not loaded.recipe.identify:
        raise RecipeError(
            "the recipe has no `identify`: nothing says where the logs are",
            where=loaded.where(()),
            hint="add for instance `identify: [{logs: [{file: log.csv}], recorded: {kp: 20}}]`",
        )
    with at_work(loaded, arguments) as (work, _):
        done = work.made(work.robot)
        fits = [decode(Fit, work.read(done, node["fit.json"])) for node in done.outline.fits]
        control = decode(Control, work.read(done, done.outline.robot["control.json"]))
    of_fits = [label for label in done.results if label.startswith(("read_log", "fit_logs"))]
    print_findings([finding for label in of_fits for finding in done.results[label].findings])
    if arguments.json:
        print(json.dumps([asdict(fit) for fit in fits], indent=1))
    elif arguments.ranges:
        print(as_ranges(fits, loaded.recipe.simulation.timestep))
    else:
        for shown in (each for fit in fits for each in fit_tables(fit)):
            print(text_table(shown))
    if arguments.write:
        count = write_rows(loaded, control.actuators)
        print(f"{count} rows written to {arguments.recipe}", file=sys.stderr)
    return 0


def _excite(arguments: argparse.Namespace, loaded: LoadedRecipe) -> int:
    """Write the commands and the script that plays them; print what they will show."""
    with at_work(loaded, arguments) as (work, _):
        seconds = float(arguments.seconds)
        result = work.made(lambda p: plan_excite(work, seconds, p)).results["excite"]
        commands, text = (work.session.read(result[n]) for n in ("excite.csv", "expected.json"))
    print_findings(result.findings)
    out = arguments.out or Path("build/excite")
    with machine_errors(out, OUT_OPTION):
        out.mkdir(parents=True, exist_ok=True)
        (out / "excite.csv").write_bytes(commands)
        (out / "play.py").write_text(PLAY, encoding="utf-8")
    expected = json.loads(text)
    if arguments.json:
        print(json.dumps(expected, indent=1))
        return 0
    keys = ("joint", "parameter", "prior", "half_width", "shown_from")
    rows = [(*(row[key] for key in keys), _remark(row)) for row in expected]
    head = ("joint", "parameter", "prior", "95 % +-", "shown from", "remark")
    print(text_table(table("", head, rows)))
    print(f"commands and a script that plays them: {out}")
    return 0


def _remark(row: Mapping[str, Any]) -> str:  # Any: JSON
    if row["confounded"]:
        return "only together with another"
    is_small = 0.0 < row["prior"] < row["shown_from"]
    return "smaller than what shows: record with lower kp and kd" if is_small else ""


PLAY = '''"""Plays excite.csv on a robot and writes log.csv for `assetbuild identify`.

Fill in `send` and `read`. Hold the base still, keep people away, begin with low gains.
"""

import csv
import time


def send(targets):
    """Command the joints. targets: {joint: rad or m}."""
    raise NotImplementedError("send the targets to your robot")


def read():
    """The measured positions now, {joint: rad or m}."""
    raise NotImplementedError("read the joints of your robot")


with open("excite.csv") as file:
    rows = [{name: float(text) for name, text in row.items()} for row in csv.DictReader(file)]
joints = [name.removeprefix("target_") for name in rows[0] if name != "time"]
here, first, log = read(), rows[0], []
for step in range(300):  # go to the first pose in three seconds
    send({j: here[j] + (first[f"target_{j}"] - here[j]) * step / 300 for j in joints})
    time.sleep(0.01)
time.sleep(2.0)
begin = time.perf_counter()
for row in rows:
    time.sleep(max(0.0, begin + row["time"] - time.perf_counter()))  # threads of a driver run on
    now, position = time.perf_counter() - begin, read()
    send({j: row[f"target_{j}"] for j in joints})
    log.append([now, *(position[j] for j in joints), *(row[f"target_{j}"] for j in joints)])
head = ["time", *(f"position_{j}" for j in joints), *(f"target_{j}" for j in joints)]
with open("log.csv", "w", newline="") as file:  # all at the end: a disk makes the loop late
    csv.writer(file).writerows([head, *log])
'''


def plan_excite(work: Opened, seconds: float, p: Planner) -> None:
    """Add the node `excite` and what it needs."""
    outline = replace(work, loaded=work.loaded.but(identify=())).robot(p)
    if outline.tree is not None and outline.robot:
        with work.loaded.placing():
            add_excite(work.loaded.recipe, outline.tree, outline.robot, seconds, p)


# --- measured numbers written into the rows of the recipe -----------------------------------

INSTEAD = {"kp": "frequency", "kd": "damping_ratio"}
"""A measured number takes the place of what it was computed from."""


def write_rows(loaded: LoadedRecipe, actuators: Sequence[Actuator]) -> int:
    """Rewrite the rows whose joints have measured numbers; how many rows now state them.

    Only these rows change; comments and all other text stay as they are.

    RecipeError for a recipe without rows. The file is replaced at once, and only if it is valid.
    """
    if loaded.variant is not None:
        raise UsageError("`--write` changes the recipe itself: omit `--variant`")
    measured = {row.joint: row for row in actuators if row.measured}
    text = loaded.path.read_bytes().decode("utf-8-sig")
    spans = _spans(text)
    if not spans:
        raise RecipeError(
            "the recipe has no rows in `actuators` that could state the numbers",
            where=loaded.where(("actuators",)),
            hint="build with `identify` alone, or write the rows first",
        )
    joints = [row.joint for row in actuators]
    count = 0
    rows = list(zip(loaded.recipe.actuators, spans, strict=True))
    for index, (row, (first, last, indent)) in reversed([*enumerate(rows)]):
        row_joints = [name for name in joints if re.fullmatch(row.joints, name)]
        if not any(name in measured for name in row_joints):
            continue
        stated = plain(follow(loaded.tree, ("actuators", index))[1])
        written = list(_rows(stated, row_joints, measured))
        count += sum("measured" in each for each in written)
        text = text[:first] + f"\n{indent}- ".join(_flow(e, indent) for e in written) + text[last:]
    half = loaded.path.with_name(f".{loaded.path.name}.new")
    half.write_text(text, encoding="utf-8", newline="")
    try:
        load_recipe(half)
        os.replace(half, loaded.path)  # noqa: PTH105 # says what it does
    finally:
        half.unlink(missing_ok=True)
    return count


def _spans(text: str) -> list[tuple[int, int, str]]:
    """(first, last, indent) of each item of `actuators`; comments below the last are not its."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    for key, value in root.value if root is not None else ():
        if key.value == "actuators" and isinstance(value, yaml.SequenceNode):
            spans = []
            for item in value.value:
                first, last = item.start_mark.index, item.end_mark.index
                last = first + len(_without_tail(text[first:last]))
                line = text.rfind("\n", 0, first) + 1
                before = text[line:first]
                spans.append((first, last, before[: len(before) - len(before.lstrip())]))
            return spans
    return []


def _without_tail(text: str) -> str:
    """Cut comments and empty lines off its end."""
    lines = text.rstrip().split("\n")
    while len(lines) > 1 and lines[-1].lstrip().startswith("#"):
        lines.pop()
    return "\n".join(lines).rstrip()


def _rows(
    stated: Any, joints: Sequence[str], measured: Mapping[str, Actuator]
) -> Iterator[dict[str, Any]]:  # Any: YAML
    """The rows in place of one: joints with equal numbers share a row, as do those with none."""
    groups: dict[str, tuple[dict[str, Any], list[str]]] = {}  # Any: YAML
    for joint in joints:
        keys = {k: v for k, v in stated.items() if k not in ("joints", "measured", "source")}
        if joint in measured:
            keys |= _numbers(measured[joint], keys)
        elif "source" in stated:
            keys["source"] = stated["source"]
        groups.setdefault(json.dumps(keys), (keys, []))[1].append(joint)
    for keys, names in groups.values():
        yield {"joints": "|".join(map(re.escape, names)), **keys}


def _numbers(actuator: Actuator, keys: dict[str, Any]) -> dict[str, Any]:  # Any: YAML
    for name in actuator.measured:
        keys.pop(INSTEAD.get(name, ""), None)
    numbers = {name: float(f"{getattr(actuator, name):.6g}") for name in actuator.measured}
    return {**numbers, "measured": list(actuator.measured), "source": actuator.source}


def _flow(row: Mapping[str, Any], indent: str) -> str:  # Any: YAML
    """`{joints: .., ..}`, on several lines where it is long."""
    text = yaml.safe_dump(row, default_flow_style=True, sort_keys=False, allow_unicode=True)
    return str(text).strip().replace("\n", f"\n{indent}")
