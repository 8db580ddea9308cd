"""What a build shows while it runs: a live line on a terminal, plain lines elsewhere. On stderr."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from assetbuild.cli.public import shown_seconds
from assetbuild.engine.execute import Event

SLOW_S = 2.0
"""Steps that took longer leave a line of their own."""


class Progress:
    """Told of each event of a build and of what is said; a line for each step that ran."""

    def __init__(self, name: str) -> None:
        self._name = name

    def on_event(self, event: Event) -> None:
        """A step began or ended."""
        result = event.result
        if event.kind == "finished" and result is not None and result.status in ("ran", "failed"):
            counted = f"[{event.done}/{event.total}]"
            seconds = shown_seconds(event.label, result.seconds)
            self.say(f"{counted} {result.status:6} {event.label}  {seconds}".rstrip())

    def say(self, text: str) -> None:
        """A line for the user."""
        print(f"{self._name}: {text}", file=sys.stderr, flush=True)

    def end(self) -> None:
        """Nothing is shown any more."""


@contextmanager
def progress(name: str) -> Iterator[Progress]:
    """Live on a terminal; plain lines in CI, in files and where `NO_COLOR` asks for them."""
    live = sys.stderr.isatty() and not os.environ.get("CI") and os.environ.get("TERM") != "dumb"
    shown = LiveProgress(name) if live else Progress(name)
    try:
        yield shown
    finally:
        shown.end()


@dataclass(frozen=True)
class _Running:
    """A step that runs: since when (monotonic s), and how many steps wait for it."""

    label: str
    began: float
    waiting: int


class LiveProgress(Progress):
    """One line that is written over: how far, what runs and for how long, what waits for it."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._running: dict[str, _Running] = {}
        self._done = self._total = self._width = 0
        self._turn = threading.Lock()
        self._over = threading.Event()
        self._clock = threading.Thread(target=self._tick, daemon=True)
        self._clock.start()

    def on_event(self, event: Event) -> None:
        """See `Progress`."""
        self._done, self._total = event.done, event.total
        if event.kind == "started":
            running = _Running(event.label, time.monotonic(), event.waiting)
            self._running |= {event.label: running}
        elif event.kind == "finished":
            self._running = {k: v for k, v in self._running.items() if k != event.label}
            result = event.result
            ran = result is not None and result.status in ("ran", "failed")
            if result is not None and ran and result.seconds >= SLOW_S:
                self.say(f"{event.label}: {result.seconds:.1f} s")
        if self._running:
            self._draw()

    def say(self, text: str) -> None:
        """See `Progress`."""
        with self._turn:
            self._wipe()
            super().say(text)

    def end(self) -> None:
        """Wipe the line; nothing is drawn any more."""
        self._over.set()
        self._clock.join()
        with self._turn:
            self._wipe()

    def _tick(self) -> None:
        """The seconds go on while a step runs."""
        while not self._over.wait(1.0):
            if self._running:
                self._draw()

    def _wipe(self) -> None:
        print(f"\r{' ' * self._width}\r", end="", file=sys.stderr, flush=True)
        self._width = 0

    def _draw(self) -> None:
        with self._turn:
            columns = os.get_terminal_size(sys.stderr.fileno()).columns
            head = f"{self._name} [{self._done}/{self._total}] "
            line = (head + running_words(list(self._running.values()), time.monotonic()))[
                : columns - 1
            ]
            print(f"\r{line.ljust(self._width)}", end="", file=sys.stderr, flush=True)
            self._width = len(line)


def running_words(running: Sequence[_Running], now: float) -> str:
    """`auto trunk 12 s (31 wait for it), pictures 3 s`: first what most others wait for."""
    words = []
    for step in sorted(running, key=lambda step: (-step.waiting, step.began)):
        seconds = now - step.began
        text = f"{step.label} {seconds:.0f} s" if seconds >= 1.0 else step.label
        words.append(f"{text} ({step.waiting} wait for it)" if step.waiting else text)
    return ", ".join(words)
