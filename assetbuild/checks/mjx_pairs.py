"""Pair by pair: does MJX know every contact of the mjx model, and which are fast on a GPU?

Two engines read the file. MJX (JAX) refuses a model with a pair of shapes that it has no function
for, even if the two never come near each other; mujoco_warp knows all, some by a fast closed form
and the rest by a general routine. Tables: MJX 3.17 (`collision_driver._COLLISION_FUNC`) and
mujoco_warp 4.0 (`collision_driver.MJ_COLLISION_TABLE`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.pairs import explicit_pairs, touching_geoms

KINDS = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")
"""By the number of MuJoCo's geom type; a pair is named in this order."""
NOT_IN_MJX = frozenset(
    {("cylinder", "box"), ("cylinder", "mesh"), ("ellipsoid", "box"), ("ellipsoid", "mesh"),
     ("hfield", "cylinder"), ("hfield", "ellipsoid")}
)  # fmt: skip
FAST_ON_WARP = frozenset(
    {*(("plane", kind) for kind in KINDS[2:]),
     ("sphere", "sphere"), ("sphere", "capsule"), ("sphere", "cylinder"), ("sphere", "box"),
     ("capsule", "capsule"), ("capsule", "box")}
)  # fmt: skip
SOLVERS = {1: "CG", 2: "Newton"}
INTEGRATORS = {0: "Euler", 1: "RK4", 3: "implicitfast"}
NET_FORCE = 3
"""Reduction of a contact sensor that MJX (JAX) does not do."""

Pair = tuple[int, int]

LOAD = Rule("mjx.load", "error", "MuJoCo refuses the mjx model", "see `mjcf.load`")
UNSUPPORTED_PAIR = Rule(
    "mjx.pair",
    "error",
    "two shapes may touch, and MJX has no contact for them",
    "use a capsule in place of a cylinder, or exclude the pairs",
)
MARGIN = Rule(
    "mjx.margin",
    "error",
    "a mesh has a contact margin, which MJX refuses",
    "leave `contact.margin` at 0",
)
SLOW_PAIR = Rule(
    "mjx.slow_pair",
    "info",
    "mujoco_warp solves these pairs by its general routine",
    "spheres and capsules are fast",
)
OPTION = Rule("mjx.option", "error", "MJX does not have this option", "change it under `mjx`")


class MjxPairs(Check):
    """Findings `mjx.<what>`; figures: pairs by kinds, and how many are fast."""

    isolated = True
    preload = ("mujoco",)
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
        write_figures(files, figures(model))
        yield from judge(model)


def judge(model: mujoco.Model) -> Iterator[Finding]:
    """What MJX would refuse, and what is slow on mujoco_warp."""
    yield from _judge_pairs(model)
    yield from _judge_options(model)


def figures(model: mujoco.Model) -> dict[str, object]:
    """Number of pairs by their kinds, and in all."""
    counts = Counter(_kinds(model, pair) for pair in pairs(model))
    fast = sum(count for kinds, count in counts.items() if kinds in FAST_ON_WARP)
    return {
        "pairs": sum(counts.values()),
        "fast_on_warp": fast,
        "by_kinds": {"-".join(kinds): counts[kinds] for kinds in sorted(counts)},
    }


def pairs(model: mujoco.Model) -> Iterator[Pair]:
    """Geoms that may touch, whatever lets them."""
    for a, b in touching_geoms(model):
        yield (a, b) if model.geom_type[a] <= model.geom_type[b] else (b, a)
    yield from explicit_pairs(model)


def _kinds(model: mujoco.Model, pair: Pair) -> tuple[str, str]:
    kinds = sorted(int(model.geom_type[geom]) for geom in pair)
    return KINDS[kinds[0]], KINDS[kinds[1]]


def _judge_pairs(model: mujoco.Model) -> Iterator[Finding]:
    refused: dict[tuple[str, str], list[Pair]] = {}
    slow: dict[tuple[str, str], list[Pair]] = {}
    margins: list[Pair] = []
    for pair in pairs(model):
        kinds = _kinds(model, pair)
        if kinds in NOT_IN_MJX:
            refused.setdefault(kinds, []).append(pair)
        elif kinds not in FAST_ON_WARP:
            slow.setdefault(kinds, []).append(pair)
        if {"mesh", "hfield"} & set(kinds) and any(model.geom_margin[g] for g in pair):
            margins.append(pair)
    for (a, b), found in refused.items():
        yield UNSUPPORTED_PAIR(
            f"shape {_name(model, found[0][1])}",
            f"MJX has no contact of {a} and {b}: {len(found)} pairs, such as "
            f"{_name(model, found[0][0])} and {_name(model, found[0][1])}",
            hint="make one a capsule, exclude the pairs, or `mjx: {self_collision: false}`",
            data={"pairs": len(found), "kinds": f"{a}-{b}"},
        )
    if margins:
        yield MARGIN(
            f"shape {_name(model, margins[0][1])}",
            f"MJX takes no margin on a mesh: {len(margins)} pairs have one",
            hint="leave `contact.margin` at 0, or use a primitive",
            data={"pairs": len(margins)},
        )
    if slow:
        total = sum(map(len, slow.values()))
        shown = ", ".join(f"{len(found)} {a}-{b}" for (a, b), found in slow.items())
        yield SLOW_PAIR(
            "robot",
            f"mujoco_warp takes its general routine for {total} pairs: {shown}",
            hint="spheres and capsules have a closed form with planes and boxes",
            data={"pairs": total},
        )


def _judge_options(model: mujoco.Model) -> Iterator[Finding]:
    import mujoco as mj

    said = []
    if int(model.opt.integrator) not in INTEGRATORS:
        said.append("integrator (Euler, RK4 or implicitfast)")
    if int(model.opt.solver) not in SOLVERS:
        said.append("solver (Newton or CG)")
    if model.nflex:
        said.append("flexible bodies")
    for i in range(model.nsensor):
        is_contact = int(model.sensor_type[i]) == int(mj.mjtSensor.mjSENS_CONTACT)
        if is_contact and int(model.sensor_intprm[i, 1]) == NET_FORCE:
            said.append(f"net force of contact sensor {mujoco.name_of(model, 'sensor', i)}")
    for what in said:
        yield OPTION(
            "robot", f"MJX does not do this: {what}", hint="change it in the recipe's `mjx`"
        )


def _name(model: mujoco.Model, geom: int) -> str:
    return mujoco.name_of(model, "geom", geom)
