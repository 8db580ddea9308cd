"""Faults by the hundred, as a command: `python -m tests.faults`, minutes on a quiet machine.

Kills at random moments (F1), and many builds at once on one store (F4), of a small robot through
the real command line. Prints figures; exits with 1 when a result was wrong, a build was refused, or
something was left behind.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from assetbuild.engine.noop_build import identity

ROOT = Path(__file__).parents[2]
URDF = ROOT / "tests/robots/four_legs.urdf"
RECIPE = """\
schema: assetbuild/v1
robot: legs
source: {path: robot, urdf: four_legs.urdf, license: MIT}
base: floating
collision: {default: {method: keep}}
actuators:
  - {joints: ".*", model: pd, kp: 20, kd: 1, effort: 10, velocity: 20}
targets: [mjcf]
"""
MASSES = (6, 7)
"""Masses of the trunk, kg: each makes another robot with its own gold manifest."""


@dataclass
class Legs:
    """A folder with the recipe and the robot; `store` may be another's."""

    folder: Path
    store: Path

    def lay_out(self, mass: int) -> None:
        (self.folder / "robot").mkdir(parents=True, exist_ok=True)
        text = URDF.read_text().replace('<mass value="6"/>', f'<mass value="{mass}"/>', 1)
        (self.folder / "robot/four_legs.urdf").write_text(text)
        (self.folder / "legs.yaml").write_text(RECIPE)

    def start(self) -> subprocess.Popen[bytes]:
        kept = {k: v for k, v in os.environ.items() if not k.startswith("ASSETBUILD_")}
        own = {"ASSETBUILD_CACHE": str(self.store), "PYTHONPATH": str(ROOT)}
        own["MUJOCO_GL"] = "disable"  # pictures would be half of every build
        with (self.folder / "log").open("wb") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "assetbuild", "build", "legs.yaml"],
                cwd=self.folder,
                env=kept | own,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def build(self) -> int:
        return self.start().wait()

    def manifest(self) -> bytes:
        path = self.folder / "build/legs/manifest.json"
        return path.read_bytes() if path.is_file() else b""

    def log(self) -> str:
        return (self.folder / "log").read_text(errors="replace")


@dataclass
class Tally:
    """What is counted; everything in `bad` must stay empty."""

    done: Counter[str] = field(default_factory=Counter)
    bad: list[str] = field(default_factory=list)


def golds(folder: Path) -> tuple[dict[int, bytes], float]:
    """The manifest of each robot, built with an empty store; and the seconds of such a build."""
    found, seconds = {}, []
    for mass in MASSES:
        legs = Legs(folder / f"gold{mass}", folder / f"gold{mass}/store")
        legs.lay_out(mass)
        began = time.monotonic()
        if legs.build() != 0:
            raise SystemExit(f"the gold build fails:\n{legs.log()}")
        seconds.append(time.monotonic() - began)
        found[mass] = legs.manifest()
    return found, min(seconds)


CODE = identity()


def _check_same_code() -> None:
    if identity() != CODE:
        raise SystemExit("assetbuild was edited meanwhile: the gold builds prove nothing now")


# --- F1


def kills(folder: Path, count: int, seed: int) -> Tally:
    """`count` kills, after each of them a build that must be right."""
    chance = random.Random(seed)
    gold, seconds = golds(folder)
    tally = Tally()
    place = folder / "killed"
    legs = Legs(place, place / "store")
    while tally.done["kills"] < count:
        mass = chance.choice(MASSES)
        if chance.random() < 0.5:  # else the store knows some of it already
            shutil.rmtree(legs.store, ignore_errors=True)
        legs.lay_out(mass)
        _kill_once(legs, chance, seconds, tally)
        _check_build(legs, legs.build(), gold[mass], tally)
        _check_same_code()
        tally.done["builds after kills"] += 1
        _progress(f"{tally.done['kills']} kills, {len(tally.bad)} bad")
    _check_nothing_left(legs, tally)
    return tally


def _kill_once(legs: Legs, chance: random.Random, seconds: float, tally: Tally) -> None:
    process = legs.start()
    time.sleep(chance.uniform(0.0, seconds * 1.2))
    killed = process.poll() is None
    group = chance.random() < 0.5
    if killed:
        os.killpg(process.pid, signal.SIGKILL) if group else process.kill()
        tally.done["kills"] += 1
        tally.done["of these the whole group"] += group
    else:
        tally.done["too late"] += 1
    process.wait()


def _check_build(legs: Legs, code: int, gold: bytes, tally: Tally) -> None:
    if code != 0:
        tally.bad.append(f"refused with {code}: {legs.log()[-500:]}")
    elif legs.manifest() != gold:
        tally.bad.append("wrong: another manifest than the gold build's")


def _check_nothing_left(legs: Legs, tally: Tally) -> None:
    time.sleep(2.0)
    left = [*(legs.store / "v1/tmp").iterdir(), *(legs.folder / "build").glob("*.new-*")]
    left += (legs.folder / "build").glob("*.old-*")
    tally.bad += [f"left behind: {path.name}" for path in left]
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            if str(legs.store).encode() in path.read_bytes():
                tally.bad.append(f"an orphan lives on: {path.parent.name}")
        except OSError:
            continue


# --- F4


def at_once(folder: Path, rounds: int, builds: int) -> Tally:
    """`rounds` of `builds` at once on one store, each time a robot that it does not know."""
    gold, _ = golds(folder)
    tally = Tally()
    for number in range(rounds):
        mass = MASSES[number % len(MASSES)]
        store = folder / f"shared{number}"
        places = [Legs(folder / f"round{number}/{n}", store) for n in range(builds)]
        for legs in places:
            legs.lay_out(mass)
        processes = [legs.start() for legs in places]
        for legs, process in zip(places, processes, strict=True):
            _check_build(legs, process.wait(), gold[mass], tally)
            tally.done["builds"] += 1
        _check_same_code()
        runs = Counter(label for legs in places for label in _ran(legs))
        tally.done["steps"] += len(runs)
        tally.done["runs"] += sum(runs.values())
        tally.bad += [f"ran {count} times: {label}" for label, count in runs.items() if count > 1]
        tally.done["rounds"] += 1
        shutil.rmtree(folder / f"round{number}")
        shutil.rmtree(store)
        _progress(f"{tally.done['rounds']} rounds, {len(tally.bad)} bad")
    return tally


def _ran(legs: Legs) -> list[str]:
    try:
        steps = json.loads((legs.folder / "build/legs.run.json").read_text())["steps"]
    except OSError:
        return []
    return [label for label, step in steps.items() if step["status"] == "ran"]


def _progress(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def told(title: str, tally: Callable[[Path], Tally]) -> int:
    """Run, print the figures, and give the number of what is bad."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="assetbuild-faults-") as name:
        found = tally(Path(name))
    print(f"{title}: {time.monotonic() - began:.0f} s")
    for what, count in found.done.items():
        print(f"  {what}: {count}")
    print(f"  bad: {len(found.bad)}")
    for line in found.bad[:20]:
        print(f"    {line}")
    return len(found.bad)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=50)
    parser.add_argument("--builds", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    wanted = parser.parse_args()
    bad = 0
    if wanted.kills:
        bad += told("kills", lambda folder: kills(folder, wanted.kills, wanted.seed))
    if wanted.rounds:
        bad += told("builds at once", lambda folder: at_once(folder, wanted.rounds, wanted.builds))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
