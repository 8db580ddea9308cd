"""The recipe's `randomize` as event terms of mjlab 1.6.

`dr.pseudo_inertia` holds J' = U J Uᵀ about the body's origin, so density (alpha) and shift (t) are
exactly ours; stretch and shear act about the origin there and about the centre of mass here.
mjlab's drive terms take config groups by their place, not joints: groups are therefore split by
the ranges of their joints.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from assetbuild.findings import Finding
from assetbuild.recipe.randomize import Randomize, RandomMatter, claimed, per_axis
from assetbuild.robot.model import Actuator, Tree
from assetbuild.targets.mjlab.text import exactly

WITH_GAINS = frozenset({"pd", "ideal_pd", "dc_motor"})
"""Models whose gains and effort limit mjlab's terms can scale."""


@dataclass(frozen=True)
class Term:
    """One event term. entity: fields of its SceneEntityCfg; params: Python text by key."""

    name: str
    func: str
    entity: str
    params: tuple[tuple[str, str], ...]


def terms(
    randomize: Randomize, tree: Tree, groups: Sequence[tuple[Actuator, tuple[str, ...]]]
) -> list[Term]:
    """All terms in the order of the recipe. groups: (numbers, joints) as the module has them."""
    return [*_matter(randomize, tree), *_joints(randomize, tree, groups), *_friction(randomize)]


def replaced(randomize: Randomize, tree: Tree) -> tuple[str, ...]:
    """Events of mjlab's velocity task that say what the recipe says."""
    names = []
    if any(tree.root in bodies for _, _, bodies in claimed(randomize.links, _massive(tree))):
        names.append("base_com")
    if any(ranges.encoder_bias for ranges in randomize.joints.values()):
        names.append("encoder_bias")
    if randomize.friction is not None:
        names.append("foot_friction")
    return tuple(names)


def lost(
    randomize: Randomize, tree: Tree, groups: Sequence[tuple[Actuator, tuple[str, ...]]]
) -> Iterator[Finding]:
    """What mjlab's terms cannot do."""
    without = []
    if randomize.payloads:
        without.append("payloads")
    for _, ranges, joints in claimed(randomize.joints, [j.name for j in tree.moving_joints]):
        scaled = {key for key in ("kp", "kd", "effort") if getattr(ranges, key) != (1.0, 1.0)}
        own = [a for a, names in groups if set(names) & set(joints)]
        if scaled and any(a.model not in WITH_GAINS for a in own):
            without.append("gains and effort of drives without a position loop")
    if any(m.stretch or m.shear for m in randomize.links.values()):
        without.append("stretch and shear about the centre of mass (there: about the body's frame)")
    if randomize.restitution is not None:
        without.append("restitution, which MuJoCo has not")
    if without:
        yield Finding(
            rule="mjlab.randomize",
            severity="info",
            subject="recipe randomize",
            message=f"mjlab's events do not say all of it: {'; '.join(dict.fromkeys(without))}",
            hint="`assetbuild sample` and dr.yaml do",
            data={"without": tuple(dict.fromkeys(without))},
        )


def events_text(found: Sequence[Term]) -> str:
    """The function `randomize_events` of the module."""
    body = "".join(_term_text(term) for term in found)
    return f'''
def randomize_events() -> dict[str, EventTermCfg]:
    """The recipe's `randomize`, drawn once for each environment; dr.yaml says where from.

    The draws keep every inertia that of some matter; whether that fits into the link is asked by
    `assetbuild sample` alone. alpha is uniform, so a density is drawn log-uniformly.
    """
    return {{{body}
    }}'''


def _term_text(term: Term) -> str:
    params = "".join(f'\n                "{key}": {value},' for key, value in term.params)
    return f'''
        "{term.name}": EventTermCfg(
            mode="startup",
            func=dr.{term.func},
            params={{
                "asset_cfg": SceneEntityCfg("robot", {term.entity}),{params}
            }},
        ),'''


def _matter(randomize: Randomize, tree: Tree) -> Iterator[Term]:
    rows = claimed(randomize.links, _massive(tree))
    for index, (_, matter, bodies) in enumerate(rows):
        yield Term(
            f"matter_{index}", "pseudo_inertia", _names("body_names", bodies), _log_cholesky(matter)
        )


def _massive(tree: Tree) -> list[str]:
    return [b.name for b in tree.bodies if b.inertial is not None and b.inertial.mass_kg > 0.0]


def _log_cholesky(matter: RandomMatter) -> tuple[tuple[str, str], ...]:
    low, high = matter.density
    params = [("alpha_range", repr((math.log(low) / 2, math.log(high) / 2)))]
    for axis, shift in enumerate(per_axis(matter.com), start=1):
        params.append((f"t{axis}_range", repr((-shift, shift))))
    if matter.stretch:
        params.append(("d_range", repr((-matter.stretch, matter.stretch))))
    if matter.shear:
        params += [(f"s{ij}_range", repr((-matter.shear, matter.shear))) for ij in (12, 13, 23)]
    return tuple(params)


JOINT_TERMS = {"damping": "joint_damping", "friction": "joint_friction", "armature": "joint_armature"}  # fmt: skip # noqa: E501
"""mjlab's term by our key, each a factor."""


def _joints(
    randomize: Randomize, tree: Tree, groups: Sequence[tuple[Actuator, tuple[str, ...]]]
) -> Iterator[Term]:
    rows = claimed(randomize.joints, [joint.name for joint in tree.moving_joints])
    for index, (_, ranges, joints) in enumerate(rows):
        mine = [i for i, (a, names) in enumerate(groups) if set(names) <= set(joints)]
        loops = [i for i in mine if groups[i][0].model in WITH_GAINS]
        if loops and (ranges.kp, ranges.kd) != ((1.0, 1.0), (1.0, 1.0)):
            gains = (("kp_range", repr(ranges.kp)), ("kd_range", repr(ranges.kd)))
            yield Term(f"gains_{index}", "pd_gains", f"actuator_ids={loops!r}", gains)
        limited = [i for i in loops if groups[i][0].effort is not None]
        if limited and ranges.effort != (1.0, 1.0):
            share = (("effort_limit_range", repr(ranges.effort)),)
            yield Term(f"effort_{index}", "effort_limits", f"actuator_ids={limited!r}", share)
        names = _names("joint_names", joints)
        for key, func in JOINT_TERMS.items():
            factor = getattr(ranges, key)
            if factor != (1.0, 1.0):
                scale = (("ranges", repr(factor)), ("operation", '"scale"'))
                yield Term(f"{key}_{index}", func, names, scale)
        if ranges.encoder_bias:
            bias = (("bias_range", repr((-ranges.encoder_bias, ranges.encoder_bias))),)
            yield Term(f"encoder_bias_{index}", "encoder_bias", names, bias)


def _friction(randomize: Randomize) -> Iterator[Term]:
    if randomize.friction is not None:
        params = (
            ("ranges", repr(randomize.friction)),
            ("operation", '"abs"'),
            ("axes", "[0]"),
            ("shared_random", "True"),
        )
        yield Term("friction", "geom_friction", 'geom_names=(r".*_collision\\d*",)', params)


def _names(field: str, names: Sequence[str]) -> str:
    listed = "".join(f"\n                    {exactly(name)}," for name in names)
    return f"{field}=({listed}\n                )"
