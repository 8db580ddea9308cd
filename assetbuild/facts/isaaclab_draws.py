"""What the modules for Isaac Lab must draw at the start, by the recipe's `randomize`."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.facts.reference import Reference
from assetbuild.facts.trainers import Drawn, Ranges, drawn, massive_bodies
from assetbuild.robot.ranges import Randomize, RandomJoint, RandomMatter, per_axis

MATERIALS = 64
"""Contact materials to draw from; PhysX has room for 64000 in all environments."""
UNCHANGED = (1.0, 1.0)


def expected_draws(reference: Reference, ranges: Ranges) -> Iterator[Drawn]:
    """By body, by joint, and of the robot as a whole."""
    if ranges.recipe is None:
        return
    for body in massive_bodies(reference):
        matter = ranges.body(body)
        yield from _matter(body, matter) if matter else ()
    for joint in reference.tree.moving_joints:
        yield from _joint(joint.name, ranges.joint(joint.name))
    yield from _material(reference, ranges.recipe)


def _matter(body: str, matter: RandomMatter) -> Iterator[Drawn]:
    if matter.density != UNCHANGED:
        yield drawn(
            "randomize_rigid_body_mass", "body", body,
            mass_distribution_params=matter.density, operation="scale", recompute_inertia=True,
        )  # fmt: skip
    most = per_axis(matter.com)
    if any(most):
        shift = {axis: (-value, value) for axis, value in zip("xyz", most, strict=True)}
        yield drawn("randomize_rigid_body_com", "body", body, com_range=shift)


def _joint(joint: str, varied: RandomJoint) -> Iterator[Drawn]:
    gains = {"stiffness": varied.kp, "damping": varied.kd}
    if (varied.kp, varied.kd) != (UNCHANGED, UNCHANGED):
        yield _scaled("randomize_actuator_gains", joint, gains)
    others = {"friction": varied.friction, "armature": varied.armature}
    factors = {name: factor for name, factor in others.items() if factor != UNCHANGED}
    if factors:
        yield _scaled("randomize_joint_parameters", joint, factors)


def _scaled(function: str, joint: str, factors: dict[str, tuple[float, float]]) -> Drawn:
    params = {f"{name}_distribution_params": factor for name, factor in factors.items()}
    return drawn(function, "joint", joint, operation="scale", **params)


def _material(reference: Reference, recipe: Randomize) -> Iterator[Drawn]:
    """What the recipe does not vary stays as the USD's materials have it."""
    if recipe.friction is None and recipe.restitution is None:
        return
    asked = reference.options.get("isaaclab") or {}
    slide = reference.control.contact.friction[0]
    friction = recipe.friction or (slide, slide)
    yield drawn(
        "randomize_rigid_body_material", "robot", "",
        static_friction_range=friction, dynamic_friction_range=friction,
        restitution_range=recipe.restitution or (0.0, 0.0), make_consistent=True,
        num_buckets=asked.get("friction_buckets", MATERIALS),
    )  # fmt: skip
