"""A wheel from the user's package index, through pip, pinned to the byte. The one network step."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

from assetbuild.engine.digest import digest_file
from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import (
    AssetBuildError,
    LockError,
    MachineError,
    SourceError,
    did_you_mean,
)
from assetbuild.findings import Finding

OnLine = Callable[[str], None]

_DEFAULTS = {"PIP_RETRIES": "2", "PIP_TIMEOUT": "15"}
"""Only where the user says nothing: without a network an answer should come soon."""
_FORCED = {
    "PIP_DISABLE_PIP_VERSION_CHECK": "1",
    "PIP_NO_INPUT": "1",
    "PIP_NO_COLOR": "1",
    "PYTHONUNBUFFERED": "1",
    "PYTHONIOENCODING": "utf-8",
}
_UNREACHABLE = re.compile(
    "name resolution|NameResolution|not known|new ?connection|timeout|unreachable|ProxyError"
    "|refused|connection error",
    re.IGNORECASE,
)


class Fetch(Step):
    """`archive`: the wheel `filename` of `name==release`, with the digest that the lock pins."""

    usual_s = 10.0
    outputs = ("archive",)
    network = True
    in_parent = True
    limits: ClassVar[Limits] = Limits(wall_s=3600)

    name: str
    """Distribution on the index."""
    release: str
    """Its version; `version` is the step's own."""
    filename: str
    """Name of the wheel."""
    sha256: str
    """64 hex digits."""

    def run(self, files: Files) -> Iterator[Finding]:
        """LockError: other bytes; SourceError: no such wheel; MachineError: no index in reach."""
        # Beside the result, so that moving the file is a rename.
        with TemporaryDirectory(prefix=".fetch-", dir=files.outputs) as folder:
            wheel = downloaded_wheel(self.name, self.release, Path(folder))
            if wheel.name != self.filename:
                raise LockError(
                    f"{self.name}=={self.release}: the index gives `{wheel.name}`, "
                    f"the lock pins `{self.filename}`",
                    hint="run `assetbuild lock` if the change is wanted",
                )
            digest = digest_file(wheel)
            if digest != self.sha256:
                raise LockError(
                    f"{self.filename}: sha256 is {digest}, the lock pins {self.sha256}",
                    hint="the index gives other bytes than when the lock was written; "
                    "run `assetbuild lock` only if you trust the change",
                )
            wheel.replace(files.outputs / "archive")
        yield from ()


def downloaded_wheel(name: str, version: str, folder: Path, on_line: OnLine | None = None) -> Path:
    """The wheel that the user's pip chooses, in `folder`."""
    wanted = f"{name}=={version}"
    command = [sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary=:all:"]
    command += ["--progress-bar=off", "--dest", str(folder), "--", wanted]
    # The user's environment, so that index, proxy and certificate settings hold.
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    code, lines = _run(command, _DEFAULTS | kept | _FORCED, on_line)
    if code != 0:
        raise _reason(wanted, lines)
    wheels = sorted(folder.glob("*.whl"))
    if len(wheels) != 1:
        raise MachineError(f"{wanted}: pip left {len(wheels)} wheels instead of one")
    return wheels[0]


def _run(
    command: list[str], environment: dict[str, str], on_line: OnLine | None
) -> tuple[int, list[str]]:
    """Exit code and lines of a child process; it dies with us when we are interrupted."""
    lines = []
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=environment,
        encoding="utf-8",
        errors="replace",
    ) as child:
        try:
            for line in child.stdout or ():
                if text := line.strip():
                    lines.append(text)
                    if on_line is not None:
                        on_line(text)
        except BaseException:
            child.kill()
            raise
    return child.returncode, lines


def _reason(wanted: str, lines: list[str]) -> AssetBuildError:
    """One sentence for a failed pip, by who must act."""
    text = "\n".join(lines)
    if "No module named pip" in text:
        return MachineError(
            "pip is not installed beside assetbuild",
            hint="install it with `uv pip install pip` or `python -m ensurepip`",
        )
    if "No space left on device" in text:
        return MachineError(f"{wanted}: no space left on the disk for the download")
    if _UNREACHABLE.search(text):
        # The innermost reason, as in `NewConnectionError("HTTPConnection(...): REASON")`.
        reasons = re.findall(r"[>)]: ([^'\"]+)['\"]", text)
        trouble = f": {reasons[-1].strip()[:200]}" if reasons else ""
        return MachineError(
            f"{wanted}: no package index could be reached{trouble}",
            hint="check the network, `pip config list` and the PIP_* variables",
        )
    if "No matching distribution found" in text or "Could not find a version" in text:
        listed = re.search(r"from versions: ([^)]*)\)", text)
        versions = (
            [v.strip() for v in listed[1].split(",") if v.strip() != "none"] if listed else []
        )
        hint = "check the name and `pip config list`; only wheels for this Python are taken"
        near = did_you_mean(wanted.partition("==")[2], versions) if any(versions) else hint
        return SourceError(f"no wheel of {wanted} on the index", hint=near)
    errors = [line.removeprefix("ERROR:").strip() for line in lines if line.startswith("ERROR:")]
    last = [*errors, *lines[-1:], "pip printed nothing"][0]
    return MachineError(f"{wanted}: pip failed: {last[:200]}")
