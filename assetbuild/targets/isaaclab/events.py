"""The recipe's `randomize` as event terms of Isaac Lab's managers; the terms of 2.3 and 3.0 agree.

Isaac Lab scales mass and inertia by one factor (`recompute_inertia`), which is a density exactly,
and shifts the centre of mass with the inertia about it unchanged, which is a shift of the matter
exactly. It has no term that stretches matter and none for a payload: adding mass scales the
inertia as if the body had become denser, which is wrong for a box on top of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.ranges import Randomize, claimed, per_axis
from assetbuild.simulators.usd_names import body_identifiers, joint_identifiers

IMPORTS = (
    "from isaaclab.envs import mdp",
    "from isaaclab.managers import EventTermCfg, SceneEntityCfg",
    "from isaaclab.utils import configclass",
)
BUCKETS = 64
"""Contact materials that are drawn; PhysX has room for 64000."""

NOT_RANDOMIZED = Rule(
    "isaaclab.randomize",
    "info",
    "what the recipe randomizes and Isaac Lab's events cannot: payloads, stretch, delay of "
    "implicit drives, encoder bias, effort; its range of joint friction varies viscous friction "
    "too",
    "`assetbuild sample`",
)


def lost(randomize: Randomize, control: Control, tree: Tree) -> Iterator[Finding]:
    """What these terms cannot do, and what they do besides."""
    rows = [ranges for _, ranges, _ in claimed(randomize.joints, _moving(tree))]
    drives = {a.joint: a for a in control.actuators}
    delayed = [
        joint
        for _, ranges, joints in claimed(randomize.joints, _moving(tree))
        if ranges.delay != (0, 0)
        for joint in joints
        if joint in drives and drives[joint].model != "ideal_pd"
    ]
    without = {
        "payloads": bool(randomize.payloads),
        "stretch and shear": any(m.stretch or m.shear for m in randomize.links.values()),
        "delay of drives that are not `ideal_pd`": bool(delayed),
        "encoder_bias": any(row.encoder_bias for row in rows),
        "effort": any(row.effort != (1.0, 1.0) for row in rows),
        "damping apart from friction": any(row.damping != row.friction for row in rows),
    }
    names = tuple(name for name, found in without.items() if found)
    if names:
        yield NOT_RANDOMIZED(
            "recipe randomize",
            f"Isaac Lab's events do not say all of it: {'; '.join(names)}",
            hint="`assetbuild sample` and dr.yaml do",
            data={"without": names},
        )


def events_text(randomize: Randomize, tree: Tree, control: Control) -> list[str]:
    """Lines of the class `EventCfg`."""
    terms = [*_matter(randomize, tree), *_joints(randomize, tree), *_friction(randomize, control)]
    return [
        "@configclass",
        "class EventCfg:",
        '    """What the recipe randomizes, for an entity named "robot"; sources stand in dr.yaml.',
        "",
        "    Drawn once, at startup: `randomize_rigid_body_com` of 2.x adds to the current value.",
        "    Densities and shifts leave an inertia that matter could have; whether that fits into",
        "    the link is asked by `assetbuild sample` alone. A range of joint friction varies",
        "    viscous friction too.",
        '    """',
        "",
        *[line for name, func, params in terms for line in _term(name, func, params)],
    ]


def _term(name: str, func: str, params: Mapping[str, str]) -> list[str]:
    return [
        f"    {name} = EventTermCfg(",
        f"        func=mdp.{func},",
        '        mode="startup",',
        "        params={",
        *(f'            "{key}": {value},' for key, value in params.items()),
        "        },",
        "    )",
    ]


Found = Iterator[tuple[str, str, dict[str, str]]]


def _matter(randomize: Randomize, tree: Tree) -> Found:
    """A density for each body; a shift for each, because one term moves all its bodies alike."""
    names = body_identifiers(tree)
    massive = [b.name for b in tree.bodies if b.inertial is not None and b.inertial.mass_kg > 0.0]
    for index, (_, matter, bodies) in enumerate(claimed(randomize.links, massive)):
        if matter.density != (1.0, 1.0):
            yield (
                f"density_{index}",
                "randomize_rigid_body_mass",
                {
                    "asset_cfg": _entity("body_names", [names[body] for body in bodies]),
                    "mass_distribution_params": repr(matter.density),
                    "operation": '"scale"',
                    "recompute_inertia": "True",
                },
            )
        shift = per_axis(matter.com)
        for body in bodies if any(shift) else ():
            ranges = {axis: (-most, most) for axis, most in zip("xyz", shift, strict=True)}
            yield (
                f"com_{names[body]}",
                "randomize_rigid_body_com",
                {
                    "asset_cfg": _entity("body_names", [names[body]]),
                    "com_range": repr(ranges).replace("'", '"'),
                },
            )


def _joints(randomize: Randomize, tree: Tree) -> Found:
    names = joint_identifiers(tree)
    for index, (_, ranges, joints) in enumerate(claimed(randomize.joints, _moving(tree))):
        entity = _entity("joint_names", [names[joint] for joint in joints])
        if (ranges.kp, ranges.kd) != ((1.0, 1.0), (1.0, 1.0)):
            yield (
                f"gains_{index}",
                "randomize_actuator_gains",
                {
                    "asset_cfg": entity,
                    "stiffness_distribution_params": repr(ranges.kp),
                    "damping_distribution_params": repr(ranges.kd),
                    "operation": '"scale"',
                },
            )
        scaled = {
            f"{key}_distribution_params": repr(getattr(ranges, key))
            for key in ("friction", "armature")
            if getattr(ranges, key) != (1.0, 1.0)
        }
        if scaled:
            params = {"asset_cfg": entity, **scaled, "operation": '"scale"'}
            yield f"joints_{index}", "randomize_joint_parameters", params


def _friction(randomize: Randomize, control: Control) -> Found:
    """Restitution 0 is what the USD's materials have."""
    if randomize.friction is not None or randomize.restitution is not None:
        slide = control.contact.friction[0]
        friction = randomize.friction or (slide, slide)
        yield (
            "material",
            "randomize_rigid_body_material",
            {
                "asset_cfg": 'SceneEntityCfg("robot")',
                "static_friction_range": repr(friction),
                "dynamic_friction_range": repr(friction),
                "restitution_range": repr(randomize.restitution or (0.0, 0.0)),
                "num_buckets": str(BUCKETS),
                "make_consistent": "True",
            },
        )


def _entity(field: str, names: Sequence[str]) -> str:
    """USD identifiers have no letter that a regular expression takes otherwise."""
    listed = ", ".join(f'"{name}"' for name in names)
    return f'SceneEntityCfg("robot", {field}=[{listed}])'


def _moving(tree: Tree) -> list[str]:
    return [joint.name for joint in tree.moving_joints]
