"""`assetbuild cache`: what the store holds; verify it; hold it below a size; share it."""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from assetbuild.cli.parser import WHICH_CHECK
from assetbuild.cli.recipes import Recipes, file_or_robot

if TYPE_CHECKING:
    from assetbuild.engine.store import Store

UNITS = {"": 1, "K": 1000, "M": 1000**2, "G": 1000**3, "T": 1000**4}
UNITS |= {"KI": 1024, "MI": 1024**2, "GI": 1024**3, "TI": 1024**4}

HELP = "look after the store: stats, check, gc, push, pull"
EPILOG = WHICH_CHECK


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    verbs = parser.add_subparsers(dest="what", metavar="WHAT", required=True)
    stats = verbs.add_parser("stats", help="count what the store holds")
    stats.add_argument("--json", action="store_true", help="print data")
    verbs.add_parser("check", help="verify every object; corrupt ones are set aside")
    gc = verbs.add_parser("gc", help="remove what was used least lately")
    gc.add_argument(
        "--max-size", required=True, type=size_of_text, metavar="SIZE", help="as 5GB or 500MB"
    )
    for name, text in (
        ("push", "send what is built of recipes to a cache that machines share"),
        ("pull", "fetch what other machines built of recipes"),
    ):
        verb = verbs.add_parser(name, help=text)
        verb.add_argument(
            "recipes", nargs="+", type=file_or_robot, metavar="RECIPE", action=Recipes
        )
        verb.add_argument("--variant", metavar="NAME", help="a variant of the recipes")
        add_remote(verb)


def add_sharing(parser: argparse.ArgumentParser) -> None:
    """Declare what every verb that builds takes: `--remote` and `--cache-write`."""
    add_remote(parser)
    parser.add_argument("--cache-write", action="store_true", help="also write to that cache")


def add_remote(parser: argparse.ArgumentParser) -> None:
    """Declare `--remote`."""
    parser.add_argument(
        "--remote",
        default=os.environ.get("ASSETBUILD_REMOTE", ""),
        metavar="URL",
        help="cache shared with other machines, http(s)://... or s3://bucket/prefix; "
        "default: $ASSETBUILD_REMOTE",
    )


def size_of_text(text: str) -> int:
    """Bytes of `5GB`, `500 MB`, `2GiB` or `1000`."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?I?)B?", text.strip().upper())
    if found is None or found[2] not in UNITS:
        message = f"must be a size such as `500MB`, `5GB` or `2GiB`, not `{text}`"
        raise argparse.ArgumentTypeError(message)
    return int(float(found[1]) * UNITS[found[2]])


def run(arguments: argparse.Namespace) -> int:
    """0; 1 when `check` found something wrong, or a cache failed."""
    from assetbuild.engine.folders import cache_root
    from assetbuild.engine.store import LAYOUT, Store

    if arguments.what in ("push", "pull"):
        return _share(arguments)
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


def _share(arguments: argparse.Namespace) -> int:
    """1 when the cache fails on the way: here it was asked for."""
    from assetbuild.errors import UsageError
    from assetbuild.pipeline.opening import remote_cache
    from assetbuild.pipeline.sharing import pull, push

    faults: list[str] = []
    remote = remote_cache(arguments.remote, faults.append, write=arguments.what == "push")
    if remote is None:
        raise UsageError("no cache is named", hint="say `--remote URL`, or set ASSETBUILD_REMOTE")
    verb, said = (push, "sent") if arguments.what == "push" else (pull, "in the store")
    for recipe in arguments.recipes:
        done = verb(recipe, arguments.variant, remote)
        more = "" if done.whole else ", and more that is known once these are built"
        print(f"{recipe}: {done.done} of {done.steps} results {said}{more}")
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


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
