"""A lab on one cache that evicts at random: `python -m tests.benchmarks.lab [--builds 30]`.

Three clients build at once, each with a store of its own that is empty for every second build; the
first hands its steps to two dask workers. The robot is the four legs with one of five gains. The
cache holds half of what they make, and forgets a file after one request of fifty besides. Every
bundle must be the one that a machine without a cache builds.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "engine"))

from clusters_for_tests import CACHE_KEY, LocalCluster, cluster
from servers_for_tests import CacheServer, serving

from tests.cli.conftest import Legs, new_legs

GAINS = (20, 21, 22, 23, 24)


@dataclass
class Figures:
    """What came of the builds. statuses: of all their steps; wrong: other bytes than gold."""

    builds: int = 0
    failed: int = 0
    wrong: int = 0
    warned: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    changing: threading.Lock = field(default_factory=threading.Lock)

    def __str__(self) -> str:
        known, ran = self.statuses["cached"], self.statuses["ran"]
        return (
            f"{self.builds} builds: {self.wrong} wrong, {self.failed} failed, {self.warned} with a "
            f"warning of the cache; {known} of {known + ran} steps taken from a store or the cache "
            f"({known / max(1, known + ran):.0%})"
        )


def lab(folder: Path, builds: int, seed: int = 0) -> Figures:
    """Run all builds; what came of them."""
    gold = {gain: built(with_gain(new_legs(folder / f"gold{gain}"), gain)) for gain in GAINS}
    figures = Figures()
    (folder / "cluster").mkdir()
    with serving() as server, cluster(folder / "cluster") as workers:
        workers.revive()
        fill_once(folder, server)
        server.limit = sum(map(len, server.files.values())) // 2
        server.forgets = 0.02
        numbers = iter(range(builds))
        turns = threading.Lock()

        def client(name: int) -> None:
            rng = random.Random(seed + name)
            machine = new_legs(folder / f"client{name}")
            while True:
                with turns:
                    number = next(numbers, None)
                if number is None:
                    return
                if number % 2:
                    shutil.rmtree(machine.store, ignore_errors=True)
                one_build(machine, rng.choice(GAINS), name, server, workers, gold, figures)

        clients = [threading.Thread(target=client, args=(name,)) for name in range(3)]
        for each in clients:
            each.start()
        for each in clients:
            each.join()
        asked = Counter(verb for verb, _ in server.asked)
        print(f"the cache: {dict(asked)}, {server.forgotten} files evicted")
        print(f"{server.connections} connections, those of workers among them")
    return figures


def fill_once(folder: Path, server: CacheServer) -> None:
    """All robots, so that it is known how much they are; then nothing."""
    for gain in GAINS:
        machine = with_gain(new_legs(folder / f"fill{gain}"), gain)
        done = build(machine, server)
        assert done.returncode == 0, done.stderr


def one_build(
    machine: Legs,
    gain: int,
    client: int,
    server: CacheServer,
    workers: LocalCluster,
    gold: dict[int, bytes],
    figures: Figures,
) -> None:
    shutil.rmtree(machine.bundle, ignore_errors=True)
    with_gain(machine, gain)
    done = build(machine, server, *(["--executor", workers.executor] if client == 0 else []))
    with figures.changing:
        figures.builds += 1
        figures.warned += "shared cache" in done.stderr
        if done.returncode != 0:
            figures.failed += 1
            print(f"client {client}: {done.stderr}", file=sys.stderr)
            return
        figures.wrong += (machine.bundle / "manifest.json").read_bytes() != gold[gain]
        figures.statuses.update(machine.steps().values())


def build(machine: Legs, server: CacheServer | None, *words: str):
    shared = ["--remote", server.url, "--cache-write"] if server else []
    return subprocess.run(
        machine.command("build", "legs.yaml", *shared, *words),
        cwd=machine.folder,
        env=machine.env(ASSETBUILD_CACHE_KEY=CACHE_KEY),
        capture_output=True,
        text=True,
    )


def built(machine: Legs) -> bytes:
    done = build(machine, None)
    assert done.returncode == 0, done.stderr
    return (machine.bundle / "manifest.json").read_bytes()


def with_gain(machine: Legs, gain: int) -> Legs:
    text = machine.recipe.read_text()
    for each in GAINS:
        text = text.replace(f"kp: {each}", f"kp: {gain}")
    assert f"kp: {gain}" in text
    machine.recipe.write_text(text)
    return machine


def main() -> None:
    """Print the figures; 1 when a build failed or was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--builds", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        figures = lab(Path(name), arguments.builds, arguments.seed)
    print(f"{figures}; {time.monotonic() - began:.0f} s on {os.cpu_count()} cores")
    sys.exit(1 if figures.failed or figures.wrong else 0)


if __name__ == "__main__":
    main()
