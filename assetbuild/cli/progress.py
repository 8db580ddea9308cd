"""What a build shows while it runs: a live line on a terminal, plain lines elsewhere. On stderr."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from assetbuild.engine.execute import Event


class Progress(Protocol):
    """Told of each event of a build, and of what the pipeline says meanwhile."""

    def on_event(self, event: Event) -> None:
        """A step began or ended."""
        ...

    def say(self, text: str) -> None:
        """A line for the user."""
        ...


@contextmanager
def progress(name: str) -> Iterator[Progress]:
    """Live on a terminal; plain lines in CI, in files and where `NO_COLOR` asks for them."""
    live = sys.stderr.isatty() and not os.environ.get("CI") and os.environ.get("TERM") != "dumb"
    shown = LiveProgress(name) if live else PlainProgress(name)
    try:
        yield shown
    finally:
        if isinstance(shown, LiveProgress):
            shown.clear()


class PlainProgress:
    """One line for each step that ran."""

    def __init__(self, name: str) -> None:
        self._name = name

    def on_event(self, event: Event) -> None:
        """See `Progress`."""
        result = event.result
        if event.kind == "finished" and result is not None and result.status in ("ran", "failed"):
            counted = f"[{event.done}/{event.total}]"
            self.say(f"{counted} {result.status:6} {event.label}  {result.seconds:.1f} s")

    def say(self, text: str) -> None:
        """See `Progress`."""
        print(f"{self._name}: {text}", file=sys.stderr, flush=True)


class LiveProgress:
    """One line that is written over: how far, and what runs now and for how long."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._running: dict[str, float] = {}
        self._width = 0

    def on_event(self, event: Event) -> None:
        """See `Progress`."""
        if event.kind == "started":
            self._running[event.label] = time.monotonic()
        elif event.kind == "finished":
            began = self._running.pop(event.label, None)
            if began is not None and event.result is not None and event.result.seconds >= 2.0:
                self.say(f"{event.label}: {event.result.seconds:.1f} s")
        if self._running or event.kind == "started":
            self._draw(event)

    def say(self, text: str) -> None:
        """See `Progress`."""
        self.clear()
        print(f"{self._name}: {text}", file=sys.stderr, flush=True)

    def clear(self) -> None:
        """Wipe the line."""
        print(f"\r{' ' * self._width}\r", end="", file=sys.stderr, flush=True)
        self._width = 0

    def _draw(self, event: Event) -> None:
        columns = os.get_terminal_size(sys.stderr.fileno()).columns
        running = ", ".join(self._running)
        line = f"{self._name} [{event.done}/{event.total}] {running}"[: columns - 1]
        print(f"\r{line.ljust(self._width)}", end="", file=sys.stderr, flush=True)
        self._width = len(line)
