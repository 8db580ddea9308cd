"""A policy in the loop, and the fault that makes it fall."""

from __future__ import annotations

import itertools
import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image
from policies import bundle_of, deployed, write_policy
from robot_files import check_inputs, run_step, write_robot_ports
from tiny import tiny_quadruped

from assetbuild.checks._newton import NewtonOrders
from assetbuild.checks._physx import PhysxOrders
from assetbuild.cli import main
from assetbuild.cli.policy import Replayed, Wish, _print, draw_replays, replay_policy
from assetbuild.engine.world import World
from assetbuild.errors import UsageError
from assetbuild.policy.counting import OrdersCheck
from assetbuild.policy.diagnose import Diagnosis, diagnose
from assetbuild.policy.in_mujoco import InMujoco
from assetbuild.policy.in_stages import unavailable_reason
from assetbuild.policy.opening import open_policy, runnable
from assetbuild.policy.replay import Replay, replay
from assetbuild.policy.robot import Bot
from assetbuild.policy.stated import Policy
from assetbuild.rendering.plan import renderer
from assetbuild.simulators.newton import HOME
from assetbuild.targets.usd import Usd

STAND = Wish(command=(0.0, 0.0, 0.0), seconds=2.0)
STILL = (0.0, 0.0, 0.0)
RUN = Replay(STILL, 2.0, 2.0, (0.0, 0.0), STILL, 0.0, 0.3, None, None)
"""A robot that stands."""


@pytest.fixture(scope="module")
def bot(tmp_path_factory: pytest.TempPathFactory) -> Bot:
    return bundle_of(tmp_path_factory.mktemp("bundle"))


def replayed(
    bot: Bot, folder: Path, spoil: Callable[[dict[str, Any]], object], wish: Wish = STAND
) -> Replayed:
    """A policy whose actions are all 0, so that it stands in its default pose."""
    said = deployed(bot)
    spoil(said)
    return replay_policy(write_policy(folder, said), bot.bundle, wish, lambda line: None)


def test_actions_of_nothing_stand(bot: Bot, tmp_path: Path):
    done = replayed(bot, tmp_path / "p", lambda said: None)
    run = done.runs["mujoco"]
    assert run.verdict == "stands" and done.follows and not done.searched
    assert run.tilt < 0.05 and math.hypot(*run.moved) < 0.02
    assert run.saturated == 0.0 and run.slip is not None and run.slip < 0.01
    assert replayed(bot, tmp_path / "q", lambda said: None).runs["mujoco"] == run, "each time"
    with pytest.raises(UsageError, match="cannot write"):
        draw_replays(done, bot.bundle, STAND, tmp_path)


@pytest.mark.parametrize(("tilt", "verdict"), [(0.2, "stands"), (0.7, "stays up, and tilts far")])
def test_what_leans_far_does_not_stand(tilt: float, verdict: str):
    still = (0.0, 0.0, 0.0)
    run = Replay(still, 1.0, 1.0, (0.0, 0.0), still, tilt, 0.3, None, None)
    assert run.verdict == verdict and run.follows == (verdict == "stands")


def test_a_simulation_that_breaks_is_a_fall_with_figures(bot: Bot, tmp_path: Path):
    """The last finite state is reported."""

    class Breaking(InMujoco):
        def drive(self, targets, seconds: float) -> None:
            super().drive(targets, seconds)
            self.data.xpos[1] = np.nan if self.data.time > 0.5 else self.data.xpos[1]

    policy = open_policy(write_policy(tmp_path, deployed(bot)), bot)
    with runnable(policy, bot) as network:
        run = replay(policy, bot, network, Breaking(bot, policy), (0.0, 0.0, 0.0), 2.0)
    assert run.fell and run.seconds == pytest.approx(0.5, abs=0.03)
    assert np.isfinite((*run.moved, *run.velocity, run.tilt, run.height)).all()


def test_of_faults_that_explain_it_alike_the_first_is_named(bot: Bot, tmp_path: Path):
    policy = open_policy(write_policy(tmp_path, deployed(bot)), bot)
    fallen = replace(RUN, seconds=1.0)
    speeds = itertools.chain((0.06, 0.055), itertools.repeat(0.05))

    def attempt(_: Policy) -> Replay:
        return replace(RUN, velocity=(next(speeds), 0.0, 0.0))

    found = diagnose(policy, bot, fallen, attempt)
    assert found is not None and found.replay.velocity[0] == 0.06


def in_degrees(policy: Policy) -> Policy:
    return replace(policy, scale={n: math.degrees(value) for n, value in policy.scale.items()})


