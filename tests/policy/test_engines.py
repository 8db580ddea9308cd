"""The same policy in other engines, where they are installed."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml
from policies import bundle_of, deployed, write_policy
from tiny import check_inputs, run_step, tiny_quadruped, write_robot_ports

from assetbuild.checks._newton import NewtonOrders
from assetbuild.checks._physx import PhysxOrders
from assetbuild.pipeline.policies import Wish, replay_policy
from assetbuild.policy.counting import OrdersCheck
from assetbuild.policy.in_stages import unavailable_reason
from assetbuild.simulators.newton import HOME
from assetbuild.targets.usd import Usd

pytestmark = pytest.mark.slow


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
