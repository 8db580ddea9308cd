"""What the module for mjlab must draw at the start, by the recipe's `randomize`.

`dr.pseudo_inertia` turns a body's J into U J Uᵀ with U = exp(alpha) [[A, t], [0, 1]] about the
body's origin, so its mass grows by exp(2 alpha).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from assetbuild.facts.reference import Reference
from assetbuild.facts.trainers import Drawn, Ranges, drawn, massive_bodies
from assetbuild.robot.pose import Pose, rotation_of
from assetbuild.robot.ranges import RandomJoint, RandomMatter, RandomPayload, per_axis

LOOPS = ("pd", "ideal_pd", "dc_motor")
"""Drives that hold a position, which mjlab's terms for gains and effort know."""
COLLISION = (r".*_collision\d*",)
UNCHANGED = (1.0, 1.0)


def expected_draws(reference: Reference, ranges: Ranges) -> Iterator[Drawn]:
    """By body, by joint, and of the robot as a whole."""
    if ranges.recipe is None:
        return
    massive, rows = massive_bodies(reference), reference.control.by_joint
    for body in massive:
        matter = ranges.body(body)
        if matter is not None:
            yield drawn("pseudo_inertia", "body", body, **dict(_matter(matter)))
    for payload in ranges.recipe.payloads:
        body, X_body_link = reference.tree.placement(payload.link)
        if body in massive:
            box = _box(payload, X_body_link)
            yield drawn("carry_payload", "body", body, mass_range=payload.mass, box=box)
    for joint in reference.tree.moving_joints:
        row = rows.get(joint.name)
        is_loop = row is not None and row.model in LOOPS
        is_limited = is_loop and row is not None and row.effort is not None
        varied = ranges.joint(joint.name)
        yield from _drive(joint.name, varied, is_loop=is_loop, is_limited=is_limited)
        yield from _joint(joint.name, varied)
    if ranges.recipe.friction is not None:
        same = {"geom_names": COLLISION, "axes": (0,), "shared_random": True, "operation": "abs"}
        yield drawn("geom_friction", "robot", "", ranges=ranges.recipe.friction, **same)


def replaced_events(reference: Reference, ranges: Ranges) -> tuple[str, ...]:
    """Events of mjlab's velocity task that would draw the same once more."""
    recipe = ranges.recipe
    if recipe is None:
        return ()
    root = reference.tree.root
    twice = {
        "base_com": root in massive_bodies(reference) and ranges.body(root) is not None,
        "encoder_bias": any(joint.encoder_bias for joint in recipe.joints.values()),
        "foot_friction": recipe.friction is not None,
    }
    return tuple(name for name, found in twice.items() if found)


def _matter(matter: RandomMatter) -> Iterator[tuple[str, tuple[float, float]]]:
    low, high = matter.density
    yield "alpha_range", (math.log(low) / 2, math.log(high) / 2)
    for axis, most in enumerate(per_axis(matter.com), start=1):
        yield f"t{axis}_range", (-most, most)
    if matter.stretch:
        yield "d_range", (-matter.stretch, matter.stretch)
    for pair in ("12", "13", "23") if matter.shear else ():
        yield f"s{pair}_range", (-matter.shear, matter.shear)


def _box(payload: RandomPayload, X_body_link: Pose) -> tuple[float, ...]:
    """(16,) [[S, h], [h, 1]] of one kilogram: second moments e²/12 along its edges, m²."""
    turn = rotation_of(X_body_link.quat)
    centre = turn @ np.array(payload.at) + np.array(X_body_link.xyz)
    second = turn @ np.diag(np.square(payload.size) / 12.0) @ turn.T
    matter = np.eye(4)
    matter[:3, :3] = second + np.outer(centre, centre)
    matter[:3, 3] = matter[3, :3] = centre
    return tuple(map(float, matter.ravel()))


def _drive(joint: str, varied: RandomJoint, *, is_loop: bool, is_limited: bool) -> Iterator[Drawn]:
    if is_loop and (varied.kp, varied.kd) != (UNCHANGED, UNCHANGED):
        yield drawn("pd_gains", "joint", joint, kp_range=varied.kp, kd_range=varied.kd)
    if is_limited and varied.effort != UNCHANGED:
        yield drawn("effort_limits", "joint", joint, effort_limit_range=varied.effort)


def _joint(joint: str, varied: RandomJoint) -> Iterator[Drawn]:
    for quantity in ("damping", "friction", "armature"):
        factor = getattr(varied, quantity)
        if factor != UNCHANGED:
            yield drawn(f"joint_{quantity}", "joint", joint, ranges=factor, operation="scale")
    if varied.encoder_bias:
        most = varied.encoder_bias
        yield drawn("encoder_bias", "joint", joint, bias_range=(-most, most))
