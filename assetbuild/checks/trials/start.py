"""How the robot starts: inside itself, inside the floor, or with nothing that can touch a floor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from assetbuild.findings import Finding, Rule
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import trials as mujoco_trials

DEEP_M = 0.001
"""Two bodies may overlap by this at the start: hulls are a little rounder than meshes."""
START_M = 0.005
"""A robot that starts deeper in itself or in the floor is thrown off, and is not ready."""

OVERLAP = Rule(
    "trials.overlap",
    "warning",
    "two bodies touch in almost all random poses, or are inside each other where the robot starts "
    "(by more than 5 mm: not ready)",
    "exclude the pair, or use smaller shapes; in the second case another pose helps, too",
)
FLOOR = Rule(
    "trials.floor",
    "warning",
    "a moving body starts inside the floor of the scene (by more than 5 mm: not ready)",
    "turn or raise the keyframe `home`",
)
NOTHING_TOUCHES = Rule(
    "trials.nothing_touches",
    "warning",
    "the robot floats and none of its shapes can touch a floor, so it is not ready",
    "give it collision shapes; where it never touches a floor, waive the rule with the reason",
    blocks=True,
)


def overlapping(
    model: mujoco.Model, pairs: Mapping[tuple[str, str], float], poses: int, always: float
) -> Iterator[Finding]:
    """Bodies inside one another at the start, or in almost all random poses.

    pairs: bodies -> share of the poses in which they touch; always: the share that is too much.
    """
    at_home = mujoco_trials.overlaps_at_home(model)
    for (a, b), share in pairs.items():
        if share >= always and at_home.get((a, b), 0.0) <= START_M:
            yield OVERLAP(
                f"link {a}",
                f"runs into {b} in {share:.0%} of {poses} random poses",
                hint=f"`collision.exclude.pairs: [[{a}, {b}]]`, or smaller shapes",
                data={"share": share, "poses": poses},
            )
    for (a, b), depth in at_home.items():
        usual = pairs.get((a, b), 0.0) >= always
        if depth > START_M or (depth >= DEEP_M and not usual):
            yield OVERLAP(
                f"link {a}",
                f"lies {depth * 1e3:.3g} mm in {b} where it starts: PhysX throws them apart",
                hint=f"another pose, `collision.exclude.pairs: [[{a}, {b}]]`, or smaller shapes",
                data={"depth_m": depth, "limit_m": START_M},
                blocks=depth > START_M,
            )


def starting(model: mujoco.Model, figures: dict[str, object]) -> Iterator[Finding]:
    """What of the robot starts inside the floor; whether anything of it can touch a floor."""
    free = mujoco_trials.stands_free(model)
    placed = model.nkey or not free  # where a free robot starts, a keyframe alone says
    depths = mujoco_trials.depths_in_floor(model) if placed else {}
    figures["in_floor"] = [{"body": body, "depth_m": depth} for body, depth in depths.items()]
    for body, depth in depths.items():
        if depth >= DEEP_M:
            yield FLOOR(
                f"link {body}",
                f"starts {depth * 1e3:.3g} mm inside the floor (limit {START_M * 1e3:g} mm): "
                "simulators throw it off or jam it",
                hint="turn or raise the keyframe `home`",
                data={"depth_m": depth, "limit_m": START_M},
                blocks=depth > START_M,
            )
    if free and not mujoco_trials.touches_floors(model):
        yield NOTHING_TOUCHES(
            "robot",
            "it floats, and none of its shapes can touch the floor: it falls through",
            hint="give it collision shapes; where it never lands, state that in `rules: "
            '{trials.nothing_touches: {severity: info, because: "..."}}`',
        )
