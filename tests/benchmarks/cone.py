"""What the solver options of an mjx file cost: its own beside a pyramidal cone and 4 iterations.

    python tests/benchmarks/cone.py [--gpu] build/go2/mjcf/scene_mjx.xml...

Steps per CPU second in MuJoCo on one core, and in mujoco_warp and MJX where they are installed,
from the initial pose with a little noise on the commands. With `--gpu` both run there, in more
worlds, by the clock. Only the ratios of one run mean anything. Nothing of assetbuild is imported.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections.abc import Callable

import mujoco
import numpy as np

STEPS, REPEATS = 20, 3
WORLDS, WORLDS_GPU = 64, 2048
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


def best(run: Callable[[], None], steps: int, clock: Callable[[], float]) -> float:
    """Steps per second of the fastest of some runs; the first one compiles."""
    run()
    seconds = []
    for _ in range(REPEATS):
        begun = clock()
        run()
        seconds.append(clock() - begun)
    return steps / min(seconds)


def in_mujoco(path: str, options: dict[str, float], gpu: bool) -> float:
    """One world on one core."""
    model, data = start(path, options)
    return best(lambda: mujoco.mj_step(model, data, 2000), 2000, time.process_time)


def in_warp(path: str, options: dict[str, float], gpu: bool) -> float:
    """Many worlds; on a GPU a step is one captured graph, as mjlab runs it."""
    import mujoco_warp
    import warp

    count = WORLDS_GPU if gpu else WORLDS
    with warp.ScopedDevice("cuda:0" if gpu else "cpu"):
        model, data = start(path, options)
        there = mujoco_warp.put_model(model)
        worlds = mujoco_warp.put_data(model, data, nworld=count, njmax=200, nconmax=60)
        mujoco_warp.step(there, worlds)
        if gpu:
            with warp.ScopedCapture() as capture:
                mujoco_warp.step(there, worlds)

        def run() -> None:
            for _ in range(STEPS):
                if gpu:
                    warp.capture_launch(capture.graph)
                else:
                    mujoco_warp.step(there, worlds)
            warp.synchronize()

        return best(run, STEPS * count, time.perf_counter if gpu else time.process_time)


def in_mjx(path: str, options: dict[str, float], gpu: bool) -> float:
    """Many worlds, each as slow as the slowest."""
    import jax
    from mujoco import mjx

    count = WORLDS_GPU if gpu else WORLDS
    model, data = start(path, options)
    there, one = mjx.put_model(model), mjx.put_data(model, data)
    worlds = jax.tree.map(lambda x: np.repeat(np.asarray(x)[None], count, 0), one)
    step = jax.jit(
        jax.vmap(lambda d: jax.lax.fori_loop(0, STEPS, lambda _, d: mjx.step(there, d), d))
    )
    clock = time.perf_counter if gpu else time.process_time
    return best(lambda: jax.block_until_ready(step(worlds)), STEPS * count, clock)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+")
    parser.add_argument("--gpu", action="store_true")
    asked = parser.parse_args()
    there = {"MuJoCo": ("mujoco", in_mujoco), "Warp": ("mujoco_warp", in_warp)}
    there["MJX"] = ("mujoco.mjx", in_mjx)
    engines = {n: run for n, (module, run) in there.items() if importlib.util.find_spec(module)}
    print("| file | engine | pyramidal, 4 iterations | as it is | times |")
    print("| --- | --- | --- | --- | --- |")
    for path in asked.files:
        for name, run in engines.items():
            former, now = (run(path, options, asked.gpu) for options in (FORMER, {}))
            print(f"| {path} | {name} | {former:.0f} | {now:.0f} | {former / now:.2f} |")


if __name__ == "__main__":
    main()
