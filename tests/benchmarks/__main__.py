"""Builds beside ninja, doit, Snakemake and DVC: `python -m tests.benchmarks`.

The same synthetic graph for all, each tool in an environment of its own, which is made on the first
run. Medians of wall clock and processor time, beside an empty Python in the same run; then the
faults that make a tool trust what it should not. Rows are Markdown.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.benchmarks.graph import write_sources, wrong_outputs
from tests.benchmarks.tools import TOOLS, Tool, install

EMPTY = [sys.executable, "-c", "pass"]


@dataclass(frozen=True)
class Run:
    """Seconds of one command: by the clock, and of the processor, with all children."""

    wall: float
    cpu: float


@dataclass(frozen=True)
class Place:
    """A folder with the sources, written for one tool."""

    tool: Tool
    folder: Path
    environments: Path
    robots: int

    def build(self) -> Run:
        """RuntimeError with what the tool said when it fails."""
        log = self.folder / "bench.log"
        with log.open("wb") as out:
            began = time.monotonic()
            process = subprocess.Popen(
                self.tool.command(self.environments, self.robots),
                cwd=self.folder,
                env=self.tool.environment(self.folder, self.environments),
                stdout=out,
                stderr=out,
            )
            _, status, used = os.wait4(process.pid, 0)
            wall = time.monotonic() - began
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            raise RuntimeError(f"{self.tool.name}: {log.read_text(errors='replace')[-300:]}")
        return Run(wall, used.ru_utime + used.ru_stime)


def empty_python() -> Run:
    began = time.monotonic()
    process = subprocess.Popen(EMPTY)
    _, _, used = os.wait4(process.pid, 0)
    return Run(time.monotonic() - began, used.ru_utime + used.ru_stime)


def median(runs: list[Run]) -> Run:
    return Run(statistics.median(r.wall for r in runs), statistics.median(r.cpu for r in runs))


def prepared(tool: Tool, work: Path, environments: Path, robots: int) -> Place:
    folder = work / f"{tool.name}-{robots}"
    write_sources(folder, robots)
    tool.write(folder, robots)
    return Place(tool, folder, environments, robots)


# --- speed


def measure(place: Place, rounds: int) -> dict[str, Run]:
    """Cold, null and leaf; every result is compared with what the sources make."""
    cold, null, leaf, empty = [], [], [], []
    for _ in range(max(1, rounds // 3)):
        place.tool.forget(place.folder)
        cold.append(place.build())
    time.sleep(2.5)  # stamps younger than two seconds prove nothing to us
    place.build()
    for _ in range(rounds):
        empty.append(empty_python())
        null.append(place.build())
    mesh = place.folder / "src/r0/m0.stl"
    for n in range(max(1, rounds // 2)):
        mesh.write_bytes(bytes([n]) + mesh.read_bytes()[1:])
        leaf.append(place.build())
    wrong = wrong_outputs(place.folder, place.robots)
    if wrong:
        raise RuntimeError(f"{place.tool.name}: wrong after the last edit: {wrong[:3]}")
    found = {"null": null, "leaf": leaf, "cold": cold, "empty": empty}
    return {name: median(runs) for name, runs in found.items()}


def speed(tools: list[Tool], work: Path, environments: Path, robots: int, rounds: int) -> None:
    print(
        f"\n{robots} robots: {98 * robots} steps, {129 * robots} files; seconds, wall (processor)"
    )
    print("| | null | leaf changed | cold | null: processor against an empty Python |")
    print("| --- | --- | --- | --- | --- |")
    for tool in tools:
        place = prepared(tool, work, environments, robots)
        try:
            found = measure(place, rounds)
            cells = [f"{found[k].wall:.3f} ({found[k].cpu:.3f})" for k in ("null", "leaf", "cold")]
            cells.append(f"{found['null'].cpu / max(found['empty'].cpu, 1e-3):.1f}")
        except RuntimeError as error:
            cells = [" ".join(str(error).split())[:120], "", "", ""]
        print(f"| {tool.name} | {' | '.join(cells)} |", flush=True)
        shutil.rmtree(place.folder)


# --- faults


def same_size_edit_mtime_restored(folder: Path) -> None:
    path = folder / "src/r0/m0.stl"
    before = path.stat()
    data = path.read_bytes()
    with path.open("r+b") as file:
        file.write(bytes([data[0] ^ 1]))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def output_edited(folder: Path) -> None:
    path = folder / "out/r0/mjcf"
    path.chmod(0o644)
    with path.open("r+b") as file:
        file.write(b"edited")


def output_truncated_mtime_kept(folder: Path) -> None:
    path = folder / "out/r0/usd"
    before = path.stat()
    path.chmod(0o644)
    with path.open("r+b") as file:
        file.truncate(1000)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def edit_dated_yesterday(folder: Path) -> None:
    path = folder / "src/r0/m0.stl"
    path.write_bytes(b"new" + path.read_bytes()[4:])
    os.utime(path, (time.time() - 86400, time.time() - 86400))


FAULTS: dict[str, Callable[[Path], None]] = {
    "A source edited, same size, mtime restored": same_size_edit_mtime_restored,
    "B built output edited": output_edited,
    "C output truncated, mtime kept": output_truncated_mtime_kept,
    "E source edited, mtime a day back": edit_dated_yesterday,
}


def verdict(tool: Tool, work: Path, environments: Path, fault: Callable[[Path], None]) -> str:
    """Is everything right after a fault and one more build?"""
    place = prepared(tool, work, environments, 1)
    try:
        place.build()
        time.sleep(2.5)
        place.build()
        fault(place.folder)
        place.build()
        return "silently wrong" if wrong_outputs(place.folder, 1) else "right"
    except RuntimeError as error:
        return " ".join(str(error).split())[:80]
    finally:
        shutil.rmtree(place.folder)


def faults(tools: list[Tool], work: Path, environments: Path) -> None:
    print(f"\n| after one more build | {' | '.join(tool.name for tool in tools)} |")
    print(f"| --- {'| --- ' * len(tools)}|")
    for name, fault in FAULTS.items():
        cells = [verdict(tool, work, environments, fault) for tool in tools]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    names = [tool.name for tool in TOOLS]
    parser.add_argument("--tools", nargs="+", choices=names, default=names)
    parser.add_argument("--robots", nargs="+", type=int, default=[1, 20])
    parser.add_argument("--rounds", type=int, default=7, help="null builds; others fewer")
    parser.add_argument("--environments", type=Path, default=Path(".bench"), metavar="DIR")
    parser.add_argument("--all", action="store_true", help="also DVC with twenty robots")
    parser.add_argument("--no-faults", action="store_true")
    arguments = parser.parse_args()
    tools = [tool for tool in TOOLS if tool.name in arguments.tools]
    for tool in tools:
        install(tool, arguments.environments.absolute())
    with tempfile.TemporaryDirectory(prefix="assetbuild-bench-") as name:
        for robots in arguments.robots:
            now = [tool for tool in tools if robots == 1 or arguments.all or not tool.slow]
            speed(now, Path(name), arguments.environments.absolute(), robots, arguments.rounds)
        if not arguments.no_faults:
            faults(tools, Path(name), arguments.environments.absolute())
    return 0


if __name__ == "__main__":
    sys.exit(main())