def one_mirrored(policy: Policy) -> Policy:
    pose = replace(policy.terms[3], scale=(1.0, -1.0, *[1.0] * 10))
    return replace(policy, terms=(*policy.terms[:3], pose, *policy.terms[4:]))


def absolute(policy: Policy) -> Policy:
    pose = replace(policy.terms[3], function="joint_pos")
    return replace(policy, terms=(*policy.terms[:3], pose, *policy.terms[4:]))


def exchanged(one: int, other: int) -> Callable[[Policy], Policy]:
    def exchange(policy: Policy) -> Policy:
        terms = list(policy.terms)
        terms[one], terms[other] = terms[other], terms[one]
        return replace(policy, terms=tuple(terms))

    return exchange


@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (in_degrees, "actions are in degrees"),
        (absolute, "`joint_pos_rel` is `joint_pos_rel`, not `joint_pos`"),
        (one_mirrored, "the scale of `joint_pos_rel` is 1, not -1"),
        (exchanged(0, 2), "`velocity_commands` and `base_ang_vel` are exchanged"),
        (exchanged(3, 5), "`last_action` and `joint_pos_rel` are exchanged"),
    ],
)
def test_what_undoes_a_fault_names_it(
    spoil: Callable[[Policy], Policy], fault: str, bot: Bot, tmp_path: Path
):
    policy = open_policy(write_policy(tmp_path, deployed(bot)), bot)
    fallen = replace(RUN, seconds=1.0)

    def terms(one: Policy) -> list[object]:
        return [(term.function, {*term.scale}) for term in one.terms]

    def attempt(tried: Policy) -> Replay:
        is_right = terms(tried) == terms(policy)
        return RUN if is_right and tried.scale == pytest.approx(dict(policy.scale)) else fallen

    found = diagnose(spoil(policy), bot, fallen, attempt)
    assert found is not None and found.fault == fault


def test_a_fault_of_a_robot_that_walks_is_only_possible(bot: Bot, tmp_path: Path, capsys):
    policy = open_policy(write_policy(tmp_path, deployed(bot)), bot)
    done = Replayed(policy, {"mujoco": RUN}, None, True)
    _print(done, STAND)
    assert "fault that is known" not in capsys.readouterr().out
    _print(replace(done, diagnosis=Diagnosis("its gains", RUN)), STAND)
    assert "possible fault: its gains" in capsys.readouterr().out


def other_order(said: dict[str, Any]) -> None:
    """The motors of another order: the file declares MuJoCo's, its lists are Isaac Lab's."""
    said["joint_ids_map"] = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]


def limp(said: dict[str, Any]) -> None:
    said["stiffness"] = [value * math.pi / 180.0 for value in said["stiffness"]]


@pytest.mark.usefixtures("drawing")
def test_a_picture_has_a_row_for_each_engine_and_six_moments(bot: Bot, tmp_path: Path):
    if renderer(World()) == "none":
        pytest.skip("no OpenGL without a window: apt-get install libegl1 libgl1-mesa-dri")
    done = replayed(bot, tmp_path / "p", limp, replace(STAND, search=False))
    draw_replays(done, bot.bundle, STAND, tmp_path / "deep/strip.png")
    with Image.open(tmp_path / "deep/strip.png") as image:
        pixels = np.asarray(image.convert("L")).astype(float)
    columns = np.array_split(pixels, 6, axis=1)
    dark = [np.nonzero(column[: column.shape[0] * 9 // 10] < 200)[0] for column in columns]
    assert all(rows.size for rows in dark)
    assert dark[-1].min() > dark[0].min() + 5  # it sank


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (limp, "the bundle's gains"),
        (other_order, "the joints of the policy stand in Isaac Lab's order"),
    ],
)
def test_the_fault_is_named_with_both_scores(
    spoil: Callable[[dict[str, Any]], object], words: str, bot: Bot, tmp_path: Path
):
    done = replayed(bot, tmp_path / "p", spoil)
    assert done.runs["mujoco"].fell and done.searched
    assert done.diagnosis is not None and words in done.diagnosis.fault
    assert done.diagnosis.replay.follows
    assert done.diagnosis.replay.score > done.runs["mujoco"].score + 0.25


def test_the_command_line_says_it_in_words_and_as_data(bot: Bot, tmp_path: Path, capsys):
    folder = str(write_policy(tmp_path / "p", deployed(bot)))
    bundle = str(bot.bundle)
    options = ["--command", "0", "0", "0", "--seconds", "1"]
    assert main(["policy", "replay", folder, bundle, *options]) == 0
    assert "mujoco: stands: " in capsys.readouterr().out
    assert main(["policy", "replay", folder, bundle, *options, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["runs"]["mujoco"]["verdict"] == "stands"
    assert main(["policy", "check", folder, bundle]) == 0
    assert "12 joints, 6 observations; 0 that do not fit" in capsys.readouterr().out
    said = deployed(bot) | {"step_dt": 0.01}
    assert main(["policy", "check", str(write_policy(tmp_path / "q", said)), bundle, "--json"]) == 1
    assert "policy.timestep" in {row["rule"] for row in json.loads(capsys.readouterr().out)}


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda said: said.update(step_dt=0.0133), "acts every 13.3 ms"),
        (lambda said: said["observations"].update(height_scan={"params": {}, "scale": [1.0]}),
         "`height_scan`"),
        (lambda said: said["observations"]["joint_vel_rel"].update(scale=[1.0] * 3),
         "joint_vel_rel: 3 scales for 12 numbers"),
        (lambda said: said["observations"].pop("last_action"), "takes 45 numbers"),
    ],
    ids=["a rhythm that the simulation does not meet", "an observation that nobody knows",
         "scales of other joints", "an observation that is missing"],
)  # fmt: skip
def test_what_cannot_be_replayed_is_refused(
    spoil: Callable[[dict[str, Any]], object], said: str, bot: Bot, tmp_path: Path, capsys
):
    stated = deployed(bot)
    spoil(stated)
    folder = str(write_policy(tmp_path / "p", stated))
    assert main(["policy", "replay", folder, str(bot.bundle)]) == 2
    assert said in capsys.readouterr().err


