"""Pair by pair: does MJX know every contact of the mjx model, and which are fast on a GPU?

Two engines read the file. MJX (JAX) refuses a model with a pair of shapes that it has no function
for, even if the two never come near each other; mujoco_warp knows all, some by a fast closed form
and the rest by a general routine. Tables: MJX 3.17 (`collision_driver._COLLISION_FUNC`) and
mujoco_warp 4.0 (`collision_driver.MJ_COLLISION_TABLE`).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.pairs import explicit_pairs, touching_geoms

KINDS = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")
"""Kinds of shape, in the order of MuJoCo's geom types; a pair is named in this order."""
NOT_IN_MJX = frozenset(
    {("cylinder", "box"), ("cylinder", "mesh"), ("ellipsoid", "box"), ("ellipsoid", "mesh"),
     ("hfield", "cylinder"), ("hfield", "ellipsoid")}
)  # fmt: skip
FAST_ON_WARP = frozenset(
    {*(("plane", kind) for kind in KINDS[2:]),
     ("sphere", "sphere"), ("sphere", "capsule"), ("sphere", "cylinder"), ("sphere", "box"),
     ("capsule", "capsule"), ("capsule", "box")}
)  # fmt: skip
SOLVERS, INTEGRATORS = (1, 2), (0, 1, 3)
"""Numbers of MuJoCo's CG and Newton; of its Euler, RK4 and implicitfast."""
NET_FORCE = 3
"""Reduction of a contact sensor that MJX (JAX) does not do."""

Pair = tuple[int, int]
Kinds = tuple[str, str]

LOAD = Rule("mjx.load", "error", "MuJoCo refuses the mjx model", "see `mjcf.load`")
UNSUPPORTED_PAIR = Rule(
    "mjx.pair",
    "error",
    "two shapes may touch, and MJX has no contact for them",
    "make one a capsule, exclude the pairs, or `mjx: {self_collision: false}`",
)
MARGIN = Rule(
    "mjx.margin",
    "error",
    "a mesh has a contact margin, which MJX refuses",
    "leave `contact.margin` at 0, or use a primitive",
)
OPTION = Rule(
    "mjx.option", "error", "MJX does not have this option", "change it in the recipe's `mjx`"
)


class MjxPairs(mujoco.WithMujoco):
    """Findings `mjx.<what>`; figures: pairs by kinds, and how many are fast."""

    needs = ("mjx",)
    reads = ()

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `mjx/scene_mjx.xml`."""
        try:
            model = mujoco.load(files.inputs / "mjx" / "scene_mjx.xml", visuals=False).model
        except StepError as error:
            write_figures(files, {"skipped": "it does not load"})
            yield LOAD("robot", f"MuJoCo refuses it: {error.message}")
            return
        counts = {kinds: len(alike) for kinds, alike in pairs(model).items()}
        figures = {
            "pairs": sum(counts.values()),
            "fast_on_warp": sum(counts[kinds] for kinds in counts.keys() & FAST_ON_WARP),
            "by_kinds": {"-".join(kinds): counts[kinds] for kinds in sorted(counts)},
        }
        write_figures(files, figures)
        yield from judge(model)


def pairs(model: mujoco.Model) -> dict[Kinds, list[Pair]]:
    """Geoms that may touch, whatever lets them, by their kinds; in the order of their kinds."""
    by_kinds: dict[Kinds, list[Pair]] = {}
    for pair in (*touching_geoms(model), *explicit_pairs(model)):
        a, b = sorted(pair, key=lambda geom: int(model.geom_type[geom]))
        kinds = KINDS[int(model.geom_type[a])], KINDS[int(model.geom_type[b])]
        by_kinds.setdefault(kinds, []).append((a, b))
    return by_kinds


def judge(model: mujoco.Model) -> Iterator[Finding]:
    """What MJX would refuse."""
    by_kinds = pairs(model)
    for a, b in sorted(by_kinds.keys() & NOT_IN_MJX):
        one, other = (mujoco.name_of(model, "geom", geom) for geom in by_kinds[a, b][0])
        count = len(by_kinds[a, b])
        yield UNSUPPORTED_PAIR(
            f"shape {other}",
            f"MJX has no contact of {a} and {b}: {count} pairs, such as {one} and {other}",
            data={"pairs": count, "kinds": f"{a}-{b}"},
        )
    margins = [
        pair
        for kinds, alike in by_kinds.items()
        for pair in alike
        if {"mesh", "hfield"} & {*kinds} and model.geom_margin[list(pair)].any()
    ]
    if margins:
        yield MARGIN(
            f"shape {mujoco.name_of(model, 'geom', margins[0][1])}",
            f"MJX takes no margin on a mesh: {len(margins)} pairs have one",
            data={"pairs": len(margins)},
        )
    for what in _lacking(model):
        yield OPTION("robot", f"MJX does not do this: {what}")


def _lacking(model: mujoco.Model) -> Iterator[str]:
    if int(model.opt.integrator) not in INTEGRATORS:
        yield "integrator (Euler, RK4 or implicitfast)"
    if int(model.opt.solver) not in SOLVERS:
        yield "solver (Newton or CG)"
    if model.nflex:
        yield "flexible bodies"
    contact = model.sensor_type == int(mujoco.mj.mjtSensor.mjSENS_CONTACT)
    for sensor in np.flatnonzero(contact & (model.sensor_intprm[:, 1] == NET_FORCE)):
        yield f"net force of contact sensor {mujoco.name_of(model, 'sensor', int(sensor))}"
