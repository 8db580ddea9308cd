"""`assetbuild watch`: build, and again whenever a file changes that the build reads."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from assetbuild.cli import Terminated, print_error
from assetbuild.cli.build import build_and_print, requests_of
from assetbuild.engine import children
from assetbuild.engine.noop_build import lines_of, renewed
from assetbuild.engine.questions import STAMP, answer
from assetbuild.engine.world import World, files_in
from assetbuild.errors import AssetBuildError

PAUSE_S = 0.1
"""Between two looks at the files. Looking works on every file system; notices do not."""


def run(arguments: argparse.Namespace) -> int:
    """Watch until Ctrl-C: then 0 if it waits, 130 if it builds."""
    requests = requests_of(arguments)
    while True:
        children.begin(keep=True)
        world, began_ns = World(), time.time_ns()
        try:
            build_and_print(requests, world)
        except AssetBuildError as error:
            print_error(error)
        lines, changed = lines_of(world.record, began_ns)
        if changed:
            continue  # while it was built
        try:
            count = len(files_in(world.record))
            files = "1 file" if count == 1 else f"{count} files"
            print(f"watching {files}; Ctrl-C ends it", file=sys.stderr, flush=True)
            _wait(lines)
        except Terminated:
            raise
        except KeyboardInterrupt:
            print("stopped watching", file=sys.stderr)
            return 0


def _wait(lines: list[str]) -> None:
    """Wait for a changed answer, then until all is quiet: editors save several files in a row."""
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
