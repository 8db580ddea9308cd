"""`assetbuild bench`: collision quality against simulation speed."""

from __future__ import annotations

import argparse

from assetbuild.cli.progress import progress
from assetbuild.errors import UsageError, did_you_mean
from assetbuild.pipeline.bench import LEVELS, Level, bench
from assetbuild.pipeline.opening import Task


def run(arguments: argparse.Namespace) -> int:
    """Print the table; a CSV lies in the folder."""
    known = ("recipe", *LEVELS)
    levels = known
    if arguments.levels:
        levels = tuple(name.strip() for name in arguments.levels.split(","))
        for name in levels:
            if name not in known:
                raise UsageError(f"no level `{name}`", hint=did_you_mean(name, known))
    with progress(arguments.recipe.name) as shown:
        found = bench(Task.of(vars(arguments)), levels, arguments.source, shown.on_event, shown.say)
    print(HEAD)
    for level in found.levels:
        print(_row(level, is_best=level.name in found.best))
    print(f"* = no other level is better in both; {found.out / 'bench.csv'}")
    return 0


HEAD = (
    "  level        steps/s  contacts  geoms   home: touching  deepest  slope, mm/s    holds"
    "   mean IoU  outside  build"
)


def _row(level: Level, *, is_best: bool) -> str:
    mark = "*" if is_best else " "
    if level.speed is None:
        return f"{mark} {level.name:11} {level.error}"
    speed = level.speed
    iou = f"{level.iou:8.3f}" if level.iou is not None else "       -"
    outside = f"{level.outside_mm:5.1f} mm" if level.outside_mm is not None else "       -"
    slides = speed["creep_mm_s"]
    creep = "-" if slides is None else f"{slides:.2g}"
    fell = f"   {level.fell} by another method" if level.fell else ""
    return (
        f"{mark} {level.name:11} {speed['steps_per_s']:8,.0f}  {speed['contacts']:8.1f}"
        f"  {speed['geoms']:5}   {speed['self_contacts']:14}  {speed['deepest_mm']:4.1f} mm"
        f"  {creep:>11}   {speed['held'] or '-':>6}   {iou}  {outside} {level.build_s:6.1f} s{fell}"
    )
