"""`assetbuild` with child processes that note what they spend, for `cold`. First argument: FILE.

Each line of FILE is the JSON of (`worker`, its modules, CPU seconds of the worker itself), or of
(`main`, "", CPU seconds of the process that builds).
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any, NoReturn


def main() -> int:
    """The command line, with the hook below in the process that forks all others."""
    from assetbuild.__main__ import main
    from assetbuild.engine import doors

    log = sys.argv.pop(1)
    hook = f"from tests.benchmarks.watched import watch; watch({log!r}); "
    doors.BOOT = doors.BOOT.replace("worker.main()", hook + "worker.main()")
    try:
        return main()
    finally:
        note(log, "main", "", time.process_time())


def note(log: str, *row: object) -> None:
    """Add a line to the file."""
    with Path(log).open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def watch(log: str) -> None:
    """Note a worker's time when it ends."""
    from assetbuild.engine import worker

    leave = worker.Zygote.leave

    def left(self: Any) -> NoReturn:  # Any: worker.Zygote
        note(log, "worker", " ".join(self.config["preload"]), time.process_time())
        leave(self)

    worker.Zygote.leave = left  # type: ignore[method-assign]


if __name__ == "__main__":
    sys.exit(main())
