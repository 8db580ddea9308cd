"""MuJoCo itself in place of Warp below mjlab: on a processor, steps are some twenty times faster.

`install()` before the environment is made. Each environment has a state of its own, each thread a
model; what mjlab reads is copied into Warp's arrays after each step, what it writes (states,
commands, forces, drawn model fields) is taken from them. mjlab's API as of 1.6; on a GPU leave it
alone.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import mujoco
import numpy as np

EACH_STEP = ("qpos", "qvel", "qacc", "sensordata", "actuator_force")
ON_FORWARD = (
    *EACH_STEP,
    *("xpos", "xquat", "xmat", "xipos", "ximat", "cvel", "subtree_com", "qfrc_actuator"),
    *("site_xpos", "site_xmat", "geom_xpos", "geom_xmat"),
)
CONSTANTS = ("body_subtreemass", "body_invweight0", "dof_invweight0", "dof_M0", "actuator_acc0")
"""Of a model, what follows from drawn fields."""


def install(threads: int) -> None:
    """From now on `mjlab.sim.Simulation` steps by MuJoCo."""
    from mjlab.sim.sim import Simulation

    def own(simulation: Any) -> Native:
        held = getattr(simulation, "native", None)
        if held is None or held.drawn != frozenset(simulation.expanded_fields):
            held = simulation.native = Native(simulation, threads)
        return held

    Simulation.step = lambda self: own(self).step()
    Simulation.forward = lambda self: own(self).forward()


class Native:
    """All environments of one simulation.

    drawn: names of the model's fields that differ between environments.
    """

    def __init__(self, simulation: Any, threads: int) -> None:
        self.drawn = frozenset(simulation.expanded_fields)
        self._simulation, self._pool = simulation, ThreadPoolExecutor(threads)
        count, data = simulation.num_envs, simulation.wp_data
        self._parts = np.array_split(np.arange(count), threads)
        self._models = [copy.copy(simulation.mj_model) for _ in range(threads)]
        self._datas = [mujoco.MjData(self._models[0]) for _ in range(count)]
        self._state = [getattr(data, name).numpy() for name in ("qpos", "qvel")]
        self._written = [np.full_like(values, np.nan) for values in self._state]
        self._asked = [getattr(data, name).numpy() for name in ("ctrl", "xfrc_applied")]
        fields = sorted(self.drawn | set(CONSTANTS)) if self.drawn else []
        start = {name: np.asarray(getattr(simulation.mj_model, name)) for name in fields}
        self._own = {name: np.repeat(value[None], count, axis=0) for name, value in start.items()}
        self._known: dict[str, np.ndarray] = {}
        arrays = {name: getattr(data, name).numpy() for name in ON_FORWARD}
        self._copies = {
            names: [
                [
                    (
                        arrays[name][i],
                        np.asarray(getattr(each, name)).reshape(arrays[name][i].shape),
                    )
                    for name in names
                    if arrays[name].size
                ]
                for i, each in enumerate(self._datas)
            ]
            for names in (EACH_STEP, ON_FORWARD)
        }

    def step(self) -> None:
        """One timestep of every environment."""
        self._run(mujoco.mj_step, EACH_STEP)

    def forward(self) -> None:
        """Everything that follows from positions, velocities and the drawn fields."""
        self._take_model()
        self._run(mujoco.mj_forward, ON_FORWARD)

    def _run(self, function: Callable[[Any, Any], None], names: tuple[str, ...]) -> None:
        self._take_state()
        commands, forces = self._asked
        copies = self._copies[names]

        def part(thread: int) -> None:
            model = self._models[thread]
            drawn = [(getattr(model, name), values) for name, values in self._own.items()]
            for i in self._parts[thread]:
                data = self._datas[i]
                for field, values in drawn:
                    field[...] = values[i]
                data.ctrl[:], data.xfrc_applied[:] = commands[i], forces[i]
                function(model, data)
                for theirs, ours in copies[i]:
                    theirs[...] = ours

        list(self._pool.map(part, range(len(self._models))))
        self._written = [values.copy() for values in self._state]

    def _take_state(self) -> None:
        """Of environments that mjlab has put elsewhere: resets and pushes."""
        pairs = zip(self._state, self._written, strict=True)
        moved = np.any([(now != before).any(axis=1) for now, before in pairs], axis=0)
        for i in np.flatnonzero(moved):
            data = self._datas[i]
            data.qpos[:], data.qvel[:] = (values[i] for values in self._state)
            data.qacc_warmstart[:] = 0.0

    def _take_model(self) -> None:
        """What events have drawn since; what follows from it is computed again."""
        changed = False
        for name in self.drawn:
            values = getattr(self._simulation.wp_model, name).numpy()
            if not np.array_equal(self._known.get(name), values):
                self._known[name] = values.copy()
                self._own[name][...] = values.reshape(self._own[name].shape)
                changed = True
        if not changed:
            return
        model, data = self._models[0], mujoco.MjData(self._models[0])
        for i in range(len(self._datas)):
            for name in self.drawn:
                getattr(model, name)[...] = self._own[name][i]
            mujoco.mj_setConst(model, data)
            for name in CONSTANTS:
                self._own[name][i] = getattr(model, name)
