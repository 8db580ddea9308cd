"""Programs in processes of their own: what crashes or hangs there ends nothing here."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

_KEPT = ("PATH", "LD_LIBRARY_PATH", "HOME", "TMPDIR")
"""Variables of ours that a child sees."""
_FIXED = {"PYTHONHASHSEED": "0", "PYTHONUTF8": "1"}


def run_child(
    command: Sequence[str], folder: Path, seconds: float, variables: Mapping[str, str]
) -> str:
    """How it ended, a verb first (`crashed with signal 11`); "" when it ended well.

    folder: where it works. variables: of its environment, beside the few that it gets of ours.
    """
    kept = {name: os.environ[name] for name in _KEPT if name in os.environ}
    try:
        child = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env=kept | _FIXED | dict(variables),
            cwd=folder,
            timeout=seconds,
        )
    except subprocess.TimeoutExpired:
        return f"took more than {seconds:g} s and was stopped"
    if child.returncode < 0:
        return f"crashed with signal {-child.returncode}"
    return f"failed: {last_line(child.stderr)}" if child.returncode else ""


def last_line(said: bytes) -> str:
    """The last of what a program said: of a traceback, the error."""
    return said.decode("utf-8", "replace").strip().rpartition("\n")[2][:400]
