"""The same policy in other engines, where they are installed."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from policies import bundle_of, deployed, write_policy
from tiny import check_inputs, tiny_quadruped

from assetbuild.pipeline.policies import Wish, replay_policy
from assetbuild.policy.in_stages import unavailable_reason
from assetbuild.targets.usd import Usd

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("engine", ["newton", "physx"])
def test_a_policy_that_stands_in_mujoco_stands_there(engine: str, tmp_path: Path):
    if reason := unavailable_reason(engine):
        pytest.skip(f"{engine}: {reason}")
    bot = bundle_of(tmp_path)
    inputs = check_inputs(tmp_path / "usd", tiny_quadruped(), Usd(robot="robot"), "usd")
    shutil.copytree(inputs / "usd", bot.bundle / "usd", symlinks=False)
    folder = write_policy(tmp_path / "p", deployed(bot))
    wish = Wish(("mujoco", engine), (0.0, 0.0, 0.0), 2.0)
    runs = replay_policy(folder, bot.bundle, wish, lambda line: None).runs
    assert runs[engine].verdict == "stands"
    assert runs[engine].height == pytest.approx(runs["mujoco"].height, abs=0.01)
