"""`assetbuild identify`: actuator numbers from logs of the real robot."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from assetbuild.cli.progress import progress
from assetbuild.cli.summary import print_findings
from assetbuild.engine.store import OUT_OPTION, machine_errors
from assetbuild.errors import UsageError
from assetbuild.identify.for_recipe import read_bam
from assetbuild.pipeline.identifying import excite, identify
from assetbuild.pipeline.opening import Task
from assetbuild.pipeline.writing import write_rows
from assetbuild.recipe.loader import read_small_file
from assetbuild.robot.identify import Fit


def run(arguments: argparse.Namespace) -> int:
    """Print the table; with `--write` also change the recipe."""
    if arguments.bam is not None:
        return _bam(arguments)
    if arguments.recipe is None:
        raise UsageError("which recipe?", hint="`assetbuild identify recipes/go1.yaml`")
    task = Task.of(vars(arguments))
    if arguments.excite:
        return _excite(arguments, task)
    with progress(arguments.recipe.name) as shown:
        found = identify(task, shown.on_event, shown.say)
    print_findings(found.findings)
    if arguments.json:
        print(json.dumps([asdict(fit) for fit in found.fits], indent=1))
    elif arguments.ranges:
        print(found.ranges)
    else:
        for fit in found.fits:
            _print(fit)
    if arguments.write:
        print(f"{write_rows(found)} rows written to {arguments.recipe}", file=sys.stderr)
    return 0


def _excite(arguments: argparse.Namespace, task: Task) -> int:
    """Write the commands and the script that plays them; print what they will show."""
    with progress(arguments.recipe.name) as shown:
        found = excite(task, float(arguments.seconds), shown.on_event, shown.say)
    print_findings(found.findings)
    out = arguments.out or Path("build/excite")
    with machine_errors(out, OUT_OPTION):
        out.mkdir(parents=True, exist_ok=True)
        (out / "excite.csv").write_bytes(found.commands)
        (out / "play.py").write_text(PLAY, encoding="utf-8")
    if arguments.json:
        print(json.dumps(found.expected, indent=1))
        return 0
    wide = max(len(row["joint"]) for row in found.expected)
    print(f"{'joint':{wide}} {'parameter':9} {'prior':>9} {'+- of a log':>12} {'shown from':>11}")
    for row in found.expected:
        note = "only together with another" if row["confounded"] else ""
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


def _bam(arguments: argparse.Namespace) -> int:
    """Print a motor for the recipe; what it cannot hold goes to stderr."""
    file = str(arguments.bam)
    if arguments.volts is not None and not 0.0 < arguments.volts < 1e4:
        raise UsageError("`--volts` must be above 0")
    text = read_small_file(arguments.bam, file, UsageError).decode("utf-8", "replace")
    found = read_bam(text, arguments.bam.name, arguments.volts)
    keys = ", ".join(f"{key}: {json.dumps(value)}" for key, value in found.motor.items())
    print(f"motors:\n  {found.name}: {{{keys}}}")
    if found.kd is not None:
        print(f"# back-EMF: add {found.kd:g} N m s/rad to the kd of a row with this motor")
    for name, value in found.lost:
        print(
            f"warning identify.bam: {file}: `{name}` = {value:.4g} is left out: joints have dry "
            "and viscous friction only",
            file=sys.stderr,
        )
    return 0


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
