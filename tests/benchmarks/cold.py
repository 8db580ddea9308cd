"""The first build of a robot, step by step: `python -m tests.benchmarks.cold go1 g1 panda`.

Each robot is built once for its downloads, then several times from an empty store that holds
nothing else. Prints a table of the build in the middle: what each step took of the processor and by
the clock, what imports took of that, and whether the step is on the critical path, which is the
chain of steps, each reading the one before, that needs the processor longest. Then a gain is
changed in the recipe, several times. The last table is the budget: CPU seconds by kind of step.
`--together` builds all robots as one graph as well.
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
LEAST_S = 0.1
"""Steps that take the processor less are one row."""
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
    cpu = sum(spent for kind, _, spent in noted if kind != "step")
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


def critical(recipe: Path, store: Path, cpu: dict[str, float]) -> list[str]:
    """The chain of steps that takes the processor longest."""
    command = [sys.executable, "-m", "assetbuild", "plan", str(recipe), "--format", "json"]
    environment = os.environ | {"ASSETBUILD_CACHE": str(store), "PYTHONPATH": str(ROOT)}
    nodes = json.loads(subprocess.check_output(command, env=environment))["nodes"]
    chains: dict[str, list[str]] = {}
    for node in nodes:  # each after all that it reads
        makers = {ref.partition(":")[0] for ref in node["inputs"].values()} & set(chains)
        before = max((chains[maker] for maker in makers), key=lambda c: _sum(c, cpu), default=[])
        chains[node["label"]] = [*before, node["label"]]
    return max(chains.values(), key=lambda chain: _sum(chain, cpu))


def _sum(chain: list[str], cpu: dict[str, float]) -> float:
    return sum(cpu.get(label, 0.0) for label in chain)


def table(built: Built, recipe: Path, store: Path) -> str:
    """A row for each step that counts, for each worker, and for the process that builds."""
    steps = steps_of(recipe)
    cpu = {label: step["child_cpu_seconds"] for label, step in steps.items()}
    imports = {label: spent for kind, label, spent in built.notes if kind == "step"}
    path = critical(recipe, store, cpu)
    rows = [
        (f"{label} | {step['seconds']:.1f}", cpu[label], imports.get(label, 0.0), label in path)
        for label, step in steps.items()
        if cpu[label] >= LEAST_S or label in path
    ]
    small = [label for label in steps if cpu[label] < LEAST_S and label not in path]
    spent = _sum(small, cpu), _sum(small, imports)
    rows.append((f"{len(small)} steps of less than {LEAST_S} s | ", *spent, False))
    workers = [(label, spent) for kind, label, spent in built.notes if kind == "worker"]
    rows += [
        (f"worker: {label or 'no modules'} | ", spent, spent, False) for label, spent in workers
    ]
    rest = built.cpu - sum(cpu.values()) - sum(spent for _, spent in workers)
    rows.append(("the process that builds | ", rest, 0.0, False))
    lines = [
        f"| {name} | {spent:.2f} | {imported:.2f} | {'yes' if on_path else ''} |"
        for name, spent, imported, on_path in sorted(rows, key=lambda row: -row[1])
    ]
    head = "| step | wall s | CPU s | imports s | critical |\n| --- | --- | --- | --- | --- |"
    return "\n".join([head, *lines, f"critical path: {_sum(path, cpu):.1f} CPU s"])


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
    parser.add_argument("--together", action="store_true", help="all as one graph, too")
    arguments = parser.parse_args()
    jobs = ("-j", str(arguments.jobs)) if arguments.jobs else ()
    with tempfile.TemporaryDirectory(prefix="assetbuild-cold-") as name:
        folder, warm = Path(name), Path(name) / "warm"
        shutil.copytree(ROOT / "recipes", folder, dirs_exist_ok=True)
        recipes = [folder / f"{robot}.yaml" for robot in arguments.robots]
        build(recipes, folder, warm)
        budgets: dict[str, dict[str, float]] = {}
        print("| from nothing | wall s | CPU s | peak MB |\n| --- | --- | --- | --- |")
        for some in [[recipe] for recipe in recipes] + [recipes] * arguments.together:
            runs = []
            for number in range(arguments.times):
                store = only_downloads(warm, folder / f"store-{number}")
                runs.append((build(some, folder, store, *jobs), store))
            middle, store = sorted(runs, key=lambda run: run[0].cpu)[len(runs) // 2]
            print(middle.row(" ".join(recipe.stem for recipe in some)), flush=True)
            if len(some) == 1:
                print(table(middle, some[0], store))
                budgets[some[0].stem] = kinds(middle, some[0])
                gains = gain_changed(some[0], folder, store, arguments.times)
                cpu, wall = (
                    statistics.median(getattr(g, n) for g in gains) for n in ("cpu", "wall")
                )
                print(f"a gain changed: {cpu:.2f} CPU s, {wall:.2f} s by the clock", flush=True)
        print(budget(budgets))
    return 0


if __name__ == "__main__":
    sys.exit(main())
