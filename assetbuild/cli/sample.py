"""`assetbuild sample`: robots that could exist."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.cli.cache import add_sharing
from assetbuild.cli.parser import whole_number
from assetbuild.cli.recipes import file_or_robot

if TYPE_CHECKING:
    from assetbuild.pipeline.sampling import Sampled

HELP = "draw robots from the recipe's `randomize` ranges and write them as MJCF"
MOST = 1000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("recipe", type=file_or_robot, metavar="RECIPE")
    parser.add_argument(
        "-n", "--count", type=whole_number(1, MOST), default=16, metavar="N", help="default: 16"
    )
    parser.add_argument(
        "--judge",
        type=whole_number(1, 1_000_000),
        default=10_000,
        metavar="N",
        help="draws judged; default: 10000",
    )
    parser.add_argument("--seed", type=whole_number(0), metavar="N", help="default: the recipe's")
    parser.add_argument("-o", "--out", type=Path, metavar="DIR", help="build/<robot>-samples")
    parser.add_argument(
        "-j", "--jobs", type=whole_number(1), metavar="N", help="default: all cores"
    )
    parser.add_argument("--variant", metavar="NAME", help="a variant of the recipe")
    add_sharing(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the samples; prints the table of the draws."""
    from assetbuild.cli.progress import progress
    from assetbuild.cli.summary import every_finding_line
    from assetbuild.pipeline.sampling import SampleRequest, sample

    request = SampleRequest(
        recipe=arguments.recipe,
        out=arguments.out,
        variant=arguments.variant,
        keep=arguments.count,
        judge=arguments.judge,
        seed=arguments.seed,
        jobs=arguments.jobs,
        remote=arguments.remote,
        cache_write=arguments.cache_write,
    )
    with progress(arguments.recipe.name) as shown:
        sampled = sample(request, shown.on_event, shown.say)
    if sampled.errors:
        raise sampled.errors[0]
    for line in every_finding_line(sampled.findings):
        print(line, file=sys.stderr)
    _print_table(sampled)
    print(f"{arguments.count} robots in {sampled.out}")
    return 0


def _print_table(sampled: Sampled) -> None:
    rows = sampled.statistics["bodies"]
    if not rows:
        return
    noises = sorted(rows[0]["independent_noise_inconsistent"])
    wide = max(len(name) for name in ("body", *(row["body"] for row in rows)))
    head = [f"±{float(noise):.0%}" for noise in noises]
    print(f"{sampled.statistics['draws']:,} draws; right: inconsistent with independent noise of")
    print(
        f"{'body':{wide}} {'mass, kg':>19} {'kept':>6} {'bad':>4} "
        + " ".join(map("{:>6}".format, head))
    )
    for row in rows:
        mass, shares = row["mass_kg"], row["independent_noise_inconsistent"]
        spread = f"{mass['least']:.4g}..{mass['most']:.4g}"
        noisy = " ".join(f"{shares[noise]:6.1%}" for noise in noises)
        print(
            f"{row['body']:{wide}} {spread:>19} {row['acceptance']:6.1%} "
            f"{row['inconsistent']:4d} {noisy}"
        )