def test_a_network_without_numbers_is_not_called_a_fall(bot: Bot, tmp_path: Path, capsys):
    folder = write_policy(tmp_path / "p", deployed(bot), np.full((45, 12), np.nan))
    assert main(["policy", "replay", str(folder), str(bot.bundle)]) == 1
    said = capsys.readouterr().out
    assert "the network answers with NaN or inf after 0.00 s" in said and "fault" not in said


def test_a_bundle_that_is_not_there_is_named(bot: Bot, tmp_path: Path, capsys):
    folder = write_policy(tmp_path / "p", deployed(bot))
    assert main(["policy", "check", str(folder), str(tmp_path / "build/g0")]) == 2
    assert "there is no folder" in capsys.readouterr().err


@pytest.mark.parametrize("engine", ["newton", "physx"])
def test_an_engine_that_is_not_there_is_named_with_the_way_to_get_it(
    engine: str, bot: Bot, tmp_path: Path, monkeypatch, capsys
):
    monkeypatch.setattr(
        "assetbuild.policy.in_stages.unavailable_reason", lambda name: f"get {name}"
    )
    folder = str(write_policy(tmp_path / "p", deployed(bot)))
    assert main(["policy", "replay", folder, str(bot.bundle), "--engine", engine]) == 1
    assert f"get {engine}" in capsys.readouterr().err
    assert isinstance(unavailable_reason(engine), str)


# --- In other engines, where they are installed ---


@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "check"), [("newton", NewtonOrders), ("physx", PhysxOrders)], ids=["newton", "physx"]
)
def test_a_policy_stands_there_too_and_the_engine_is_asked_how_it_counts(
    engine: str, check: type[OrdersCheck], tmp_path: Path
):
    if reason := unavailable_reason(engine):
        pytest.skip(f"{engine}: {reason}")
    robot = tiny_quadruped()
    bot = bundle_of(tmp_path, robot)
    usd = check_inputs(tmp_path / "stage", robot, Usd(robot="robot"), "usd")
    shutil.copytree(usd / "usd", bot.bundle / "usd", symlinks=False)
    wish = Wish(("mujoco", engine), (0.0, 0.0, 0.0), 2.0)
    policy = write_policy(tmp_path / "p", deployed(bot))
    runs = replay_policy(policy, bot.bundle, wish, lambda line: None).runs
    assert runs[engine].verdict == "stands"
    assert runs[engine].height == pytest.approx(runs["mujoco"].height, abs=0.01)

    write_robot_ports(bot.bundle, robot)
    own = {"environment": HOME.folder.name} if engine == "newton" else {}
    step = check(robot="robot", **own)
    contract = bot.bundle / "policy/robot_contract.yaml"
    said = yaml.safe_load(contract.read_text())
    order = said["orders"][step.order]
    order[-1], order[-2] = order[-2], order[-1]
    contract.write_text(yaml.safe_dump(said, sort_keys=False))
    (found,) = run_step(step, bot.bundle, tmp_path / "second")
    assert found.rule == "policy.engine_order"
    assert f"{step.order} has `{order[-1]}` at place 10" in found.message, "the others are right"
