"""mjlab's flat velocity task with our Go1 beside mjlab's own: reward curves in one plot.

    python -m tests.benchmarks.mjlab_curves PYTHON BUNDLE... [-n ENVIRONMENTS] [-i ITERATIONS]
        [-s SEEDS] [--at-once 2] [-o curves.svg]

PYTHON: of an environment with mjlab 1.6, such as `assetbuild smoke --consumer mjlab` makes; BUNDLE:
a Go1 built with the target `mjlab`. Each seed trains each robot with mjlab's settings for its Go1.
Prints the reward of a second in the last tenth of the iterations, and ours over theirs. Without a
GPU take `-n 256 --at-once 2`: half of the cores for each of two robots.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

CHILD = Path(__file__).with_name("mjlab_train.py")
WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 760, 420, 60, 50, 50
COLOURS = ("#888888", "#1f6fb2", "#c0504d", "#4f9d5d")
THEIRS = "mjlab's Go1"
Curves = Mapping[str, Sequence[Sequence[float]]]
"""Of each robot one curve a seed: reward of a second by iteration."""


def main() -> None:
    """Prints the table, writes the plot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("python")
    parser.add_argument("bundles", nargs="+", type=Path)
    parser.add_argument("-n", "--environments", type=int, default=4096)
    parser.add_argument("-i", "--iterations", type=int, default=200)
    parser.add_argument("-s", "--seeds", type=int, default=1)
    parser.add_argument("--at-once", type=int, default=1, help="2 without a GPU")
    parser.add_argument("-o", "--out", type=Path, default=Path("curves.svg"))
    asked = parser.parse_args()
    robots = {THEIRS: "mjlab"} | {path.name: str(path.resolve()) for path in asked.bundles}
    curves: dict[str, list[list[float]]] = {name: [] for name in robots}
    print("| robot | seed | device | s | reward/s first tenth | last tenth | fell, last tenth |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for seed in range(asked.seeds):
        threads = max(1, (os.cpu_count() or 1) // asked.at_once)
        train = partial(trained, asked, seed=seed, threads=threads)
        with ThreadPoolExecutor(asked.at_once) as pool:
            for name, got in zip(robots, pool.map(train, robots.values()), strict=True):
                curves[name].append(got["reward"])
                cells = (
                    f"{got['seconds']:.0f}",
                    f"{tenth(got['reward'], first=True):.3f}",
                    f"{tenth(got['reward']):.3f}",
                    f"{tenth(got['fell']):.2%}",
                )
                print(f"| {name} | {seed} | {got['device']} | {' | '.join(cells)} |", flush=True)
    theirs = [tenth(curve) for curve in curves[THEIRS]]
    for name in [name for name in robots if name != THEIRS]:
        ratios = [tenth(a) / b for a, b in zip(curves[name], theirs, strict=True)]
        print(f"{name} over {THEIRS}, last tenth, by seed: {', '.join(f'{r:.3f}' for r in ratios)}")
    title = f"mjlab, flat velocity task, {asked.environments} environments"
    asked.out.write_text(plot(title, curves), encoding="utf-8")
    print(asked.out)


def trained(asked: argparse.Namespace, who: str, seed: int, threads: int) -> dict:
    """What `mjlab_train` answers; its words are shown where it fails."""
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        words = (who, asked.environments, asked.iterations, seed, answer, threads)
        command = [asked.python, str(CHILD), *(str(word) for word in words)]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if not answer.is_file():
            raise SystemExit(f"{who}: {(done.stdout + done.stderr)[-2000:]}")
        return json.loads(answer.read_text(encoding="utf-8"))


def tenth(values: Sequence[float], *, first: bool = False) -> float:
    """Mean of the last (or first) tenth."""
    count = max(1, len(values) // 10)
    return statistics.mean(values[:count] if first else values[-count:])


def plot(title: str, curves: Curves) -> str:
    """Reward of a second against iterations, as SVG."""
    every = [value for robot in curves.values() for curve in robot for value in curve]
    least, most = min(0.0, min(every)), max(every)
    longest = max(len(curve) for robot in curves.values() for curve in robot)
    wide, high = WIDTH - LEFT - 20, HEIGHT - TOP - BOTTOM

    def y_of(value: float) -> float:
        return TOP + high * (most - value) / (most - least)

    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        f'<text x="{LEFT}" y="22" font-size="15">{title}</text>',
    ]
    step = next(size for size in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0) if (most - least) / size <= 8)
    for number in range(math.ceil(least / step), math.floor(most / step) + 1):
        value = number * step
        lines += [
            f'<path d="M{LEFT} {y_of(value):.1f}h{wide}" stroke="#ddd"/>',
            f'<text x="{LEFT - 6}" y="{y_of(value) + 4:.1f}" text-anchor="end">{value:.1f}</text>',
        ]
    for number, (name, robot) in enumerate(curves.items()):
        colour = COLOURS[number % len(COLOURS)]
        lines.append(f'<text x="{LEFT + 10 + 120 * number}" y="42" fill="{colour}">{name}</text>')
        for curve in robot:
            points = " ".join(
                f"{LEFT + wide * i / max(1, longest - 1):.1f},{y_of(value):.1f}"
                for i, value in enumerate(curve)
            )
            lines.append(f'<polyline points="{points}" fill="none" stroke="{colour}"/>')
    lines += [
        f'<text x="{LEFT}" y="{HEIGHT - 28}">0</text>',
        f'<text x="{LEFT + wide}" y="{HEIGHT - 28}" text-anchor="end">{longest} iterations</text>',
        f'<text x="{LEFT}" y="{HEIGHT - 10}">mean reward of a second, all terms of the task</text>',
    ]
    return "\n".join([*lines, "</svg>"]) + "\n"


if __name__ == "__main__":
    main()
