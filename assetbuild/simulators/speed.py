"""How fast MuJoCo steps a robot that falls and lies on a floor, and how well it touches things.

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

from assetbuild.simulators import mujoco
from assetbuild.simulators.gripping import GripWish
from assetbuild.simulators.mujoco import Data, Model, mj
from assetbuild.simulators.mujoco.grip import grip, hands_of, tries_of, with_object
from assetbuild.simulators.mujoco.slope import creep

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

    geoms: that collide. self_contacts, deepest_mm: pairs of shapes of the robot's own bodies in the
    initial pose; depth is positive. creep_mm_s: of a standing robot on a slope; None where it does
    not stand. held: `5 of 6` objects in the hands that are found without keyframes; else empty.
    """

    steps_per_s: float
    contacts: float
    geoms: int
    self_contacts: int
    deepest_mm: float
    creep_mm_s: float | None = None
    held: str = ""


def measure_speed(scene: Path) -> Speed:
    """Drop, without drives. Raises StepError when MuJoCo refuses the file."""
    with mujoco.caught_warnings():
        whole = mujoco.load(scene).model
        model = mujoco.without(whole, "ACTUATION")
        data = mujoco.at_key(model)
        self_contacts = mujoco.overlaps(model, data, "geom")
        rates = []
        for _ in range(REPEATS):
            data, before = _moved(model), time.process_time()
            mj.mj_step(model, data, STEPS)
            rates.append(STEPS / max(time.process_time() - before, 1e-9))
        data, touching = _moved(model), 0
        for _ in range(STEPS):
            mj.mj_step(model, data)
            touching += data.ncon
    sliding, grips, wish = creep(whole), [], GripWish()
    robots = [path for path in scene.parent.glob("*.xml") if not path.stem.startswith("scene")]
    for robot in map(with_object, robots):
        for hand in hands_of(robot, None):
            grips += [grip(robot, hand, *one) for one in tries_of(robot, hand, wish.masses)]
    good = sum(one.held and one.slip_m <= wish.slip for one in grips)
    return Speed(
        steps_per_s=float(np.median(rates)),
        contacts=touching / STEPS,
        geoms=len(mujoco.collision_geoms(model)),
        self_contacts=len(self_contacts),
        deepest_mm=1e3 * max(self_contacts.values(), default=0.0),
        creep_mm_s=None if isinstance(sliding, str) else 1e3 * sliding.speed,
        held=f"{good} of {len(grips)}" if grips else "",
    )


def _moved(model: Model) -> Data:
    """The initial pose, lifted and turned, or kicked."""
    data = mujoco.at_key(model)
    if mujoco.floats(model):
        mujoco.raise_base(model, data, LIFT_M)
        data.qpos[3:7] = np.asarray(TILT) / np.linalg.norm(TILT)
    else:
        data.qvel[:] = np.random.default_rng(0).uniform(-KICK_RAD_S, KICK_RAD_S, model.nv)
    return data


if __name__ == "__main__":
    print(json.dumps(asdict(measure_speed(Path(sys.argv[1])))))  # noqa: T201 # its answer
