"""Fits find the parameters of simulated joints, with intervals that hold."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from logs import (
    DELAY_S,
    JOINTS,
    RATE_HZ,
    arm,
    assert_found,
    chirps,
    columns_of,
    fitted,
    read,
    recorded,
    text_of_two_links,
)

from assetbuild.identify.estimate import Problem, estimate
from assetbuild.identify.plant import Plant
from assetbuild.identify.record import Drive, Record
from assetbuild.identify.start import first_guess
from assetbuild.robot.model import Actuator, Control


def linear(x, measured, parts, noise=(0.1,)):
    """Measured (N, C) = parameters @ x; x: (parameters, N, C), 100 samples a second."""
    count = len(x)
    return Problem(
        simulate=lambda vectors: np.stack([np.tensordot(v, x, 1) for v in vectors]),
        measured=measured,
        blocks=np.arange(len(measured)) // 100,
        start=np.zeros(count),
        lower=np.full(count, -np.inf),
        steps=np.full(count, 1e-3),
        parts=tuple(map(frozenset, parts)),
        noise=np.array(noise),
    )


def line(noise, seed=0, twin=False, samples=2000):
    """y = a x1 + b x2 (+ c x2 again, which nobody can tell from b); truth 2, -1."""
    random = np.random.default_rng(seed)
    t = np.arange(samples) / 100.0
    x = np.stack([np.sin(t), np.cos(3 * t)] + [np.cos(3 * t)] * twin)[:, :, None]
    measured = 2.0 * x[0] - 1.0 * x[1] + noise(random, samples)[:, None]
    return linear(x, measured, [{0}] * len(x))


def white(random, samples):
    return random.normal(0.0, 0.1, samples)


def coloured(random, samples):
    """A first-order process that forgets within 0.2 s."""
    e = np.zeros(samples)
    for n in range(1, samples):
        e[n] = 0.95 * e[n - 1] + random.normal(0.0, 0.03)
    return e


def test_a_record_without_noise_gives_the_truth():
    found = estimate(line(lambda random, samples: np.zeros(samples)))
    assert found.theta == pytest.approx([2.0, -1.0], abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [white, coloured])
def test_nineteen_of_twenty_intervals_hold_the_truth_also_in_coloured_noise(noise):
    held = []
    for seed in range(150):
        found = estimate(line(noise, seed))
        held += [low <= true <= high for low, true, high in
                 zip(found.low, (2.0, -1.0), found.high, strict=True)]  # fmt: skip
    assert np.mean(held) > 0.91


def test_two_parameters_that_do_the_same_are_correlated_and_have_wide_intervals():
    found = estimate(line(white, twin=True))
    assert abs(found.correlation[1, 2]) > 0.99
    assert found.high[1] - found.low[1] > 1.0
    assert found.high[0] - found.low[0] < 0.05


def test_parameters_of_disjoint_parts_share_a_simulation():
    asked = []
    x = np.zeros((2, 2000, 2))
    x[0, :, 0] = x[1, :, 1] = 1.0
    problem = linear(x, np.ones((2000, 2)), [{0}, {1}], noise=(1.0, 1.0))

    def simulate(vectors):
        asked.append(len(vectors))
        return problem.simulate(vectors)

    found = estimate(replace(problem, simulate=simulate))
    assert found.theta == pytest.approx([1.0, 1.0], abs=1e-5)
    assert set(asked) == {1}


def test_a_residual_above_the_noise_of_the_sensors_widens_the_intervals():
    quiet = line(white)
    doubtful = replace(quiet, noise=np.array([0.01]))
    narrow, wide = (estimate(problem) for problem in (quiet, doubtful))
    assert np.all(wide.lacking > 2.0 * (narrow.high - narrow.low))
    assert np.all(narrow.lacking == 0.0)


def test_a_residual_widens_only_what_its_channel_shows():
    """The first parameter moves both channels, but hardly the one that the model misses."""
    random = np.random.default_rng(0)
    t = np.arange(2000) / 100.0
    x = np.zeros((2, 2000, 2))
    x[0, :, 0], x[0, :, 1], x[1, :, 1] = np.sin(t), 0.01 * np.sin(t), np.cos(3.0 * t)
    measured = x.sum(axis=0) + random.normal(0.0, 0.1, (2000, 2)) * [1.0, 20.0]
    fit = estimate(linear(x, measured, [{0, 1}, {1}], noise=(0.1, 0.1)))
    assert fit.lacking[0] < 0.05 * fit.lacking[1]


WANTED = frozenset({"armature", "damping", "friction"})
DOWN = (0.0, 0.0, -9.81)


@pytest.mark.parametrize(("kp", "kd"), [(30.0, 1.0), (500.0, 50.0)])
def test_the_start_predicts_the_log(kp, kd):
    """kp times the error of the stiff one is six times its effort; kd takes nearly all away."""
    text = text_of_two_links(kp=kp, kd=kd)
    target = chirps(6.0)
    position, torque = recorded(mujoco.MjModel.from_xml_string(text), target, delay=0.0)
    assert np.abs(torque).max() < 50.0
    assert (kp * np.abs(target - position).max() > 50.0) == (kp > 100.0)
    rows = tuple(Actuator(joint, "pd", kp, kd, effort=50.0) for joint in JOINTS)
    plant = Plant(arm(), Control(actuators=rows), JOINTS, DOWN)
    record = Record(1.0 / RATE_HZ, position, target).from_rest()
    drives = [Drive(kp, kd, 0.01, 0.1, 0.0, 50.0) for _ in JOINTS]
    guess = first_guess(plant, [record], drives, [WANTED, WANTED])
    assert all(abs(drive.offset) < 1.0 for drive in guess)
    simulated, _ = plant.in_steps(plant.longest_for(guess)).simulate(record, [guess])
    assert np.sqrt(np.mean((simulated[0] - record.position) ** 2)) < 0.01


DT = 0.0002


def jittered(seconds, share, seed=3):
    """Time, target and position of rows that come up to this share of a period too late."""
    target, random = chirps(seconds), np.random.default_rng(seed)
    late = random.uniform(0.0, share / RATE_HZ, len(target))
    steps = np.round((np.arange(len(target)) / RATE_HZ + late) / DT).astype(int)
    text = text_of_two_links(DT)
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


def test_positions_are_interpolated_and_commands_keep_their_impulse(tmp_path):
    random = np.random.default_rng(0)
    even = np.arange(2000) / RATE_HZ
    time = even + random.uniform(0.0, 0.4 / RATE_HZ, len(even))
    position = np.stack([np.sin(2.0 * time), 0.5 * np.sin(3.0 * time)], axis=1)
    target = np.stack([np.sin(2.0 * even), 0.5 * np.sin(3.0 * even)], axis=1)
    _, record = read(tmp_path, columns_of(target, position) | {"time": time})
    period = float(record["period_s"])
    at = time[0] + period * np.arange(len(record["position_0"]))
    assert record["position_0"][:, 0] == pytest.approx(np.sin(2.0 * at), abs=1e-4)
    sent = np.sum(target[:-1] * np.diff(time)[:, None], axis=0)
    assert period * record["target_0"].sum(axis=0) == pytest.approx(sent, abs=2.0 * period)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.2, 0.6])
def test_jitter_leaves_what_is_identified_right(tmp_path, share):
    time, target, position = jittered(20.0, share)
    _, record = read(tmp_path, columns_of(target, position) | {"time": time})
    fit, _ = fitted(tmp_path / "fit", record["target_0"], record["position_0"])
    called = [p for p in fit.parameters if not p.refused]
    assert len(called) >= 5
    assert_found(called, but="delay")


def test_a_bound_holds():
    bounded = replace(line(white), lower=np.array([0.0, 0.0]))
    assert estimate(bounded).theta[1] == 0.0
