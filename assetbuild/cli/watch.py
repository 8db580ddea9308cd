"""`assetbuild watch`: build, and again whenever a file changes that the build reads."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.cli.build import add_plain_arguments
from assetbuild.engine.digest import digest_file
from assetbuild.errors import AssetBuildError

if TYPE_CHECKING:
    from assetbuild.pipeline.building import Request

HELP = "build, and again whenever the recipe or a source changes; Ctrl-C ends it"

PAUSE_S = 0.25
"""Between two looks at the files. Looking works on every file system; notices do not."""

Stamps = dict[Path, tuple[int, ...]]
"""What `stat` says of each file; an absent one is ()."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_plain_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Until Ctrl-C: then 0 if it waits, 130 if it builds."""
    from assetbuild.cli import Terminated
    from assetbuild.cli.build import requests_of

    requests = requests_of(arguments)
    files = {request.recipe for request in requests}
    while True:
        seen = stamps(files)
        read = _build(requests)
        if read is not None:
            files = set(read)
            seen = stamps(files)
            if any(_is_edited(path, digest) for path, digest in read.items()):
                continue  # while it was built
        try:
            print(f"watching {len(files)} files; Ctrl-C ends it", file=sys.stderr, flush=True)
            _wait(files, seen)
        except Terminated:
            raise
        except KeyboardInterrupt:
            print("stopped watching", file=sys.stderr)
            return 0


def _build(requests: list[Request]) -> dict[Path, str] | None:
    """Build and print: SHA-256 of each file that was read.

    None when the input is wrong: then it is not known what it would read.
    """
    from assetbuild.cli import print_error
    from assetbuild.cli.build import build_and_print

    try:
        outcomes = build_and_print(requests)
    except AssetBuildError as error:
        print_error(error)
        return None
    return {Path(path): digest for each in outcomes for path, digest in each.read.items()}


def stamps(files: Iterable[Path]) -> Stamps:
    """What tells an edited file from an unedited one, without reading it."""
    found: Stamps = {}
    for path in files:
        try:
            stat = path.stat()
            found[path] = (stat.st_mtime_ns, stat.st_ctime_ns, stat.st_size, stat.st_ino)
        except OSError:
            found[path] = ()
    return found


def _is_edited(path: Path, digest: str) -> bool:
    try:
        return digest_file(path) != digest
    except OSError:
        return True


def _wait(files: set[Path], seen: Stamps) -> None:
    """Until a file changes, and then until all is quiet: editors save several files in a row."""
    while (now := stamps(files)) == seen:
        time.sleep(PAUSE_S)
    changed = sorted(path for path in files if now[path] != seen[path])
    names = ", ".join(f"`{path.name}`" for path in changed[:3])
    print(f"changed: {names}{', ...' if len(changed) > 3 else ''}", file=sys.stderr, flush=True)
    before: Stamps = {}
    while before != now:
        time.sleep(PAUSE_S)
        before, now = now, stamps(files)
