"""`assetbuild cache`: what the store holds; verify it; hold it below a size."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from assetbuild.engine.store import Store

HELP = "look after the store: stats, check, gc"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    verbs = parser.add_subparsers(dest="what", metavar="WHAT", required=True)
    stats = verbs.add_parser("stats", help="count what the store holds")
    stats.add_argument("--json", action="store_true", help="print data")
    verbs.add_parser("check", help="verify every object; corrupt ones are set aside")
    gc = verbs.add_parser("gc", help="remove what was used least lately")
    gc.add_argument("--max-size", required=True, type=_size, metavar="SIZE", help="as 5GB or 500MB")


def _size(text: str) -> int:
    from assetbuild.engine.housekeeping import size_of_text

    try:
        return size_of_text(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def run(arguments: argparse.Namespace) -> int:
    """0; 1 when `check` found something wrong."""
    from assetbuild.engine.folders import cache_root
    from assetbuild.engine.store import LAYOUT, Store

    root = Path(cache_root())
    if arguments.what == "stats":
        return _stats(root, as_json=arguments.json)
    if not (root / LAYOUT).is_dir():
        print(f"there is no store at {root} yet", file=sys.stderr)
        return 0
    store = Store(root)
    try:
        return _check(store) if arguments.what == "check" else _gc(store, arguments.max_size)
    finally:
        store.close()


def _stats(root: Path, *, as_json: bool) -> int:
    import time

    from assetbuild.engine.housekeeping import stats

    found = stats(root)
    if as_json:
        print(json.dumps({"root": str(root), **found.to_json()}, indent=2, sort_keys=True))
        return 0
    print(f"{root}: {_shown(found.total_bytes)}")
    print(f"  objects: {found.objects}, {_shown(found.object_bytes)}")
    print(f"  results of steps: {found.actions}")
    if found.quarantined:
        print(f"  corrupt objects, set aside: {found.quarantined}")
    if found.oldest_use:
        print(f"  oldest use: {time.strftime('%Y-%m-%d', time.localtime(found.oldest_use))}")
    if found.live_builds:
        print(f"  builds that run now: {found.live_builds}")
    return 0


def _check(store: Store) -> int:
    from assetbuild.engine.housekeeping import check

    found = check(store)
    for digest in found.corrupt:
        print(f"corrupt, set aside: {digest}")
    print(
        f"{found.objects} objects verified, {len(found.corrupt)} corrupt; forgotten results: "
        f"{found.torn} torn, {found.incomplete} without their files"
    )
    return 0 if found.is_clean else 1


def _gc(store: Store, max_bytes: int) -> int:
    from assetbuild.engine.housekeeping import collect

    done = collect(store, max_bytes)
    print(
        f"{_shown(done.before)} -> {_shown(done.after)}: "
        f"{done.actions} results and {done.objects} objects removed"
    )
    if done.after > max_bytes:
        print("over the limit: builds that run now use the rest", file=sys.stderr)
    return 0


def _shown(size: int) -> str:
    value, unit = float(size), "bytes"
    for unit in ("bytes", "kB", "MB", "GB"):
        if value < 1000 or unit == "GB":
            break
        value /= 1000
    return f"{size} bytes" if unit == "bytes" else f"{value:.1f} {unit}"
