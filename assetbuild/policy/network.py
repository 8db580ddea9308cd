"""A policy's network in a process of its own: what it takes and gives, and what it answers."""

from __future__ import annotations

import importlib.util
import json
import math
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, Self

import numpy as np

from assetbuild.errors import MachineError, UsageError
from assetbuild.robot.pose import Array
from assetbuild.simulators.children import environment

BEYOND_IMPORTS = ("assetbuild.policy._network_child", "onnxruntime")
LARGEST_BYTES = 512 << 20
"""Policies have a few megabytes."""
SECONDS = 60.0
"""To load a network, and to answer."""
LONGEST_LINE = 64 << 20
"""Characters of an answer."""
Shapes = tuple[tuple[str, tuple[int, ...]], ...]


class Network:
    """A loaded network; a context manager. inputs, outputs: (name, shape).

    Where several inputs come back as outputs, as the state of a recurrent network does, they are
    fed with what came out last: `h_in` with `h_out`. MachineError without onnxruntime, UsageError
    for a file that it does not take.
    """

    def __init__(self, path: Path) -> None:
        _refuse(path)
        program = Path(__file__).with_name("_network_child.py")
        command = [sys.executable, "-P", "-s", str(program), str(path.absolute())]
        self._path = path
        self._child = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            encoding="ascii",
            env=environment({"PYTHONPATH": ":".join(part for part in sys.path if part)}),
            cwd=path.absolute().parent,
        )
        description: dict[str, Any] = self._answer_to("") or {  # Any: JSON
            "error": f"it crashed, or took more than {SECONDS:g} s or too much memory"
        }
        if "error" in description:
            self.close()
            raise UsageError(f"`{path.name}` is no network that can be run: {description['error']}")
        self.inputs: Shapes = tuple((name, tuple(shape)) for name, shape in description["inputs"])
        self.outputs: Shapes = tuple((name, tuple(shape)) for name, shape in description["outputs"])
        self.metadata: dict[str, str] = description["metadata"]
        unfed = [n for n, _ in self.inputs[1:] if _answer(n) not in dict(self.outputs)]
        if unfed:
            self.close()
            raise UsageError(
                f"`{path.name}` also takes `{unfed[0]}`, which nothing here computes",
                hint="export it with the observation as its input; a recurrent state `h_in` needs "
                "an output `h_out`",
            )
        self.reset()

    def _answer_to(self, line: str) -> Any:  # Any: as above
        """What the child says to a line; None where it ended, or took too long."""
        send, receive = self._child.stdin, self._child.stdout
        assert send is not None and receive is not None  # noqa: S101 # as opened
        patience = threading.Timer(SECONDS, self._child.kill)
        patience.start()
        try:
            send.write(line)
            send.flush()
            return json.loads(receive.readline(LONGEST_LINE))
        except (OSError, ValueError):  # it ended, or its end of a pipe is closed
            return None
        finally:
            patience.cancel()

    def reset(self) -> None:
        """Forget what a recurrent network remembers."""
        self._state = {name: np.zeros(math.prod(shape)) for name, shape in self.inputs[1:]}

    @property
    def sees(self) -> int:
        """How many numbers its first input takes."""
        return math.prod(self.inputs[0][1])

    @property
    def acts(self) -> int:
        """How many numbers its first output gives."""
        return math.prod(self.outputs[0][1])

    def act(self, observation: Array) -> Array:
        """(n,) the action for an observation. UsageError where the network fails."""
        fed = [row.tolist() for row in (observation, *self._state.values())]
        rows = self._answer_to(json.dumps(fed) + "\n")
        if rows is None:
            raise UsageError(f"`{self._path.name}`: the network does not answer an observation")
        by_name = {name: row for (name, _), row in zip(self.outputs, rows, strict=True)}
        self._state = {name: np.array(by_name[_answer(name)]) for name in self._state}
        return np.array(rows[0], float)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        self._child.kill()
        self._child.communicate()


def _answer(state: str) -> str:
    """The output with the next value of a recurrent state."""
    return state.replace("_in", "_out") if "_in" in state else ""


def _refuse(path: Path) -> None:
    if importlib.util.find_spec("onnxruntime") is None:
        raise MachineError(
            "a policy's network needs onnxruntime", hint="pip install 'assetbuild[policy]'"
        )
    try:
        size = path.stat().st_size
    except OSError as error:
        raise UsageError(f"cannot read `{path}`: {error.strerror}") from None
    if size > LARGEST_BYTES:
        raise UsageError(
            f"`{path.name}` has {size >> 20} MB; a policy's network may have {LARGEST_BYTES >> 20}"
        )
