"""The recipe's `randomize` as event terms of Isaac Lab's managers; the terms of 2.3 and 3.0 agree.

Isaac Lab scales mass and inertia by one factor (`recompute_inertia`), which is a density exactly,
and shifts the centre of mass with the inertia about it unchanged, which is a shift of the matter
exactly. It has no term that stretches matter and none for a payload: adding mass scales the
inertia as if the body had become denser, which is wrong for a box on top of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.ranges import Randomize, per_axis
from assetbuild.simulators.usd_names import body_identifiers, joint_identifiers

IMPORTS = (
    "from isaaclab.envs import mdp",
    "from isaaclab.managers import EventTermCfg, SceneEntityCfg",
    "from isaaclab.utils import configclass",
)

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
    groups = randomize.of_joints(tree)
    rows = [ranges for _, ranges, _ in groups]
    delayed = {joint for _, ranges, joints in groups if ranges.delay != (0, 0) for joint in joints}
    without = {
        "payloads": bool(randomize.payloads),
        "stretch and shear": any(m.stretch or m.shear for m in randomize.links.values()),
        "delay of drives that are not `ideal_pd`": any(
            a.joint in delayed and a.model != "ideal_pd" for a in control.actuators
        ),
        "encoder_bias": any(row.encoder_bias for row in rows),
        "effort": any(row.effort != (1.0, 1.0) for row in rows),
        "damping apart from friction": any(row.damping != row.friction for row in rows),
    }
    names = tuple(name for name, requested in without.items() if requested)
    if names:
        yield NOT_RANDOMIZED(
            "recipe randomize",
            f"Isaac Lab's events do not say all of it: {'; '.join(names)}",
            hint="`assetbuild sample` and dr.yaml do",
            data={"without": names},
        )


def events_text(randomize: Randomize, tree: Tree, control: Control, buckets: int) -> str:
    """The class `EventCfg`. buckets: contact materials that are drawn."""
    terms = [
        *_matter(randomize, tree),
        *_joints(randomize, tree),
        *_friction(randomize, control, buckets),
    ]
    return f'''@configclass
class EventCfg:
    """What the recipe randomizes, for an entity named "robot"; sources stand in dr.yaml.

    Drawn once, at startup: `randomize_rigid_body_com` of 2.x adds to the current value.
    Densities and shifts leave an inertia that matter could have; whether that fits into
    the link is asked by `assetbuild sample` alone. A range of joint friction varies
    viscous friction too.
    """
{"".join(terms)}'''


def call(head: str, arguments: Iterable[str], depth: int, brackets: str = "()") -> str:
    """`head(` ... `)` on a line that is `depth` times indented, a line for each argument."""
    pad = "    " * depth
    inner = "".join(f"\n{pad}    {argument}," for argument in arguments)
    return f"{head}{brackets[0]}{inner}\n{pad}{brackets[1]}"


def _term(name: str, func: str, entity: str, **params: object) -> str:
    literals = [f'"{key}": {value!r}'.replace("'", '"') for key, value in params.items()]
    values = call("params=", (f'"asset_cfg": {entity}', *literals), 2, "{}")
    return "\n    " + call(
        f"{name} = EventTermCfg", (f"func=mdp.{func}", 'mode="startup"', values), 1
    )


def _matter(randomize: Randomize, tree: Tree) -> Iterator[str]:
    """A density for each body; a shift for each, because one term moves all its bodies alike."""
    names = body_identifiers(tree)
    for index, (_, matter, bodies) in enumerate(randomize.of_bodies(tree)):
        if matter.density != (1.0, 1.0):
            yield _term(
                f"density_{index}",
                "randomize_rigid_body_mass",
                _entity("body_names", [names[body] for body in bodies]),
                mass_distribution_params=matter.density,
                operation="scale",
                recompute_inertia=True,
            )
        shift = per_axis(matter.com)
        ranges = {axis: (-most, most) for axis, most in zip("xyz", shift, strict=True)}
        for body in bodies if any(shift) else ():
            name, entity = f"com_{names[body]}", _entity("body_names", [names[body]])
            yield _term(name, "randomize_rigid_body_com", entity, com_range=ranges)


def _joints(randomize: Randomize, tree: Tree) -> Iterator[str]:
    names = joint_identifiers(tree)
    for index, (_, ranges, joints) in enumerate(randomize.of_joints(tree)):
        entity = _entity("joint_names", [names[joint] for joint in joints])
        if (ranges.kp, ranges.kd) != ((1.0, 1.0), (1.0, 1.0)):
            yield _term(
                f"gains_{index}",
                "randomize_actuator_gains",
                entity,
                stiffness_distribution_params=ranges.kp,
                damping_distribution_params=ranges.kd,
                operation="scale",
            )
        scaled = {
            f"{key}_distribution_params": getattr(ranges, key)
            for key in ("friction", "armature")
            if getattr(ranges, key) != (1.0, 1.0)
        }
        if scaled:
            func = "randomize_joint_parameters"
            yield _term(f"joints_{index}", func, entity, **scaled, operation="scale")


def _friction(randomize: Randomize, control: Control, buckets: int) -> Iterator[str]:
    """Restitution 0 is what the USD's materials have."""
    if randomize.friction is not None or randomize.restitution is not None:
        slide = control.contact.friction[0]
        friction = randomize.friction or (slide, slide)
        yield _term(
            "material",
            "randomize_rigid_body_material",
            'SceneEntityCfg("robot")',
            static_friction_range=friction,
            dynamic_friction_range=friction,
            restitution_range=randomize.restitution or (0.0, 0.0),
            num_buckets=buckets,
            make_consistent=True,
        )


def _entity(field: str, names: Sequence[str]) -> str:
    """USD identifiers have no letter that a regular expression takes otherwise."""
    listed = ", ".join(f'"{name}"' for name in names)
    return f'SceneEntityCfg("robot", {field}=[{listed}])'
