"""`assetbuild policy`: what a policy says of a robot, how it drives, and why it falls."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from assetbuild.cli.progress import progress
from assetbuild.cli.summary import finding_text, in_public
from assetbuild.engine.world import World
from assetbuild.errors import UsageError
from assetbuild.findings import Finding, worst_first
from assetbuild.policy.compare import compare
from assetbuild.policy.diagnose import BETTER, Diagnosis, diagnose
from assetbuild.policy.in_mujoco import InMujoco
from assetbuild.policy.in_stages import InStages, require
from assetbuild.policy.network import Network
from assetbuild.policy.opening import open_policy, runnable
from assetbuild.policy.replay import BEST, Replay, replay
from assetbuild.policy.robot import Bot, bot_of
from assetbuild.policy.stated import Policy
from assetbuild.rendering.plan import renderer
from assetbuild.rendering.strip import draw_strip
from assetbuild.report.summary import WITHHELD


def run(arguments: argparse.Namespace) -> int:
    """`check` or `replay`; 1 where the policy and the bundle do not go together."""
    return _check(arguments) if arguments.what == "check" else _replay(arguments)


def _check(arguments: argparse.Namespace) -> int:
    policy, findings = check_policy(arguments.policy, arguments.bundle)
    wrong = [finding for finding in findings if finding.severity != "info"]
    if arguments.json:
        print(json.dumps([finding.to_json() for finding in findings], indent=1, sort_keys=True))
        return 1 if wrong else 0
    for finding in findings:
        print(finding_text(finding))
    file = _named(policy.file)
    print(f"{file}: {len(policy.acts_on)} joints, {len(policy.terms)} observations; "
          f"{len(wrong)} that do not fit")  # fmt: skip
    return 1 if wrong else 0


def _replay(arguments: argparse.Namespace) -> int:
    engines = tuple(dict.fromkeys(arguments.engine or ["mujoco"]))
    wish = Wish(
        engines, tuple(arguments.command), arguments.seconds, arguments.scene, not arguments.plain
    )
    with progress(arguments.bundle.name) as shown:
        done = replay_policy(arguments.policy, arguments.bundle, wish, shown.say)
    if arguments.json:
        print(json.dumps(_plain(done), indent=1, sort_keys=True))
    else:
        _print(done, wish)
    if arguments.picture:  # last: where nothing can be drawn, the figures have been told
        with progress(arguments.bundle.name) as shown:
            shown.say("drawing")
            draw_replays(done, arguments.bundle, wish, arguments.picture)
    return 0 if done.follows else 1


def _print(done: Replayed, wish: Wish) -> None:
    x, y, turn = wish.command
    print(f"{_named(done.policy.file)}: forward {x:g} m/s, left {y:g} m/s, turning {turn:g} rad/s")
    for engine, run in done.runs.items():
        print(f"  {engine}: {_sentence(engine, run)}")
    if done.diagnosis is not None:
        better = done.diagnosis.replay
        word = "possible" if done.follows else "likely"
        print(f"  {word} fault: {done.diagnosis.fault}")
        print(f"    with that put right: {_sentence('mujoco', better)}")
    elif done.searched and not done.follows:
        print("  no single fault that is known here explains it")


def _sentence(engine: str, run: Replay) -> str:
    """What became of it; of PhysX without figures where everybody reads them."""
    if engine == "physx" and in_public():
        return f"{'does' if run.follows else 'does not do'} what it is asked to ({WITHHELD})"
    forward, left = run.moved
    side = f"{abs(left):.2f} m to the {'left' if left > 0.0 else 'right'}"
    parts = [
        f"{run.verdict}: {forward:.2f} m forward, {side} in {run.seconds:.3g} s",
        f"{run.velocity[0]:.2f}, {run.velocity[1]:.2f} m/s, {run.velocity[2]:.2f} rad/s",
        f"tilt {math.degrees(run.tilt):.1f}°",
    ]
    if run.saturated is not None and run.slip is not None:
        parts += [f"{100.0 * run.saturated:.1f} % of the drives at their limit"]
        parts += [f"feet slip at {run.slip:.3f} m/s"]
    return "; ".join(parts)


def _plain(done: Replayed) -> dict[str, object]:
    """Data for other programs."""
    diagnosis = done.diagnosis
    return {
        "runs": {engine: _figures(run) for engine, run in done.runs.items()},
        "diagnosis": None
        if diagnosis is None
        else {"fault": diagnosis.fault, "score": diagnosis.replay.score},
    }


def _figures(run: Replay) -> dict[str, object]:
    figures = {name: value for name, value in vars(run).items() if name != "moments"}
    return figures | {"verdict": run.verdict, "follows": run.follows}


def _named(file: Path) -> str:
    return f"{file.parent.name}/{file.name}"


# --- the policy in the loop ---

SEARCH_S, LONGER_S = 5.0, 2.0
"""So long each hypothesis of a diagnosis is tried; by so much longer than until it fell."""
Say = Callable[[str], None]


@dataclass(frozen=True)
class Wish:
    """What a policy is asked for. command: forward, left, turn; m/s and rad/s.

    scene: of the bundle's MJCF. search: whether a policy that does not walk is diagnosed.
    """

    engines: tuple[str, ...] = ("mujoco",)
    command: tuple[float, float, float] = (0.5, 0.0, 0.0)
    seconds: float = 10.0
    scene: str = "scene.xml"
    search: bool = True


@dataclass(frozen=True)
class Replayed:
    """What became of it, by engine; why it fell in the first one, where a fault explains it.

    searched: whether hypotheses were tried.
    """

    policy: Policy
    runs: Mapping[str, Replay]
    diagnosis: Diagnosis | None = None
    searched: bool = False

    @property
    def follows(self) -> bool:
        """Whether it did what it was asked to do in every engine."""
        return all(run.follows for run in self.runs.values())


def check_policy(path: Path, bundle: Path) -> tuple[Policy, list[Finding]]:
    """What a policy says otherwise than the bundle, worst first. AssetBuildError."""
    bot = bot_of(bundle)
    policy = open_policy(path, bot)
    sizes = None
    if policy.network is not None:
        with Network(policy.network) as network:
            sizes = network.sees, network.acts
    return policy, worst_first(list(compare(policy, bot, sizes)))


def replay_policy(path: Path, bundle: Path, wish: Wish, say: Say) -> Replayed:
    """Let a policy drive the robot of a bundle. AssetBuildError for what cannot be replayed."""
    for engine in wish.engines:
        require(engine)
    bot = bot_of(bundle)
    policy = open_policy(path, bot)
    with runnable(policy, bot) as network:
        runs: dict[str, Replay] = {}
        for engine in wish.engines:
            say(f"{engine}: {wish.seconds:g} s")
            runs[engine] = _run(policy, bot, network, engine, wish)
        diagnosis, first = None, runs[wish.engines[0]]
        is_poor = not first.follows or first.score < BEST - BETTER
        if first.is_broken:  # no wiring mends it
            return Replayed(policy, runs)
        if wish.search and is_poor:
            say("looking for the fault")
            diagnosis = _searched(policy, bot, network, wish, first.seconds if first.fell else 0.0)
        return Replayed(policy, runs, diagnosis, is_poor and wish.search)


def draw_replays(done: Replayed, bundle: Path, wish: Wish, file: Path) -> None:
    """A picture of every run, a row for each engine. StepError, UsageError."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.open("ab").close()
    except OSError as error:
        raise UsageError(f"cannot write `{file}`: {error.strerror}") from None
    rows = {engine: run.moments for engine, run in done.runs.items()}
    draw_strip(bundle / "mjcf" / wish.scene, rows, file, renderer(World()))


def _run(policy: Policy, bot: Bot, network: Network, engine: str, wish: Wish) -> Replay:
    if engine == "mujoco":
        still = InMujoco(bot, policy, wish.scene)
        return replay(policy, bot, network, still, wish.command, wish.seconds)
    with InStages(bot, policy, engine) as world:
        return replay(policy, bot, network, world, wish.command, wish.seconds)


def _searched(
    policy: Policy, bot: Bot, network: Network, wish: Wish, fell_s: float
) -> Diagnosis | None:
    """Search in MuJoCo, in shorter runs. fell_s: when it fell, 0 where it did not."""
    shorter = replace(wish, seconds=min(wish.seconds, max(SEARCH_S, fell_s + LONGER_S)))

    def attempt(changed: Policy) -> Replay:
        return _run(changed, bot, network, "mujoco", shorter)

    return diagnose(policy, bot, attempt(policy), attempt)
