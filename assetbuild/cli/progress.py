"""What a build shows while it runs: a live line on a terminal, plain lines elsewhere. On stderr."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from assetbuild.cli.summary import shown_seconds
from assetbuild.engine.execute import Costs, Event
from assetbuild.engine.make import NodeResult
from assetbuild.engine.processes import Processes, usable_cores
from assetbuild.pipeline.opening import Opened, open_session, pin, remote_cache
from assetbuild.recipe.loader import LoadedRecipe

SLOW_S = 2.0
"""Steps that took longer leave a line of their own."""
WORTH_SAYING_S = 4.0
"""An expected time is shown from here on."""
LONG_S = 20.0
"""Steps that are expected to take longer also leave a line when they begin."""
TRUST_S = 3.0
"""So many seconds of work must have taken twice as long as expected before the rest is expected to
take one and a half times as long."""


class Progress:
    """Takes each event of a build and each message; prints a line for each step that ran."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._began = time.monotonic()
        self._forecast = Forecast(usable_cores())
        self._whole = False
        self._expected_shown = False

    def on_event(self, event: Event) -> None:
        """A step began or ended."""
        if (result := self._tried(event)) is not None:
            self._say_expected()
            seconds = shown_seconds(event.label, result.seconds)
            failed = "failed: " if result.status == "failed" else ""
            took = f", {seconds}" if seconds else ""
            self.say(f"{self._counted(event)} {failed}{event.label}{took}")
        elif event.kind == "started" and (left := self._forecast.expected_s(event.label)) >= LONG_S:
            self.say(f"{self._counted(event)} {event.label} begins, {shown_time(left)} expected")

    def say(self, text: str) -> None:
        """A line for the user."""
        print(f"{self._name}: {text}", file=sys.stderr, flush=True)

    def end(self) -> None:
        """Nothing is shown any more."""

    def _tried(self, event: Event) -> NodeResult | None:
        """The result of a step that ran or failed just now; the forecast learns from any event."""
        self._whole, result = event.whole, event.result
        if event.costs is not None:
            self._forecast.plan(event.costs)
        if event.kind != "finished" or result is None:
            return None
        self._forecast.done(event.label, result.seconds if result.status == "ran" else 0.0)
        return result if result.status in ("ran", "failed") else None

    def _counted(self, event: Event) -> str:
        """`[12/75]`; `[12/?]` while the robot is read and nobody knows how many steps follow."""
        return f"[{event.done}/{event.total if event.whole else '?'}]"

    def _say_expected(self) -> None:
        """Print it once, when all steps are known and the first of them ran."""
        left = self._forecast.left_s({})
        if self._whole and not self._expected_shown and left >= WORTH_SAYING_S:
            self._expected_shown = True
            self.say(f"{self._forecast.word} {shown_time(left)} expected")


@contextmanager
def progress(name: str) -> Iterator[Progress]:
    """Live on a terminal; plain lines in CI, in files and where `NO_COLOR` asks for them."""
    live = sys.stderr.isatty() and not os.environ.get("CI") and os.environ.get("TERM") != "dumb"
    shown = LiveProgress(name) if live else Progress(name)
    try:
        yield shown
    finally:
        shown.end()


@contextmanager
def at_work(
    loaded: LoadedRecipe, arguments: argparse.Namespace
) -> Iterator[tuple[Opened, Progress]]:
    """Open a build for verbs that have one of their own. arguments: also its jobs and cache."""
    with progress(arguments.recipe.name) as shown:
        remote = remote_cache(arguments.remote, shown.say, write=arguments.cache_write)
        lock = pin(loaded, frozen=False, say=shown.say)
        with open_session(loaded, remote=remote) as session, Processes(session) as runner:
            jobs = arguments.jobs
            yield Opened(loaded, lock, session, runner, jobs, shown.on_event), shown


class LiveProgress(Progress):
    """One line that is written over: how far, since when, how long still, and what runs."""

    def __init__(self, name: str) -> None:
        from rich.console import Console
        from rich.live import Live

        super().__init__(name)
        self._running: dict[str, float] = {}
        """Label of each step that runs -> when it began, monotonic s."""
        self._head = ""
        self._console = Console(stderr=True, highlight=False, markup=False, emoji=False)
        self._live = Live(
            console=self._console,
            get_renderable=self._line,
            refresh_per_second=2,
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
        )
        self._live.start()

    def on_event(self, event: Event) -> None:
        """See `Progress`."""
        result = self._tried(event)
        self._head = self._counted(event)
        if event.kind == "started":
            self._running |= {event.label: time.monotonic()}
        elif event.kind == "finished":
            self._running = {k: v for k, v in self._running.items() if k != event.label}
        if result is not None and result.seconds >= SLOW_S:
            self.say(f"{event.label}: {result.seconds:.1f} s")

    def say(self, text: str) -> None:
        """See `Progress`."""
        self._console.print(f"{self._name}: {text}", soft_wrap=True)

    def end(self) -> None:
        """Wipe the line; nothing is drawn any more."""
        self._live.stop()

    def _line(self) -> str:
        now = time.monotonic()
        running = {label: now - began for label, began in self._running.items()}
        if not running:
            return ""
        left = self._forecast.left_s(running)
        times = shown_time(now - self._began)
        if self._whole and left >= WORTH_SAYING_S:
            times += f", {self._forecast.word} {shown_time(left)} left"
        words = ", ".join(f"{label} {s:.0f} s" for label, s in running.items())
        return f"{self._name} {self._head} {times}: {words}"[: self._console.width - 1]


class Forecast:
    """What the steps of a graph still cost. places: steps that run at once.

    Steps that took longer than expected, on a busy or a slower machine, stretch what is left.
    """

    def __init__(self, places: int, costs: Costs = Costs()) -> None:  # noqa: B008 # frozen
        self._places, self._expected, self._took = places, TRUST_S, TRUST_S
        self.plan(costs)

    def plan(self, costs: Costs) -> None:
        """More steps are known."""
        self._seconds, self._chains = dict(costs.seconds), dict(costs.chains)
        self._guessed = costs.guessed

    def done(self, label: str, took: float = 0.0) -> None:
        """The step has ended. took: s; 0 = it was in the store, or failed."""
        expected = self._seconds.pop(label, 0.0)
        self._chains.pop(label, None)
        if took:
            self._expected, self._took = self._expected + expected, self._took + took

    def expected_s(self, label: str) -> float:
        """How long a step may take; 0 for one that has ended."""
        return self._seconds.get(label, 0.0)

    @property
    def word(self) -> str:
        """`at least` while most of what is left never ran here."""
        left = sum(self._seconds.values())
        guessed = sum(s for label, s in self._seconds.items() if label in self._guessed)
        return "at least" if guessed > left / 2.0 else "about"

    def left_s(self, elapsed: Mapping[str, float]) -> float:
        """Seconds to the end; elapsed: of the steps that run, since each began."""
        pace = self._took / self._expected
        spent = {k: min(elapsed.get(k, 0.0) / pace, s) for k, s in self._seconds.items()}
        work = sum(self._seconds.values()) - sum(spent.values())
        longest = max((c - spent.get(label, 0.0) for label, c in self._chains.items()), default=0.0)
        return pace * max(work / self._places, longest)


def shown_time(seconds: float) -> str:
    """`8 s`, `2 min 05 s`."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02} s" if minutes else f"{rest} s"
