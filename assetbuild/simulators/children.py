"""Programs in processes of their own: what crashes or hangs there ends nothing here."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from assetbuild.engine.confine import bare_environment

_KEPT = ("PATH", "HOME", "TMPDIR")
"""Variables of ours that a child sees, besides what any interpreter needs."""
_RUNNER = Path(__file__).with_name("_answering.py")
BEYOND_IMPORTS = ("assetbuild.simulators._answering", "assetbuild.simulators._moving")


def ask(
    python: Path,
    program: Path,
    job: Mapping[str, object],
    folder: Path,
    seconds: float,
    variables: Mapping[str, str] = MappingProxyType({}),
) -> tuple[dict[str, object] | None, str]:
    """(what `answer(job)` of a program returned, "") or (None, why it returned nothing).

    folder: private to it, where it works. variables: of its environment, beside the few of ours.
    """
    asked, answer = folder / "job.json", folder / "answer.json"
    asked.write_text(json.dumps(job), encoding="utf-8")
    answer.unlink(missing_ok=True)
    command = [str(python), "-P", "-s", str(_RUNNER), str(program), str(asked)]
    child = run(command, folder, seconds, variables)
    if child.returncode < 0:
        return None, f"it crashed with signal {-child.returncode}"
    if child.returncode:  # an exception of the program speaks for itself
        return None, last_line(child.stderr)
    if not answer.exists():
        return None, "it wrote no answer"
    return json.loads(answer.read_bytes()), ""


def run(
    command: Sequence[str],
    folder: Path,
    seconds: float,
    variables: Mapping[str, str] = MappingProxyType({}),
) -> subprocess.CompletedProcess[bytes]:
    """Run a program in a folder; one that takes too long fails, and its last line says so."""
    try:
        return subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            env=environment(variables),
            cwd=folder,
            timeout=seconds,
        )
    except subprocess.TimeoutExpired:
        why = f"it took more than {seconds:g} s and was stopped"
        return subprocess.CompletedProcess(command, 1, b"", why.encode())


def environment(variables: Mapping[str, str] = MappingProxyType({})) -> dict[str, str]:
    """What a child sees: a few variables of ours, and its own."""
    kept = {name: os.environ[name] for name in _KEPT if name in os.environ}
    return bare_environment() | kept | dict(variables)


def last_line(output: bytes) -> str:
    """The last of what a program said: of a traceback, the error."""
    return output.decode("utf-8", "replace").strip().rpartition("\n")[2][:400]
