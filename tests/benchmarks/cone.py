"""What the solver options of an mjx file cost: its own beside a pyramidal cone and 4 iterations.

    python -m tests.benchmarks.cone build/go2/mjcf/scene_mjx.xml

Steps per CPU second in MuJoCo on one core, and on the CPU in mujoco_warp and MJX where they are
installed, from the initial pose with a little noise on the commands. Only the ratios of one run
mean anything; a GPU has others.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable

import mujoco
import numpy as np

WORLDS, STEPS, REPEATS = 64, 20, 3
FORMER = {"cone": 0, "impratio": 1.0, "iterations": 4, "ls_iterations": 8}


def start(path: str, options: dict[str, float]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A robot that stands, with noise of 0.1 rad on its commands."""
    model = mujoco.MjModel.from_xml_path(path)
    for name, value in options.items():
        setattr(model.opt, name, value)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, 50)
    data.ctrl[:] += np.random.default_rng(0).normal(0.0, 0.1, model.nu)
    return model, data


def best(run: Callable[[], None], steps: int) -> float:
    """Steps per CPU second of the fastest of some runs; the first one compiles."""
    run()
    seconds = []
    for _ in range(REPEATS):
        begun = time.process_time()
        run()
        seconds.append(time.process_time() - begun)
    return steps / min(seconds)


def in_mujoco(path: str, options: dict[str, float]) -> float:
    """One world on one core."""
    model, data = start(path, options)
    return best(lambda: mujoco.mj_step(model, data, 2000), 2000)


def in_warp(path: str, options: dict[str, float]) -> float:
    """Many worlds on the CPU."""
    import mujoco_warp
    import warp

    with warp.ScopedDevice("cpu"):
        model, data = start(path, options)
        there = mujoco_warp.put_model(model)
        there.opt.warn_overflow = 0
        worlds = mujoco_warp.put_data(model, data, nworld=WORLDS, njmax=200, nconmax=60)

        def run() -> None:
            for _ in range(STEPS):
                mujoco_warp.step(there, worlds)
            warp.synchronize()

        return best(run, STEPS * WORLDS)


def in_mjx(path: str, options: dict[str, float]) -> float:
    """Many worlds on the CPU, each as slow as the slowest."""
    import jax
    from mujoco import mjx

    model, data = start(path, options)
    there, one = mjx.put_model(model), mjx.put_data(model, data)
    worlds = jax.tree.map(lambda x: np.repeat(np.asarray(x)[None], WORLDS, 0), one)
    step = jax.jit(
        jax.vmap(lambda d: jax.lax.fori_loop(0, STEPS, lambda _, d: mjx.step(there, d), d))
    )
    return best(lambda: jax.block_until_ready(step(worlds)), STEPS * WORLDS)


def main(paths: list[str]) -> None:
    """Print a table."""
    there = {"MuJoCo": ("mujoco", in_mujoco), "Warp": ("mujoco_warp", in_warp)}
    there["MJX"] = ("mujoco.mjx", in_mjx)
    engines = {n: run for n, (module, run) in there.items() if importlib.util.find_spec(module)}
    print("| file | engine | pyramidal, 4 iterations | as it is | times |")
    print("| --- | --- | --- | --- | --- |")
    for path in paths:
        for name, run in engines.items():
            former, now = run(path, FORMER), run(path, {})
            print(f"| {path} | {name} | {former:.0f} | {now:.0f} | {former / now:.2f} |")


if __name__ == "__main__":
    main(sys.argv[1:])
