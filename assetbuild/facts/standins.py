"""What a trainer's module says to the trainer, recorded without it: see `_standins_child`."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import assetbuild
from assetbuild.engine.confine import bare_environment
from assetbuild.errors import UsageError
from assetbuild.facts._standins_child import CLASS

SECONDS = 20.0
"""Wall-clock limit; the largest module of the library takes 0.1 s."""
MOST_BYTES = 64 << 20
PROGRAM = (
    "import sys; sys.path.append(sys.argv[1]); "
    "from assetbuild.facts import _standins_child; _standins_child.main()"
)
Record = dict[str, Any]  # Any: JSON


def recorded(path: Path, calls: Sequence[str] = ()) -> Record:
    """The constants of a module by name, and `name()` -> what each of `calls` returns.

    A call of anything that is imported is a table of its keyword arguments, with CLASS, ARGUMENTS
    and LINE; tuples are lists. UsageError for what cannot be executed.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise UsageError(f"cannot read `{path}`: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError(f"`{path}` is no UTF-8 text") from None
    output = _run({"name": path.name, "text": text, "calls": calls})
    try:
        answer: Record = json.loads(output)
    except ValueError:
        reason = f"it crashed, or took more than {SECONDS:g} s or too much memory"
        raise UsageError(f"`{path.name}` cannot be executed: {reason}") from None
    if "error" in answer:
        raise UsageError(f"{path.name}:{answer['line']}: {answer['error']}")
    record: Record = answer["record"]
    return record


def _run(job: Record) -> bytes:
    """The output of the child; it may be of any length, so not all is read."""
    home = str(Path(assetbuild.__file__).parent.parent)
    command = [sys.executable, "-I", "-S", "-c", PROGRAM, home]
    with (
        tempfile.TemporaryDirectory(prefix="assetbuild-module-") as folder,
        tempfile.TemporaryFile() as asked,
    ):
        asked.write(json.dumps(job).encode())
        asked.seek(0)
        with subprocess.Popen(
            command,
            stdin=asked,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=bare_environment(),
            cwd=folder,
        ) as child:
            timer = threading.Timer(SECONDS, child.kill)
            timer.start()
            output = child.stdout.read(MOST_BYTES) if child.stdout else b""
            timer.cancel()
            child.kill()
    return output


# --- reading a record -------------------------------------------------------------------------


def table_of(value: object) -> Record:
    """A table or a call; empty of anything else."""
    return value if isinstance(value, dict) else {}


def class_of(value: object) -> str:
    """The last name of what was called: `EntityCfg`; nothing of anything else."""
    return str(table_of(value).get(CLASS, "")).rpartition(".")[2]


def words_of(value: object) -> tuple[str, ...]:
    """A text or a list of texts."""
    listed = value if isinstance(value, list) else [value]
    return tuple(item for item in listed if isinstance(item, str))
