"""Runs `answer(job)` of a program: in any Python, also where assetbuild is not installed.

`python _answering.py PROGRAM.py JOB.json` writes `answer.json` beside the job. An exception is the
answer of a simulator that does not take the robot.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path


def main(program: Path, job: Path) -> None:
    """Import the program and ask it."""
    for folder in (program.parent, Path(__file__).parent):
        sys.path.append(str(folder))  # last: its names hide no package
    answer = importlib.import_module(program.stem).answer
    result = answer(json.loads(job.read_text(encoding="utf-8")))
    job.with_name("answer.json").write_text(json.dumps(result), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
