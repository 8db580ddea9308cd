"""Rows and commands that come when the computer has time, not on a grid."""

import mujoco
import numpy as np
import pytest
from logs import (
    ARMATURE,
    DAMPING,
    DELAY_S,
    FRICTION,
    JOINTS,
    KD,
    KP,
    RATE_HZ,
    TWO_LINKS,
    arm,
    chirps,
    columns_of,
    fitted,
    write_csv,
)
from tiny import run_step

from assetbuild.identify.read_log import ReadLog
from assetbuild.robot.codec import encode
from assetbuild.robot.identify import Columns

DT = 0.0002
HIDDEN = {"armature": ARMATURE, "damping": DAMPING, "friction": FRICTION}


def jittered(seconds, share, seed=3):
    """Time, target and position of rows that come up to this share of a period too late."""
    target, random = chirps(seconds), np.random.default_rng(seed)
    late = random.uniform(0.0, share / RATE_HZ, len(target))
    steps = np.round((np.arange(len(target)) / RATE_HZ + late) / DT).astype(int)
    text = TWO_LINKS.format(dt=DT, a=ARMATURE, d=DAMPING, f=FRICTION, kp=KP, kd=KD)
    model = mujoco.MjModel.from_xml_string(text)
    data, delay = mujoco.MjData(model), round(DELAY_S / DT)
    data.qpos[:] = target[0]
    sent = np.repeat(target, np.diff([*steps, steps[-1] + 1]), axis=0)
    sent = np.concatenate([np.repeat(target[:1], delay + steps[0], axis=0), sent])
    position, row = np.zeros_like(target), 0
    for step in range(steps[-1] + 1):
        if step == steps[row]:
            position[row] = data.qpos
            row += 1
        data.ctrl[:] = sent[step]
        mujoco.mj_step(model, data)
    position += random.normal(0.0, 3e-4, position.shape)
    return steps * DT, target, position


def read(folder, time, target, position):
    """The record of a log with these times."""
    (folder / "in").mkdir()
    (folder / "in/tree.json").write_bytes(encode(arm()))
    write_csv(folder / "in/log", columns_of(target, position) | {"time": time})
    run_step(
        ReadLog(file="log.csv", joints=JOINTS, columns=Columns()), folder / "in", folder / "out"
    )
    return np.load(folder / "out/record.npz")


def test_positions_are_interpolated_and_commands_keep_their_impulse(tmp_path):
    random = np.random.default_rng(0)
    even = np.arange(2000) / RATE_HZ
    time = even + random.uniform(0.0, 0.4 / RATE_HZ, len(even))
    position = np.stack([np.sin(2.0 * time), 0.5 * np.sin(3.0 * time)], axis=1)
    target = np.stack([np.sin(2.0 * even), 0.5 * np.sin(3.0 * even)], axis=1)
    record = read(tmp_path, time, target, position)
    period = float(record["period_s"])
    at = time[0] + period * np.arange(len(record["position_0"]))
    assert record["position_0"][:, 0] == pytest.approx(np.sin(2.0 * at), abs=1e-4)
    sent = np.sum(target[:-1] * np.diff(time)[:, None], axis=0)
    assert period * record["target_0"].sum(axis=0) == pytest.approx(sent, abs=2.0 * period)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.2, 0.6])
def test_jitter_leaves_what_is_identified_right(tmp_path, share):
    record = read(tmp_path, *jittered(20.0, share))
    fit, _ = fitted(tmp_path / "fit", record["target_0"], record["position_0"])
    called = [p for p in fit.parameters if not p.refused]
    assert len(called) >= 5
    for each in called:
        if each.name != "delay":
            true = HIDDEN[each.name][JOINTS.index(each.joints[0])]
            assert each.value == pytest.approx(true, rel=0.05), each
            assert each.low <= true <= each.high, each
