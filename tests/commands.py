"""`assetbuild` commands in processes of their own, forked from one that has imported the program.

Python takes 0.7 s of CPU to import what a command needs; a test run starts hundreds of commands. A
fork has its own folder, environment, streams and exit code, and runs the program to its end. What
a fork cannot show starts a Python of its own: another hash seed, locale or `sitecustomize`.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import json
import os
import pkgutil
import select
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NoReturn

READ_BY_PYTHON = ("PYTHON", "LANG", "LC_")
"""Beginnings of what an interpreter reads when it starts: a fork comes too late for them."""


def command(*words: str) -> list[str]:
    """What a shell would start."""
    return [sys.executable, "-m", "assetbuild", *words]


def run(
    words: Sequence[str], cwd: Path, env: Mapping[str, str], timeout: float = 300.0
) -> subprocess.CompletedProcess[str]:
    """`assetbuild WORDS...` to its end. timeout: s, wall."""
    if _needs_a_python_of_its_own(env):
        return subprocess.run(
            command(*words), cwd=cwd, env=env, capture_output=True, text=True, timeout=timeout
        )
    with tempfile.TemporaryDirectory(prefix="command-") as folder:
        streams = [Path(folder) / name for name in ("out", "err")]
        job = {"words": list(words), "cwd": str(cwd), "env": dict(env)}
        code = _forker().run({**job, "streams": [str(path) for path in streams]}, timeout)
        out, err = (path.read_text(encoding="utf-8", errors="replace") for path in streams)
    return subprocess.CompletedProcess(shlex.join(["assetbuild", *words]), code, out, err)


def is_alive(pid: int) -> bool:
    """Whether the process runs; one that ended and that nobody waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def _needs_a_python_of_its_own(env: Mapping[str, str]) -> bool:
    names = {name for name in (*env, *os.environ) if name.startswith(READ_BY_PYTHON)}
    return any(env.get(name) != os.environ.get(name) for name in names)


@cache
def _forker() -> Forker:
    return Forker()


class Forker:
    """The process that has imported the program; one per process that tests run in."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-P", __file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,  # Ctrl-C is for the tests; it ends with them
        )
        atexit.register(self.close)

    def run(self, job: dict[str, object], timeout: float) -> int:
        """The exit code of one job; a signal that ended it as a negative number."""
        self.process.stdin.write(json.dumps(job).encode() + b"\n")
        pid = self._answer(10.0 + timeout)
        try:
            return self._answer(timeout)
        except TimeoutError:
            os.kill(pid, signal.SIGKILL)
            self._answer(60.0)
            raise

    def _answer(self, timeout: float) -> int:
        pipe = self.process.stdout
        if not select.select([pipe], [], [], timeout)[0]:
            raise TimeoutError(f"the command is not done after {timeout:g} s")
        line = pipe.readline()
        assert line, "the process that starts commands has ended"
        return int(line)

    def close(self) -> None:
        """End its input; it leaves by itself."""
        self.process.stdin.close()
        self.process.wait(10)


def serve() -> None:
    """Import the program, then fork a process per line of standard input."""
    sys.path.insert(0, str(Path(__file__).parent))
    from workers import Ready, all_steps, kind_of

    sys.path.pop(0)
    from assetbuild import checks, cli, targets
    from assetbuild.engine import children

    importlib.import_module("assetbuild.pipeline")
    for room in (cli, checks, targets):
        for module in pkgutil.iter_modules(room.__path__, f"{room.__name__}."):
            importlib.import_module(module.name)
    steps = all_steps()
    _read_the_code_of_steps(steps)
    workers = Ready()
    for kind in map(kind_of, steps):
        workers.door(kind)
    children.Children.door = lambda self, kind: workers.door(kind)
    children.begin = lambda **_: None
    gc.freeze()  # so that the end of a fork does not touch, and copy, all of it
    answers = os.dup(1)
    for line in iter(sys.stdin.buffer.readline, b""):
        pid = os.fork()
        if pid == 0:
            os.close(answers)
            _become(json.loads(line))
        os.write(answers, f"{pid}\n".encode())
        status = os.waitpid(pid, 0)[1]
        os.write(answers, f"{os.waitstatus_to_exitcode(status)}\n".encode())
    workers.close()


def _read_the_code_of_steps(steps: list[type]) -> None:
    """Once for all forks; each would read the package again for its own empty store."""
    from assetbuild.engine.code import Code

    code = Code()
    for step in steps:
        code.of(step)


def _become(job: dict[str, list[str]]) -> NoReturn:
    """In the fork: the folder, environment and streams of the job, then the program."""
    os.environ.clear()
    os.environ.update(job["env"])
    time.tzset()
    os.chdir(str(job["cwd"]))
    for number, path in ((0, os.devnull), (1, job["streams"][0]), (2, job["streams"][1])):
        opened = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        os.dup2(opened, number)
        os.close(opened)
    sys.path.insert(0, str(job["cwd"]))  # as `python -m` does
    sys.argv = ["assetbuild", *job["words"]]
    from assetbuild.__main__ import main

    sys.exit(main())


if __name__ == "__main__":
    serve()
