"""`assetbuild bench`: collision quality against simulation speed."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.cli.cache import add_sharing
from assetbuild.cli.parser import whole_number
from assetbuild.cli.recipes import file_or_robot

if TYPE_CHECKING:
    from assetbuild.pipeline.bench import Level

HELP = "simulate the robot with collision geometry of every kind: quality against speed"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("recipe", type=file_or_robot, metavar="RECIPE")
    parser.add_argument("-o", "--out", type=Path, metavar="DIR", help="build/<robot>-bench")
    parser.add_argument("--levels", metavar="A,B", help="some of the levels; default: all")
    parser.add_argument(
        "--from",
        dest="source",
        choices=("auto", "collision", "visual"),
        default="auto",
        help="the meshes to work on; default: collision, else visual",
    )
    parser.add_argument(
        "-j", "--jobs", type=whole_number(1), metavar="N", help="default: all cores"
    )
    parser.add_argument("--variant", metavar="NAME", help="a variant of the recipe")
    add_sharing(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the table; a CSV lies in the folder."""
    from assetbuild.cli.progress import progress
    from assetbuild.errors import UsageError, did_you_mean
    from assetbuild.pipeline.bench import BenchRequest, bench
    from assetbuild.pipeline.bench_plan import LEVELS

    known = ("recipe", *LEVELS)
    levels = known
    if arguments.levels:
        levels = tuple(name.strip() for name in arguments.levels.split(","))
        for name in levels:
            if name not in known:
                raise UsageError(f"no level `{name}`", hint=did_you_mean(name, known))
    request = BenchRequest(
        recipe=arguments.recipe,
        out=arguments.out,
        variant=arguments.variant,
        levels=levels,
        source=arguments.source,
        jobs=arguments.jobs,
        remote=arguments.remote,
        cache_write=arguments.cache_write,
    )
    with progress(arguments.recipe.name) as shown:
        found = bench(request, shown.on_event, shown.say)
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
