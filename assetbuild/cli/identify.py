"""`assetbuild identify`: actuator numbers from logs of the real robot."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.cli.cache import add_sharing
from assetbuild.cli.parser import whole_number

if TYPE_CHECKING:
    from assetbuild.pipeline.identifying import Identified
    from assetbuild.robot.identified import Fit

HELP = "fit actuator numbers to logs of the real robot"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("recipe", type=Path, metavar="RECIPE")
    parser.add_argument(
        "--write", action="store_true", help="write what is identified into the recipe's rows"
    )
    parser.add_argument("--json", action="store_true", help="print all of it as JSON")
    parser.add_argument(
        "-j", "--jobs", type=whole_number(1), metavar="N", help="default: all cores"
    )
    parser.add_argument("--variant", metavar="NAME", help="a variant of the recipe")
    add_sharing(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the table; with `--write` also change the recipe."""
    from assetbuild.cli.progress import progress
    from assetbuild.cli.summary import every_finding_line
    from assetbuild.pipeline.identifying import IdentifyRequest, identify

    request = IdentifyRequest(
        recipe=arguments.recipe,
        variant=arguments.variant,
        jobs=arguments.jobs,
        remote=arguments.remote,
        cache_write=arguments.cache_write,
    )
    with progress(arguments.recipe.name) as shown:
        found = identify(request, shown.on_event, shown.say)
    if found.errors:
        raise found.errors[0]
    for line in every_finding_line(found.findings):
        print(line, file=sys.stderr)
    if arguments.json:
        print(json.dumps(_plain(found), indent=1))
    else:
        for fit in found.fits:
            _print(fit)
    if arguments.write:
        from assetbuild.pipeline.writing import write_rows

        print(f"{write_rows(found)} rows written to {arguments.recipe}", file=sys.stderr)
    return 0


def _plain(found: Identified) -> object:
    from dataclasses import asdict

    return [asdict(fit) for fit in found.fits]


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
