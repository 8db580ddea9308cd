"""`assetbuild watch`: build, and again whenever a file changes that the build reads."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.cli.build import add_plain_arguments
from assetbuild.engine.null import lines_of, renewed
from assetbuild.engine.questions import STAMP, answer
from assetbuild.errors import AssetBuildError

if TYPE_CHECKING:
    from assetbuild.engine.world import World
    from assetbuild.pipeline.building import Request

HELP = "build, and again whenever the recipe or a source changes; Ctrl-C ends it"

PAUSE_S = 0.25
"""Between two looks at the files. Looking works on every file system; notices do not."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_plain_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Until Ctrl-C: then 0 if it waits, 130 if it builds."""
    from assetbuild.cli import Terminated
    from assetbuild.cli.build import requests_of
    from assetbuild.engine.world import World, files_in

    requests = requests_of(arguments)
    while True:
        world, began_ns = World(), time.time_ns()
        _build(requests, world)
        lines, changed = lines_of(world.record, began_ns)
        if changed:
            continue  # while it was built
        try:
            count = len(files_in(world.record))
            print(f"watching {count} files; Ctrl-C ends it", file=sys.stderr, flush=True)
            _wait(lines)
        except Terminated:
            raise
        except KeyboardInterrupt:
            print("stopped watching", file=sys.stderr)
            return 0


def _build(requests: list[Request], world: World) -> None:
    """Build and print. world: its record tells what was asked, also when it fails."""
    from assetbuild.cli import print_error
    from assetbuild.cli.build import build_and_print

    try:
        build_and_print(requests, world)
    except AssetBuildError as error:
        print_error(error)


def _wait(lines: list[str]) -> None:
    """Until an answer changes, and then until all is quiet: editors save several files in a row."""
    changed: list[str] = []
    while not changed:
        time.sleep(PAUSE_S)
        lines, changed = renewed(lines)
    names = ", ".join(f"`{Path(subject).name}`" for subject in changed[:3])
    print(f"changed: {names}{', ...' if len(changed) > 3 else ''}", file=sys.stderr, flush=True)
    before, now = [""], _stamps(changed)
    while before != now:
        time.sleep(PAUSE_S)
        before, now = now, _stamps(renewed(lines)[1])


def _stamps(subjects: list[str]) -> list[str]:
    return [answer((STAMP, subject, "")) for subject in subjects]
