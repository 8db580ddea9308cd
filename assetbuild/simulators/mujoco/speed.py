"""How fast MuJoCo steps a robot that falls and lies on a floor, and what touches meanwhile.

Run as a program with the path of a scene: it prints one JSON object. A child process measures
its own CPU time, undisturbed by what the parent has loaded.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from assetbuild.simulators.mujoco import (
    Data,
    Model,
    at_key,
    caught_warnings,
    collision_geoms,
    floats,
    load,
    raise_base,
    without,
)

STEPS = 1500
REPEATS = 3
LIFT_M = 0.1
TILT = (0.95, 0.2, 0.2, 0.1)
"""A floating base starts this much higher and turned, so that it lands on more than its feet."""
KICK_RAD_S = 1.0
"""A fixed robot is set moving instead: joint speeds up to this, seeded."""


@dataclass(frozen=True)
class Speed:
    """steps_per_s: of CPU time, median of three; contacts: mean per step.

    geoms: that collide. self_contacts, deepest_mm: between the robot's own bodies in the
    initial pose; depth is positive.
    """

    steps_per_s: float
    contacts: float
    geoms: int
    self_contacts: int
    deepest_mm: float


def measure_speed(scene: Path) -> Speed:
    """Drop, without drives. Raises StepError when MuJoCo refuses the file."""
    import mujoco

    with caught_warnings():
        model = without(load(scene).model, "ACTUATION")
        data = at_key(model)
        touching_now = data.contact[: data.ncon]
        own = [c.dist for c in touching_now if model.geom_bodyid[[c.geom1, c.geom2]].all()]
        rates, touching = [], 0
        for _ in range(REPEATS):
            data = _moved(model)
            before = time.process_time()
            for _ in range(STEPS):
                mujoco.mj_step(model, data)
            rates.append(STEPS / max(time.process_time() - before, 1e-9))
        data = _moved(model)
        for _ in range(STEPS):
            mujoco.mj_step(model, data)
            touching += data.ncon
    return Speed(
        steps_per_s=float(np.median(rates)),
        contacts=touching / STEPS,
        geoms=len(collision_geoms(model)),
        self_contacts=len(own),
        deepest_mm=max(0.0, -1e3 * min(own, default=0.0)),
    )


def _moved(model: Model) -> Data:
    """The initial pose, lifted and turned, or kicked."""
    data = at_key(model)
    if floats(model):
        raise_base(model, data, LIFT_M)
        data.qpos[3:7] = np.asarray(TILT) / np.linalg.norm(TILT)
    else:
        data.qvel[:] = np.random.default_rng(0).uniform(-KICK_RAD_S, KICK_RAD_S, model.nv)
    return data


if __name__ == "__main__":
    print(json.dumps(asdict(measure_speed(Path(sys.argv[1])))))  # noqa: T201 # its answer
