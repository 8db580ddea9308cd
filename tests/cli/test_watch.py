"""`watch`: builds again when a file changes that the build reads, and ends by Ctrl-C."""

from __future__ import annotations

import queue
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator

import pytest

from .conftest import Place, hear_ctrl_c


class Watching:
    """`assetbuild watch` in a process; its lines, both streams together."""

    def __init__(self, legs: Place) -> None:
        self.process = subprocess.Popen(
            legs.command("watch", "legs.yaml"),
            cwd=legs.folder,
            env=legs.env(CI="1", PYTHONUNBUFFERED="1"),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            preexec_fn=hear_ctrl_c,
        )
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line)

    def until(self, beginning: str) -> str:
        """All lines up to the first that has these words."""
        text = ""
        while beginning not in text:
            text += self._lines.get(timeout=120)
        return text

    def waits(self) -> str:
        return self.until("watching ")


@pytest.fixture
def watched() -> Iterator[Callable[[Place], Watching]]:
    started = []

    def watch(legs: Place) -> Watching:
        started.append(Watching(legs))
        return started[-1]

    yield watch
    for each in started:
        each.process.kill()
        each.process.wait()


@pytest.mark.slow
def test_it_follows_recipe_and_source_and_survives_mistakes(legs: Place, watched):
    watching = watched(legs)
    assert " ran, 0 cached" in watching.waits()
    legs.edit("kp: 20", "kp: 30")
    told = watching.waits()
    assert "changed: `legs.yaml`" in told
    assert "] control" in told
    assert "] urdf" not in told  # it holds no gain
    assert "] read_urdf" not in told
    legs.edit("kp: 30", "kpp: 30")
    told = watching.waits()
    assert "legs.yaml:7:" in told
    assert "actuators[0].kpp: unknown key" in told
    assert "watching 1 file;" in told  # the recipe alone
    legs.edit("kpp: 30", "kp: 30")
    assert " 0 ran, " in watching.waits()
    legs.urdf.write_text(legs.urdf.read_text().replace('mass value="6"', 'mass value="7"'))
    told = watching.waits()
    assert "changed: `four_legs.urdf`" in told
    assert "] read_urdf" in told
    watching.process.send_signal(signal.SIGINT)
    assert watching.process.wait(10) == 0
    assert watching.until("stopped watching")


def test_a_source_that_breaks_is_watched_on(warm_legs: Place, watched):
    watching = watched(warm_legs)
    watching.waits()
    whole = warm_legs.urdf.read_text()
    warm_legs.urdf.write_text(whole[:200])
    assert "error: " in watching.waits()
    warm_legs.urdf.write_text(whole)
    assert "ready for training: yes" in watching.waits()


@pytest.mark.slow
def test_ctrl_c_while_it_builds_is_an_interrupted_build(legs: Place, watched):
    watching = watched(legs)
    watching.until(": [1/")
    watching.process.send_signal(signal.SIGINT)
    assert watching.process.wait(20) == 130
