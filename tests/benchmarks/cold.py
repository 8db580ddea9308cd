"""The first build of a robot by kind of step: `python -m tests.benchmarks.cold go1 g1 panda`.

Each robot is built once for its downloads, then several times from an empty store that holds
nothing else; the build in the middle counts. Then a gain is changed in the recipe, several times.
The last table is the budget: CPU seconds by kind of step.
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
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
OURS = ("ASSETBUILD_", "PYTHONDONTWRITEBYTECODE")
"""Variables that the builds do not see: bytecode is warm, as after the first build anywhere."""
WORTH_S = 0.5
"""Kinds of steps that take the processor less are one row of the budget."""


@dataclass(frozen=True)
class Built:
    """wall, cpu: seconds. peak_mb: of the largest process. notes: of `watched`."""

    wall: float
    cpu: float
    peak_mb: float
    notes: tuple[tuple[str, str, float], ...] = ()

    def row(self, name: str) -> str:
        return f"| {name} | {self.wall:.1f} | {self.cpu:.1f} | {self.peak_mb:.0f} |"


def build(recipes: list[Path], folder: Path, store: Path, *options: str) -> Built:
    """All recipes as one graph."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(OURS)}
    notes = folder / "notes"
    notes.write_text("")
    command = [sys.executable, "-m", "tests.benchmarks.watched", str(notes), "build"]
    began = time.monotonic()
    process = subprocess.Popen(
        [*command, *map(str, recipes), "--fail-on", "never", *options],
        cwd=folder,
        env=kept | {"ASSETBUILD_CACHE": str(store), "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(process.pid, 0)
    wall = time.monotonic() - began
    # What a killed process had spent is lost to `wait4`: the workers say it themselves.
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"the build ended with {process.returncode}")
    noted = tuple(tuple(json.loads(line)) for line in notes.read_text().splitlines())
    cpu = sum(spent for _, _, spent in noted)
    cpu += sum(s["child_cpu_seconds"] for each in recipes for s in steps_of(each).values())
    return Built(wall, cpu, used.ru_maxrss / 1024, noted)


def only_downloads(full: Path, fresh: Path) -> Path:
    """A store that holds what `fetch` brought, and nothing else."""
    shutil.rmtree(fresh, ignore_errors=True)
    shutil.copytree(full, fresh)
    for entry in (fresh / "v1/ac").glob("*/*.json"):
        if set(json.loads(entry.read_bytes())["result"]["outputs"]) != {"archive"}:
            entry.unlink()
    for made in ("null", "journal", "code"):
        shutil.rmtree(fresh / "v1" / made, ignore_errors=True)
    return fresh


def steps_of(recipe: Path) -> dict[str, dict[str, Any]]:  # Any: JSON
    """What the run log of the last build says of each step that ran."""
    log = json.loads((recipe.parent / "build" / f"{recipe.stem}.run.json").read_bytes())
    return {label: step for label, step in log["steps"].items() if step["status"] == "ran"}


def kinds(built: Built, recipe: Path) -> dict[str, float]:
    """CPU seconds by kind of step, of all workers' imports, and of the process that builds."""
    found: dict[str, float] = defaultdict(float)
    for label, step in steps_of(recipe).items():
        first = label.partition(" ")[0]
        found[label if first == "check" else first] += step["child_cpu_seconds"]
    workers = (spent for kind, _, spent in built.notes if kind == "worker")
    found["imports of the workers"] = sum(workers)
    found["the process that builds"] = built.cpu - sum(found.values())
    return found


def budget(robots: dict[str, dict[str, float]]) -> str:
    """A row for each kind that takes WORTH_S of any robot, and one for all others."""
    most = {kind: max(each.get(kind, 0.0) for each in robots.values())
            for each in robots.values() for kind in each}  # fmt: skip
    order = sorted((kind for kind in most if most[kind] >= WORTH_S), key=lambda kind: -most[kind])
    rows = [(kind, [each.get(kind, 0.0) for each in robots.values()]) for kind in order]
    rest = [sum(each.values()) - sum(each.get(k, 0.0) for k in order) for each in robots.values()]
    rows += [("others", rest), ("together", [sum(each.values()) for each in robots.values()])]
    head = f"| CPU s | {' | '.join(robots)} |\n| --- |{' --- |' * len(robots)}"
    lines = [f"| {kind} | {' | '.join(f'{v:.1f}' for v in values)} |" for kind, values in rows]
    return "\n".join([head, *lines])


def gain_changed(recipe: Path, folder: Path, store: Path, times: int) -> list[Built]:
    """The first `kp` of the recipe, a little more each time."""
    text = recipe.read_text()
    runs = []
    for n in range(times + 1):
        recipe.write_text(
            re.sub(r"kp: *([0-9.]+)", lambda m, n=n: f"kp: {float(m[1]) + n / 10}", text, count=1)
        )
        runs.append(build([recipe], folder, store))
    recipe.write_text(text)
    return runs[1:]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="+", help="names in recipes/")
    parser.add_argument("--times", type=int, default=5, help="builds of each, and changed gains")
    parser.add_argument("--jobs", type=int, default=0, help="steps at once; 0: as `build` does")
    arguments = parser.parse_args()
    jobs = ("-j", str(arguments.jobs)) if arguments.jobs else ()
    with tempfile.TemporaryDirectory(prefix="assetbuild-cold-") as name:
        folder, warm = Path(name), Path(name) / "warm"
        shutil.copytree(ROOT / "recipes", folder, dirs_exist_ok=True)
        recipes = [folder / f"{robot}.yaml" for robot in arguments.robots]
        build(recipes, folder, warm)
        budgets: dict[str, dict[str, float]] = {}
        print("| from nothing | wall s | CPU s | peak MB |\n| --- | --- | --- | --- |")
        for recipe in recipes:
            runs = []
            for number in range(arguments.times):
                store = only_downloads(warm, folder / f"store-{number}")
                runs.append((build([recipe], folder, store, *jobs), store))
            middle, store = sorted(runs, key=lambda run: run[0].cpu)[len(runs) // 2]
            print(middle.row(recipe.stem), flush=True)
            budgets[recipe.stem] = kinds(middle, recipe)
            gains = gain_changed(recipe, folder, store, arguments.times)
            cpu, wall = (statistics.median(getattr(g, n) for g in gains) for n in ("cpu", "wall"))
            print(f"a gain changed: {cpu:.2f} CPU s, {wall:.2f} s by the clock", flush=True)
        print(budget(budgets))
    return 0


if __name__ == "__main__":
    sys.exit(main())
