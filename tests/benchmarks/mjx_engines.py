"""One engine takes an mjx model and makes 100 steps from its first keyframe; prints one line.

    PYTHON tests/benchmarks/mjx_engines.py mjx|warp SCENE [STEPS]

PYTHON: of an environment with mujoco-mjx or mujoco-warp (and warp-lang); nothing of assetbuild is
imported. JAX and Warp on the processor: what is shown is that they take the model and stay finite.
"""

from __future__ import annotations

import json
import os
import sys
import time


def with_mjx(model, data, steps: int):  # type: ignore[no-untyped-def] # mujoco's
    """(qpos after the steps, seconds of the first, seconds of the others)."""
    import jax
    import numpy as np
    from mujoco import mjx

    there, state = mjx.put_model(model), mjx.put_data(model, data)
    step = jax.jit(mjx.step)
    start = time.perf_counter()
    state = step(there, state)
    state.qpos.block_until_ready()
    middle = time.perf_counter()
    for _ in range(steps - 1):
        state = step(there, state)
    return np.asarray(state.qpos), middle - start, time.perf_counter() - middle


def with_warp(model, data, steps: int):  # type: ignore[no-untyped-def] # mujoco's
    """The same in mujoco_warp, one world."""
    import mujoco_warp as mjw
    import warp as wp

    wp.config.quiet = True
    there, state = mjw.put_model(model), mjw.put_data(model, data, nconmax=400, njmax=2000)
    start = time.perf_counter()
    mjw.step(there, state)
    wp.synchronize()
    middle = time.perf_counter()
    for _ in range(steps - 1):
        mjw.step(there, state)
    qpos = state.qpos.numpy()[0]
    return qpos, middle - start, time.perf_counter() - middle


def main(engine: str, scene: str, steps: str = "100") -> None:
    """Prints a JSON object, or {"refused": why}."""
    import mujoco
    import numpy as np

    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    os.environ.setdefault("CUDA_VISIBLE_DEVICES", "")
    model = mujoco.MjModel.from_xml_path(scene)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    run = with_mjx if engine == "mjx" else with_warp
    try:
        qpos, first, rest = run(model, data, int(steps))
    except NotImplementedError as error:
        print(json.dumps({"refused": str(error)}))
        return
    found = {
        "finite": bool(np.isfinite(qpos).all()),
        "moved": float(np.abs(qpos - data.qpos).max()),
        "first_s": round(first, 2),
        "others_s": round(rest, 2),
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
