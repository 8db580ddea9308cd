"""`assetbuild policy`: what a policy says of a robot, and the policy in the loop."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

from assetbuild.cli.progress import progress
from assetbuild.cli.summary import finding_text, in_public
from assetbuild.pipeline.policies import Replayed, Wish, check_policy, draw_replays, replay_policy
from assetbuild.policy.replay import Replay
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
        print(f"  likely fault: {done.diagnosis.said}")
        print(f"    with that put right: {_sentence('mujoco', better)}")
    elif done.searched:
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
        else {"fault": diagnosis.said, "score": diagnosis.replay.score},
    }


def _figures(run: Replay) -> dict[str, object]:
    figures = {name: value for name, value in vars(run).items() if name != "moments"}
    return figures | {"verdict": run.verdict, "follows": run.follows}


def _named(file: Path) -> str:
    return f"{file.parent.name}/{file.name}"
