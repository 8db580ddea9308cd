"""What a build shows while it runs: a live line on a terminal, plain lines elsewhere. On stderr."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from assetbuild.cli.summary import shown_seconds
from assetbuild.engine.execute import Costs, Event
from assetbuild.engine.processes import usable_cores

SLOW_S = 2.0
"""Steps that took longer leave a line of their own."""
WORTH_SAYING_S = 4.0
"""An expected time is shown from here on."""
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
        self._expected_said = False

    def on_event(self, event: Event) -> None:
        """A step began or ended."""
        self._note(event)
        result = event.result
        if event.kind == "finished" and result is not None and result.status in ("ran", "failed"):
            self._say_expected()
            seconds = shown_seconds(event.label, result.seconds)
            failed = "failed: " if result.status == "failed" else ""
            words = f"{failed}{step_words(event.label)}"
            self.say(f"{self._counted(event)} {words}{f', {seconds}' if seconds else ''}")

    def say(self, text: str) -> None:
        """A line for the user."""
        print(f"{self._name}: {text}", file=sys.stderr, flush=True)

    def end(self) -> None:
        """Nothing is shown any more."""

    def _note(self, event: Event) -> None:
        self._whole = event.whole
        if event.costs is not None:
            self._forecast.plan(event.costs)
        elif event.kind == "finished":
            ran = event.result is not None and event.result.status == "ran"
            self._forecast.done(event.label, event.result.seconds if event.result and ran else 0.0)

    def _counted(self, event: Event) -> str:
        """`[12/75]`; `[12/?]` while the robot is read and nobody knows how many steps follow."""
        return f"[{event.done}/{event.total if event.whole else '?'}]"

    def _say_expected(self) -> None:
        """Once, when all steps are known and the first of them ran."""
        left = self._forecast.left_s({})
        if self._whole and not self._expected_said and left >= WORTH_SAYING_S:
            self._expected_said = True
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


@dataclass(frozen=True)
class Running:
    """A step that runs: since when (monotonic s), and how many steps wait for it."""

    label: str
    began: float
    waiting: int


class LiveProgress(Progress):
    """One line that is written over: how far, since when, how long still, and what runs."""

    def __init__(self, name: str) -> None:
        from rich.console import Console
        from rich.live import Live

        super().__init__(name)
        self._running: dict[str, Running] = {}
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
        self._note(event)
        self._head = self._counted(event)
        if event.kind == "started":
            running = Running(event.label, time.monotonic(), event.waiting)
            self._running |= {event.label: running}
        elif event.kind == "finished":
            self._running = {k: v for k, v in self._running.items() if k != event.label}
            result = event.result
            ran = result is not None and result.status in ("ran", "failed")
            if result is not None and ran and result.seconds >= SLOW_S:
                self.say(f"{step_words(event.label)}: {result.seconds:.1f} s")

    def say(self, text: str) -> None:
        """See `Progress`."""
        self._console.print(f"{self._name}: {text}", soft_wrap=True)

    def end(self) -> None:
        """Wipe the line; nothing is drawn any more."""
        self._live.stop()

    def _line(self) -> str:
        running, now = list(self._running.values()), time.monotonic()
        if not running:
            return ""
        left = self._forecast.left_s({step.label: now - step.began for step in running})
        times = shown_time(now - self._began)
        if self._whole and left >= WORTH_SAYING_S:
            times += f", {self._forecast.word} {shown_time(left)} left"
        head = f"{self._name} {self._head} {times}"
        return fitted_line(head, running_words(running, now), self._console.width - 1)


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


def running_words(running: Sequence[Running], now: float) -> list[str]:
    """`fitting collision of trunk 12 s`, ...: first what most others wait for."""
    words = []
    for step in sorted(running, key=lambda step: (-step.waiting, step.began)):
        seconds = now - step.began
        text = step_words(step.label)
        words.append(f"{text} {seconds:.0f} s" if seconds >= 1.0 else text)
    return words


def fitted_line(head: str, words: Sequence[str], width: int) -> str:
    """The head and as many words as fit in the width; none is cut, the rest is counted."""
    for shown in range(len(words), 0, -1):
        more = f" and {len(words) - shown} more" if shown < len(words) else ""
        line = f"{head}: {', '.join(words[:shown])}{more}"
        if len(line) <= width:
            return line
    return head if len(head) <= width else ""


STEPS = {
    "fetch": "downloading the source",
    "list_archive": "listing the archive",
    "unpack": "unpacking",
    "list_includes": "looking for included files",
    "expand_xacro": "expanding the xacro",
    "patch": "patching the source",
    "read_urdf": "reading the URDF",
    "flatten_mjcf": "reading the MJCF's files",
    "read_mjcf": "reading the MJCF",
    "lint_export": "looking for slips of exporters",
    "lint_links": "checking masses and inertias of links",
    "lint_bodies": "checking masses and inertias of bodies",
    "lint_density": "checking densities",
    "lint_meshes": "checking meshes",
    "match_shapes": "matching shapes",
    "edit": "applying edit",
    "compose_parts": "mounting the parts",
    "merge_fixed_joints": "merging links at fixed joints",
    "mesh_companions": "looking for textures of",
    "convert_mesh": "converting mesh",
    "convert_texture": "converting texture",
    "decimate_mesh": "simplifying mesh",
    "auto": "fitting collision of",
    "coacd": "cutting into convex pieces",
    "vhacd": "cutting into convex pieces",
    "primitive": "fitting a primitive to",
    "hull": "computing the hull of",
    "spheres": "filling with spheres",
    "explicit": "taking the given collision shapes of",
    "assemble": "putting shapes together",
    "control": "computing drives and poses",
    "read_log": "reading log",
    "keep_prior": "collecting priors of logs",
    "fit_logs": "fitting logs",
    "excite": "looking for commands that show the parameters",
    "use_fits": "putting in what was measured",
    "ratings": "collecting ratings of motors",
    "pose": "computing the home pose",
    "measure_assets": "measuring meshes",
    "measure_bodies": "measuring bodies",
    "state_ranges": "writing the ranges of randomization",
    "light meshes": "simplifying meshes for the 3D view",
    "viewer": "making the 3D view",
    "picture model": "preparing the pictures",
    "pictures": "drawing the pictures",
    "urdf": "writing the URDF",
    "mjcf": "writing the MJCF",
    "mjx": "writing the MJX model",
    "usd": "writing the USD",
    "mjlab": "writing the module for mjlab",
    "isaaclab": "writing the module for Isaac Lab",
    "xrdf": "fitting spheres and writing the XRDF",
}
"""First words of a step's label -> what it does, to be followed by its subject."""
CHECKS = {
    "alignment": "comparing motions in PhysX and MuJoCo",
    "counts": "looking for what the source had and the files lack",
    "coverage": "measuring how well collision covers the robot",
    "free_fall": "letting it fall freely in MuJoCo",
    "full_effort": "pushing joints with full effort",
    "gains": "checking gains",
    "grip": "gripping objects in MuJoCo",
    "mass": "comparing masses with volumes",
    "mirror": "comparing left with right",
    "loops": "swinging the drives of its loops in MuJoCo",
    "mjcf_compiles": "compiling the MJCF",
    "mjcf_doctor": "asking mjcf-doctor about the scene",
    "mjcf_source": "comparing the MJCF with its source",
    "mjlab_contract": "checking what mjlab asks of a robot",
    "mjx_pairs": "looking at pairs of geoms for MJX",
    "newton_alignment": "comparing motions in Newton and MuJoCo",
    "newton_grip": "gripping objects in Newton",
    "newton_slope": "standing on a slope in Newton",
    "newton_loops": "swinging the drives of its loops in Newton",
    "oracle": "comparing dynamics with pinocchio",
    "physx_free_fall": "letting it fall freely in PhysX",
    "physx_grip": "gripping objects in PhysX",
    "physx_loops": "swinging the drives of its loops in PhysX",
    "physx_slope": "standing on a slope in PhysX",
    "physx_readback": "reading it back from PhysX",
    "asset_validator": "asking NVIDIA's asset validator about the USD",
    "simready": "asking SimReady's validator about the USD",
    "simcheck": "asking simcheck about the MJCF",
    "smoke_isaaclab": "trying it in Isaac Lab",
    "smoke_mjlab": "trying it in mjlab",
    "smoke_newton": "reading it back from Newton",
    "slope": "standing on a slope",
    "stand": "letting it hold its pose",
    "trials": "letting it fall and settle",
    "urdf_kinematics": "comparing poses of the URDF with yourdfpy",
    "urdf_loads": "reading the URDF with urdfdom",
    "usd_valid": "validating the USD",
}
"""Name of a check -> what it does. Other checks get their words from their names."""
NAMES = {
    "bare": "the bare MJCF",
    "dr": "the ranges",
    "isaaclab": "Isaac Lab's module",
    "mjcf": "the MJCF",
    "mjlab": "mjlab's module",
    "mjx": "the MJX model",
    "scene": "the scene",
    "scene_mjx": "the MJX scene",
    "urdf": "the URDF",
    "usd": "the USD",
    "usd_scene": "the USD scene",
    "xrdf": "the XRDF",
}
"""What a check compares with the robot, by its name before `_equal`."""


