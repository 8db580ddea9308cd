"""A policy against a bundle: what its files say, how it drives, and why it falls."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

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
