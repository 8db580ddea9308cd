"""Plants bugs in the writers and counts those after which a build still says "ready".

python -m tests.writers --count 100 --seed 1
"""

from __future__ import annotations

import argparse
import json
import random
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

from tests.writers.plant import Bug, bugs
from tests.writers.shop import PACKAGE, Shop, Trial

HERE = Path(__file__).parent
ROBOTS = (HERE.parents[1] / "recipes/go1.yaml", HERE.parents[1] / "recipes/panda.yaml",
          HERE / "four_bar.yaml")  # fmt: skip


def main(words: Sequence[str] | None = None) -> None:
    """Prints a line for each bug that changes the meaning, and a table at the end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="bugs that change the meaning")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recipe", type=Path, action="append", help="default: three robots")
    parser.add_argument("--file", default="targets/", help="beginning of the files' names")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, help="all trials, a line of JSON each")
    chosen = parser.parse_args(words)
    drawn = every_bug(chosen.file)
    random.Random(chosen.seed).shuffle(drawn)
    recipes = [path.resolve() for path in chosen.recipe or ROBOTS]
    fates: Counter[tuple[str, str]] = Counter()
    for trial in trials(recipes, drawn, chosen.processes):
        fates[trial.bug.kind, trial.fate] += 1
        if trial.fate in ("missed", "caught"):
            print(told(trial), flush=True)
        if chosen.out:
            with chosen.out.open("a") as lines:
                lines.write(json.dumps(asdict(trial)) + "\n")
        if sum(n for (_, fate), n in fates.items() if fate in ("missed", "caught")) >= chosen.count:
            break
    print(table(fates))


def every_bug(beginning: str) -> list[Bug]:
    """All bugs of all writers."""
    files = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))
    return [bug for file in files if file.startswith(beginning) for bug in bugs(PACKAGE, file)]


def trials(recipes: list[Path], drawn: Sequence[Bug], processes: int) -> Iterator[Trial]:
    """What becomes of each bug, as long as somebody asks."""
    with tempfile.TemporaryDirectory(prefix="writers-") as folder:
        shop = Shop(recipes, Path(folder))
        for recipe in recipes:
            shop.clean_of(recipe)
        with ThreadPoolExecutor(processes) as pool:
            for start in range(0, len(drawn), processes):
                yield from pool.map(shop.try_one, drawn[start : start + processes])


def told(trial: Trial) -> str:
    """One line."""
    bug = trial.bug
    place = f"{bug.file}:{bug.line} {bug.kind}: {bug.text}"
    return f"{trial.fate:7} {trial.robot:9} {place} -> {', '.join(trial.files)} {trial.blocked_by}"


def table(fates: Counter[tuple[str, str]]) -> str:
    """Kinds of bugs against what became of them."""
    columns = ("caught", "missed", "refused", "same")
    rows = [f"| kind | {' | '.join(columns)} |", "| --- |" + " ---: |" * len(columns)]
    for kind in sorted({kind for kind, _ in fates}):
        rows += [f"| {kind} | {' | '.join(str(fates[kind, column]) for column in columns)} |"]
    sums = [sum(n for (_, fate), n in fates.items() if fate == column) for column in columns]
    return "\n".join([*rows, f"| all | {' | '.join(map(str, sums))} |"])


if __name__ == "__main__":
    main()
