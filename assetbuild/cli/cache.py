"""`assetbuild cache`: what the store holds; verify it; hold it below a size; share it."""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rich.filesize import decimal

from assetbuild.engine.housekeeping import check, collect, stats
from assetbuild.engine.machine import cache_root
from assetbuild.engine.session import Resolver, Session
from assetbuild.engine.store import LAYOUT, Store
from assetbuild.errors import UsageError

if TYPE_CHECKING:
    from assetbuild.engine.graph import Graph
    from assetbuild.engine.share.remote import Remote


def run(arguments: argparse.Namespace) -> int:
    """0; 1 when `check` found something wrong, or a cache failed."""
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
    store_stats = stats(root)
    if as_json:
        print(json.dumps({"root": str(root), **asdict(store_stats)}, indent=2, sort_keys=True))
        return 0
    print(f"{root}: {decimal(store_stats.total_bytes)}")
    print(f"  objects: {store_stats.objects}, {decimal(store_stats.object_bytes)}")
    print(f"  results of steps: {store_stats.actions}")
    if homes := sorted((root / "environments").glob("*")):
        print(f"  trainers' environments, to delete by hand: {', '.join(map(str, homes))}")
    if store_stats.quarantined:
        print(f"  corrupt objects, set aside: {store_stats.quarantined}")
    if store_stats.oldest_use:
        print(f"  oldest use: {time.strftime('%Y-%m-%d', time.localtime(store_stats.oldest_use))}")
    if store_stats.live_builds:
        print(f"  builds that run now: {store_stats.live_builds}")
    return 0


def _share(arguments: argparse.Namespace) -> int:
    """1 when the cache fails on the way: here it was asked for."""
    from assetbuild.pipeline.opening import opened, remote_cache
    from assetbuild.pipeline.recipes import load_recipe

    faults: list[str] = []
    is_push = arguments.what == "push"
    remote = remote_cache(arguments.remote, faults.append, write=is_push)
    if remote is None:
        raise UsageError("no cache is named", hint="say `--remote URL`, or set ASSETBUILD_REMOTE")
    for recipe in arguments.recipes:
        loaded = load_recipe(recipe, arguments.variant)
        with opened(loaded, None if is_push else remote) as look:
            known = look.known() if is_push else look.stored()
            done = _sent(known.graph, look.session, remote) if is_push else len(known.results)
        state = "sent" if is_push else "in the store"
        more = "" if known.whole else ", and more that is known once these are built"
        print(f"{recipe}: {done} of {len(known.graph.nodes)} results {state}{more}")
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


def _sent(graph: Graph, session: Session, remote: Remote) -> int:
    """How many results were sent; every one that the store has is offered, nothing is built."""
    resolver = Resolver(graph.nodes, session)
    sent = 0
    for label in graph.nodes:
        action, made = resolver.action(label), resolver.made(label)
        if action is not None and made is not None:
            sent += remote.put(action.key, made, session.store)
    return sent


def _check(store: Store) -> int:
    result = check(store)
    for digest in result.corrupt:
        print(f"corrupt, set aside: {digest}")
    print(
        f"{result.objects} objects verified, {len(result.corrupt)} corrupt; forgotten results: "
        f"{result.torn} torn, {result.incomplete} without their files"
    )
    return 1 if result.corrupt or result.torn else 0  # without its files one is merely forgotten


def _gc(store: Store, max_bytes: int) -> int:
    done = collect(store, max_bytes)
    print(
        f"{cache_root()}: {decimal(done.before)} -> {decimal(done.after)}; "
        f"{done.actions} results and {done.objects} objects removed"
    )
    if done.after > max_bytes:
        print("still over the limit: what running builds use stays", file=sys.stderr)
    return 0
