"""`assetbuild sample`: robots that could exist."""

from __future__ import annotations

import argparse

from assetbuild.cli.progress import progress
from assetbuild.cli.summary import print_findings
from assetbuild.pipeline.opening import Task
from assetbuild.pipeline.sampling import Draws, Sampled, sample


def run(arguments: argparse.Namespace) -> int:
    """Write the samples; prints the table of the draws."""
    wanted = Draws(arguments.count, arguments.judge, arguments.seed)
    with progress(arguments.recipe.name) as shown:
        sampled = sample(Task.of(vars(arguments)), wanted, shown.on_event, shown.say)
    print_findings(sampled.findings)
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
