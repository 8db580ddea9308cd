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
from assetbuild.robot.actuator_table import ActuatorRow
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
        for fit in fits:
            _print(fit)
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
    wide = max(len(row["joint"]) for row in expected)
    print(f"{'joint':{wide}} {'parameter':9} {'prior':>9} {'95 % +-':>12} {'shown from':>11}")
    for row in expected:
        note = "only together with another" if row["confounded"] else ""
        if 0.0 < row["prior"] < row["shown_from"]:
            note = note or "smaller than what shows: record with lower kp and kd"
        print(
            f"{row['joint']:{wide}} {row['parameter']:9} {row['prior']:9.4g} "
            f"{row['half_width']:12.3g} {row['shown_from']:11.3g}  {note}"
        )
    print(f"commands and a script that plays them: {out}")
    return 0


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


def _print(fit: Fit) -> None:
    for log in fit.logs:
        print(
            f"{log.file}: {log.seconds:.4g} s fitted, {log.held_s:.4g} s held out, "
            f"{log.rate_hz:.4g} Hz, sha256 {log.sha256[:12]}"
        )
    wide = max((len(p.label) for p in fit.parameters), default=0)
    print(f"{'parameter':{wide}} {'value':>10} {'95 % interval':>23} {'prior':>9}")
    for each in fit.parameters:
        prior = "-" if each.prior is None else f"{each.prior:.4g}"
        interval = f"{each.low:.4g} .. {each.high:.4g}"
        value = "refused" if each.refused else f"{each.value:.4g}"
        end = each.refused or each.unit
        print(f"{each.label:{wide}} {value:>10} {interval:>23} {prior:>9}  {end}")
    wide = max((len(p.joint) for p in fit.predictions), default=0)
    print(f"{'RMS of the position':{max(wide, 19)}}   fitted  held out: priors   identified")
    for one in fit.predictions:
        print(f"{one.joint:{max(wide, 19)}} {one.fitted:8.2e} {one.before:17.2e} {one.after:12.2e}")


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
    for row, (first, last, indent) in reversed(rows):
        row_joints = [name for name in joints if re.fullmatch(row.joints, name)]
        if not any(name in measured for name in row_joints):
            continue
        written = list(_rows(row, row_joints, measured))
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
    row: ActuatorRow, joints: Sequence[str], measured: Mapping[str, Actuator]
) -> Iterator[dict[str, Any]]:  # Any: YAML
    """The rows in place of one: joints with equal numbers share a row, as do those with none."""
    stated = row.model_dump(exclude_unset=True)
    groups: dict[str, tuple[dict[str, Any], list[str]]] = {}  # Any: YAML
    for joint in joints:
        keys = {k: v for k, v in stated.items() if k not in ("joints", "measured", "source")}
        if joint in measured:
            keys |= _numbers(measured[joint], keys)
        elif row.source:
            keys["source"] = row.source
        groups.setdefault(json.dumps(keys), (keys, []))[1].append(joint)
    for keys, names in groups.values():
        yield {"joints": "|".join(map(re.escape, names)), **keys}


def _numbers(actuator: Actuator, keys: dict[str, Any]) -> dict[str, Any]:  # Any: YAML
    for name in actuator.measured:
        keys.pop(INSTEAD.get(name, ""), None)
    numbers = {name: float(f"{getattr(actuator, name):.6g}") for name in actuator.measured}
    return {**numbers, "measured": list(actuator.measured), "source": actuator.source}


def _flow(row: Mapping[str, Any], indent: str) -> str:  # Any: YAML
    """`{joints: .., ..}`; what was measured on lines of its own."""
    head = [f"{k}: {_text(v)}" for k, v in row.items() if k not in row.get("measured", ())]
    if "measured" not in row:
        return "{" + ", ".join(head) + "}"
    numbers = ", ".join(f"{name}: {row[name]!r}" for name in row["measured"])
    entries = [part for part in head if not part.startswith(("measured:", "source:"))]
    names = ", ".join(row["measured"])
    return (
        "{" + ", ".join(entries) + f",\n{indent}   {numbers},\n{indent}   measured: [{names}],\n"
        f"{indent}   source: {json.dumps(row['source'])}}}"
    )


def _text(value: Any) -> str:  # Any: YAML
    """A plain word or number as people write it, all else as JSON."""
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e9:
        return str(int(value))
    if isinstance(value, str) and re.fullmatch(r"[a-z]\w*_\w+|pd|ideal_pd", value, re.ASCII):
        return value
    return json.dumps(value)
