"""Real robots from nothing: `python -m tests.benchmarks.real recipes/go1.yaml recipes/*.yaml`.

First the first recipe alone, then all together as one graph, each with an empty store; downloads
are made once before and not measured. Then a gain is changed in the first recipe, several times.
Prints seconds by the clock and of the processor, how much of the machine was used, the peak of
memory that all processes held together (shared pages counted once), and the longest steps.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from assetbuild.engine.processes import usable_cores


@dataclass(frozen=True)
class Built:
    """wall, cpu: seconds. peak_mb: of all processes together."""

    wall: float
    cpu: float
    peak_mb: float

    def row(self, name: str, cores: int) -> str:
        used = self.cpu / self.wall / cores
        return (
            f"| {name} | {self.wall:.1f} | {self.cpu:.1f} | {used:.0%} of {cores} cores "
            f"| {self.peak_mb:.0f} |"
        )


class Memory(threading.Thread):
    """Looks at a process and its descendants five times a second."""

    def __init__(self, pid: int) -> None:
        super().__init__(daemon=True)
        self.pid, self.peak_mb, self.over = pid, 0.0, threading.Event()

    def run(self) -> None:
        while not self.over.wait(0.2):
            self.peak_mb = max(self.peak_mb, sum(map(_pss_mb, _family(self.pid))))


def _family(pid: int) -> set[int]:
    children: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
            children.setdefault(parent, []).append(int(stat.parent.name))
    found, pending = {pid}, [pid]
    while pending:
        more = children.get(pending.pop(), [])
        found |= set(more)
        pending += more
    return found


def _pss_mb(pid: int) -> float:
    """Proportional set size: a page that n processes share counts 1/n in each."""
    with suppress(OSError, IndexError):
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
        return int(text.partition("\nPss:")[2].split()[0]) / 1024
    return 0.0


def build(recipes: list[Path], folder: Path, store: Path) -> Built:
    """Of all recipes as one graph."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("ASSETBUILD_")}
    began = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "assetbuild", "build", *map(str, recipes), "--fail-on", "never"],
        cwd=folder,
        env=kept | {"ASSETBUILD_CACHE": str(store)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    memory = Memory(process.pid)
    memory.start()
    _, status, used = os.wait4(process.pid, 0)
    wall = time.monotonic() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    memory.over.set()
    if process.returncode != 0:
        raise SystemExit(f"the build ended with {process.returncode}")
    return Built(wall, used.ru_utime + used.ru_stime, memory.peak_mb)


def steps(folder: Path, recipes: list[Path]) -> dict[str, float]:
    """Seconds of each step that ran in the last build of these recipes, by robot and label."""
    found = {}
    for log in (folder / "build" / f"{recipe.stem}.run.json" for recipe in recipes):
        for label, step in json.loads(log.read_text())["steps"].items():
            if step["status"] == "ran":
                found[f"{log.name.partition('.')[0]}: {label}"] = float(step["seconds"])
    return found


def only_downloads(full: Path, fresh: Path) -> None:
    """A store that holds what `fetch` brought, and nothing else."""
    shutil.copytree(full, fresh)
    for entry in (fresh / "v1/ac").glob("*/*.json"):
        if set(json.loads(entry.read_bytes())["result"]["outputs"]) != {"archive"}:
            entry.unlink()
    shutil.rmtree(fresh / "v1/null", ignore_errors=True)


def gain_changed(recipe: Path, folder: Path, store: Path, times: int) -> list[Built]:
    """The first `kp` of the recipe, a little more each time."""
    place = folder / recipe.name
    text = recipe.read_text()
    runs = []
    for n in range(times + 1):
        place.write_text(
            re.sub(r"kp: *([0-9.]+)", lambda m, n=n: f"kp: {float(m[1]) + n / 10}", text, count=1)
        )
        runs.append(build([place], folder, store))
    return runs[1:]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recipes", nargs="+", type=Path)
    parser.add_argument("--gains", type=int, default=5, help="how often a gain is changed")
    arguments = parser.parse_args()
    recipes = list(dict.fromkeys(path.absolute() for path in arguments.recipes))
    cores = usable_cores()
    with tempfile.TemporaryDirectory(prefix="assetbuild-real-") as name:
        folder, warm = Path(name), Path(name) / "warm"
        for recipe in recipes:
            for path in recipe.parent.glob(f"{recipe.stem}.*"):
                shutil.copyfile(path, folder / path.name)
        own = [folder / recipe.name for recipe in recipes]
        build(own, folder, warm)
        print("| from nothing | wall s | processor s | used | peak MB |")
        print("| --- | --- | --- | --- | --- |")
        rows = {own[0].stem: own[:1]} | ({f"{len(own)} robots": own} if own[1:] else {})
        for title, some in rows.items():
            store = folder / f"store-{len(some)}"
            only_downloads(warm, store)
            print(build(some, folder, store).row(title, cores), flush=True)
            longest = sorted(steps(folder, some).items(), key=lambda pair: -pair[1])[:5]
            print(f"<!-- longest: {', '.join(f'{k} {v:.1f} s' for k, v in longest)} -->")
        runs = gain_changed(recipes[0], folder, warm, arguments.gains)
        wall, cpu = (statistics.median(getattr(r, n) for r in runs) for n in ("wall", "cpu"))
        print(f"a gain changed: {wall:.2f} s wall, {cpu:.2f} s processor; ran:")
        print("  " + ", ".join(f"{k} {v:.2f}" for k, v in steps(folder, own[:1]).items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
