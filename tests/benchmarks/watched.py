"""`assetbuild` with child processes that note what they spend, for `cold`. First argument: FILE.

Each line of FILE is the JSON of (`step`, label, CPU seconds of its imports and of all that came
before it began), of (`worker`, its modules, CPU seconds of the worker itself), or of (`main`, "",
CPU seconds of the process that builds).
"""

from __future__ import annotations

import builtins
import json
import sys
import time
from pathlib import Path
from typing import Any, NoReturn


def main() -> int:
    """The command line, with the hook below in the process that forks all others."""
    from assetbuild.__main__ import main
    from assetbuild.engine import children

    log = sys.argv.pop(1)
    hook = f"from tests.benchmarks.watched import watch; watch({log!r}); "
    children.BOOT = children.BOOT.replace("worker.main()", hook + "worker.main()")
    try:
        return main()
    finally:
        note(log, "main", "", time.process_time())


def note(log: str, *row: object) -> None:
    """Add a line to the file."""
    with Path(log).open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def watch(log: str) -> None:
    """Count the time in imports, of which one may import more, and note it after each step."""
    from assetbuild.engine import wire, worker

    spent, depth = 0.0, 0
    load, perform, leave = builtins.__import__, wire.perform, worker.Zygote.leave

    def counted(*args: Any, **more: Any) -> Any:  # Any: as `__import__`
        nonlocal depth, spent
        depth, began = depth + 1, time.process_time()
        try:
            return load(*args, **more)
        finally:
            depth -= 1
            if not depth:
                spent += time.process_time() - began

    def performed(step: Any, files: Any, label: str, limits: Any) -> Any:  # Any: as `perform`
        nonlocal spent
        before, spent = time.process_time(), 0.0
        made = perform(step, files, label, limits)
        note(log, "step", label, before + spent)
        return made

    def left(self: Any) -> NoReturn:  # Any: worker.Zygote
        note(log, "worker", " ".join(self.config["preload"]), time.process_time())
        leave(self)

    builtins.__import__, wire.perform = counted, performed
    worker.Zygote.leave = left  # type: ignore[method-assign]


if __name__ == "__main__":
    sys.exit(main())
