"""A list of robots through `init` and `build`, as a Markdown table and as JSON lines.

    python -m tests.corpus -o table.md [--list example|wide|FILE] [--half a|b] [--jobs N]

Collision is hulls of the source's meshes, whatever `init` proposes; `--as-written` keeps that. The
lists: see `lists.py`.
`example` needs `--data FOLDER` or $ASSETBUILD_TEST_DATA (a folder that holds
`example-robot-data/robots`), else the wheel is fetched once with pip. `wide`, or a list like
`wide.yaml`, needs `--sources FOLDER`, where the repositories and packages lie or are put by
`--fetch`. `--half b` is for the end of a piece of work: nobody looks at it before.

Each robot has a process, a time limit and a memory limit of its own. Its row is appended to
`<table>.jsonl` at once, so that a run that was stopped goes on where it was; `--again` forgets.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock

from tests.corpus.lists import WIDE as WIDE_LIST
from tests.corpus.lists import Robot, data_root, example, fetch, others, wide
from tests.corpus.one import SECONDS
from tests.corpus.table import summary, table

JUDGES_SECONDS = 300
"""More, for the judges, who are not timed."""


def main() -> int:
    options = arguments()
    rows_file = options.out.with_suffix(".jsonl")
    rows = {} if options.again else rows_in(rows_file)
    rows_file.write_text("".join(map(line_of, rows.items())), encoding="utf-8")
    with tempfile.TemporaryDirectory(prefix="corpus-") as scratch:
        work = (options.work or Path(scratch)).resolve()
        robots = chosen(options, work)
        writing = Lock()

        def do(robot: Robot) -> None:
            row = in_a_child(robot, work, options.seconds, hulls=not options.as_written)
            print(f"{robot.name}: {row['result']} ({row['seconds']:.0f} s)", flush=True)
            with writing:
                rows[robot.name] = row
                with rows_file.open("a", encoding="utf-8") as lines:
                    lines.write(line_of((robot.name, row)))
                options.out.write_text(table(rows, options.list), encoding="utf-8")

        left = [robot for robot in robots if robot.name not in rows or options.only]
        with ThreadPoolExecutor(options.jobs) as pool:
            list(pool.map(do, left))
    options.out.write_text(table(rows, options.list), encoding="utf-8")
    print(summary(rows))
    return 0


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=Path("corpus.md"))
    parser.add_argument("--list", default="example", help="example, wide, or a file like wide.yaml")
    parser.add_argument("--half", choices=["a", "b"], default="", help="of the wide list")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="parts of the robots' names")
    parser.add_argument("--jobs", type=int, default=1, help="robots at a time")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="for init and build")
    parser.add_argument("--data", type=Path, help="of the list `example`")
    parser.add_argument("--sources", type=Path, help="of the wide list")
    parser.add_argument("--fetch", action="store_true", help="fetch the sources that are missing")
    parser.add_argument("--as-written", action="store_true", help="collision as `init` proposes it")
    parser.add_argument("--again", action="store_true", help="forget earlier results")
    parser.add_argument("--work", type=Path, help="keep recipes and bundles here")
    options = parser.parse_args()
    if options.list != "example" and not options.sources:
        parser.error("--sources FOLDER: where the repositories and packages lie")
    return options


def chosen(options: argparse.Namespace, work: Path) -> list[Robot]:
    """The robots of the list, of the half and of the names that were asked for."""
    if options.list == "example":
        root = data_root(options.data)
        robots = example(root) + others(root, work)
    else:
        list_file = WIDE_LIST if options.list == "wide" else Path(options.list)
        if options.fetch:
            fetch(options.sources, list_file)
        robots = wide(options.sources, list_file, options.half)
    parts = options.only or [""]
    return [robot for robot in robots if any(part in robot.name for part in parts)]


def rows_in(file: Path) -> dict[str, dict]:
    """By the robot's name; the last line may be half a line, when the run was killed."""
    rows: dict[str, dict] = {}
    for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else []:
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        rows[row.pop("robot")] = row
    return rows


def line_of(row: tuple[str, dict]) -> str:
    return json.dumps({"robot": row[0], **row[1]}) + "\n"


def in_a_child(robot: Robot, work: Path, seconds: float, *, hulls: bool = True) -> dict:
    """The robot's row; a child that dies or hangs is an outcome, too."""
    if not robot.file.is_file():
        note = f"file: there is no {robot.file.name}"
        return {"result": "left out", "cause": "file", "note": note, "seconds": 0.0}
    given = {
        "name": robot.name,
        "file": str(robot.file.absolute()),
        "root": str(robot.root.absolute()),
        "args": robot.args,
        "hulls": hulls,
        "work": str(work.absolute()),
        "seconds": seconds,
    }
    started = time.monotonic()
    with subprocess.Popen(
        [sys.executable, "-m", "tests.corpus.one"],
        cwd=Path(__file__).parents[2],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    ) as child:
        try:
            out, error = child.communicate(json.dumps(given), timeout=seconds + JUDGES_SECONDS)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            out, error = "", "no end"
    if child.returncode == 0:
        return json.loads(out.splitlines()[-1])
    return {
        "result": "failed",
        "cause": "runner: " + ("time" if error == "no end" else f"exit code {child.returncode}"),
        "note": (error.strip().splitlines() or [""])[-1][:300],
        "seconds": round(time.monotonic() - started, 1),
    }


if __name__ == "__main__":
    sys.exit(main())