def step_words(label: str) -> str:
    """`auto trunk` -> `fitting collision of trunk`; the label itself where no words are known.

    Of several robots, the robot's name stays in front: `go1: fitting collision of trunk`.
    """
    robot, colon, own = label.rpartition(":")
    return f"{robot}{colon} {_words(own)}".lstrip()


def _words(label: str) -> str:
    if label.startswith("check "):
        return _check_words(label.removeprefix("check "))
    known = _known(label)
    if known is None:
        return label
    step, subject = known
    return f"{STEPS[step]} {subject}".rstrip()


def _check_words(name: str) -> str:
    if name in CHECKS:
        return CHECKS[name]
    what, equal, _ = name.partition("_equal")
    shown = what.replace("_", " ")
    return f"comparing {NAMES.get(what, shown)} with the robot" if equal else f"checking {shown}"


def _known(label: str) -> tuple[str, str] | None:
    """(the step, its subject); the prefix of a part of a composite, before it, goes to the end."""
    first, _, rest = label.partition(" ")
    if label in STEPS:
        return label, ""
    if first in STEPS:
        return first, rest
    second, _, subject = rest.partition(" ")
    if rest in STEPS or second in STEPS:
        step, subject = (rest, "") if rest in STEPS else (second, subject)
        return step, f"{subject} ({first})".strip()
    return None
