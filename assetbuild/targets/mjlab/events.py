"""The recipe's `randomize` as event terms of mjlab 1.6.

`dr.pseudo_inertia` holds J' = U J Uᵀ about the body's origin, so density (alpha) and shift (t) are
exactly ours; stretch and shear act about the origin there and about the centre of mass here.
It has no term for a box that is mounted: the module brings its own, `carry_payload`, which adds the
box's pseudo-inertia to that of the body as the terms before it have drawn it. mjlab's drive terms
take config groups by their place, not joints: groups are therefore split by the ranges of their
joints.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from assetbuild.findings import Finding, Rule
from assetbuild.robot.inertia import move_inertial, pseudo_inertia
from assetbuild.robot.model import Actuator, Tree
from assetbuild.robot.randomize import homogeneous_box
from assetbuild.robot.ranges import (
    Randomize,
    RandomJoint,
    RandomMatter,
    RandomPayload,
    per_axis,
)
from assetbuild.simulators.mujoco import body_names

WITH_GAINS = frozenset({"pd", "ideal_pd", "dc_motor"})
"""Models whose gains and effort limit mjlab's terms can scale."""

NOT_RANDOMIZED = Rule(
    "mjlab.randomize",
    "info",
    "what the recipe randomizes and mjlab's events cannot: payloads, gains of drives without a "
    "position loop; stretch and shear act about another point there",
    "`assetbuild sample`",
)


@dataclass(frozen=True)
class DriveGroup:
    """Joints that one actuator config of mjlab drives. names: patterns that match just these."""

    names: tuple[str, ...]
    actuator: Actuator
    joints: tuple[str, ...]
    ranges: RandomJoint | None


def terms(randomize: Randomize, tree: Tree, groups: Sequence[DriveGroup]) -> str:
    """The text of all terms in the order of the recipe. groups: as the module has them."""
    made = [
        *_matter(randomize, tree),
        *_payloads(randomize, tree),
        *_joints(randomize, tree, groups),
        *_friction(randomize),
    ]
    return "".join(made)


def replaced(randomize: Randomize, tree: Tree) -> tuple[str, ...]:
    """Events of mjlab's velocity task that say what the recipe says."""
    names = []
    if any(tree.root in bodies for _, _, bodies in randomize.of_bodies(tree)):
        names.append("base_com")
    if any(ranges.encoder_bias for ranges in randomize.joints.values()):
        names.append("encoder_bias")
    if randomize.friction is not None:
        names.append("foot_friction")
    return tuple(names)


def lost(randomize: Randomize, tree: Tree, groups: Sequence[DriveGroup]) -> Iterator[Finding]:
    """What mjlab's terms cannot do."""
    without = []
    if len(_carried(randomize, tree)) < len(randomize.payloads):
        without.append("payloads on bodies without mass")
    for _, ranges, joints in randomize.of_joints(tree):
        scaled = {key for key in ("kp", "kd", "effort") if getattr(ranges, key) != (1.0, 1.0)}
        drives = [group.actuator for group in groups if {*group.joints} & {*joints}]
        if scaled and any(a.model not in WITH_GAINS for a in drives):
            without.append("gains and effort of drives without a position loop")
    if any(m.stretch or m.shear for m in randomize.links.values()):
        without.append("stretch and shear about the centre of mass (there: about the body's frame)")
    if randomize.restitution is not None:
        without.append("restitution, which MuJoCo has not")
    if without:
        yield NOT_RANDOMIZED(
            "recipe randomize",
            f"mjlab's events do not say all of it: {'; '.join(dict.fromkeys(without))}",
            hint="`assetbuild sample` and dr.yaml do",
            data={"without": tuple(dict.fromkeys(without))},
        )


def imports(event_terms: str) -> list[str]:
    """Import lines that the terms need, each sorted into its module."""
    lines = ["from mjlab.managers.scene_entity_config import SceneEntityCfg"]
    if "func=dr." in event_terms:
        lines.append("from mjlab.envs.mdp import dr")
    manager = ["EventTermCfg"]
    if carries(event_terms):
        manager += ["RecomputeLevel", "requires_model_fields"]
        lines.append("from mjlab.utils.lab_api.math import matrix_from_quat, quat_from_matrix")
    return [*lines, f"from mjlab.managers.event_manager import {', '.join(manager)}"]


def carries(event_terms: str) -> bool:
    """Whether a term mounts a box, which needs torch and a function of the module's own."""
    return f"func={CARRY}," in event_terms


def events_text(event_terms: str) -> str:
    """The function `randomize_events` of the module, and the term that mjlab has not."""
    carry_text = f"{CARRY_TEXT}\n\n\n" if carries(event_terms) else ""
    return f'''{carry_text}
def randomize_events() -> dict[str, EventTermCfg]:
    """The recipe's `randomize`, drawn once for each environment; dr.yaml says where from.

    The draws keep every inertia that of some matter; whether that fits into the link is asked by
    `assetbuild sample` alone. alpha is uniform, so a density is drawn log-uniformly.
    """
    return {{{event_terms}
    }}'''


def _term(name: str, func: str, entity: str, params: Mapping[str, object]) -> str:
    """One event term. func: Python text; entity: fields of its SceneEntityCfg; params: values."""
    values = [f'"{key}": {_text_of(value)}' for key, value in params.items()]
    values.insert(0, f'"asset_cfg": SceneEntityCfg("robot", {entity})')
    fields = ['mode="startup"', f"func={func}", block("params=", values, 12, "{}")]
    return "\n        " + block(f'"{name}": EventTermCfg', fields, 8) + ","


def _text_of(value: object) -> str:
    """A literal; of a matrix a line for each row."""
    if isinstance(value, str):
        return literal(value)
    if isinstance(value, tuple) and isinstance(value[0], tuple):
        return block("", map(repr, value), 16)
    return repr(value)


def _matter(randomize: Randomize, tree: Tree) -> Iterator[str]:
    written = body_names(tree)
    for index, (_, matter, bodies) in enumerate(randomize.of_bodies(tree)):
        yield _term(
            f"matter_{index}",
            "dr.pseudo_inertia",
            _names("body_names", [written[name] for name in bodies]),
            _log_cholesky(matter),
        )


CARRY = "carry_payload"
CARRY_TEXT = '''
@requires_model_fields(
    "body_mass", "body_ipos", "body_inertia", "body_iquat", recompute=RecomputeLevel.set_const
)
def carry_payload(env, env_ids, mass_range, box, asset_cfg) -> None:
    """Mount a box of random mass, kg, on one body: exact in mass, centre of mass and inertia.

    box: pseudo-inertia (4, 4) of one kilogram of it in the body's frame, [[S, h], [h, 1]] with the
    second moments S, m2, and the centre h, m. It adds to what the body is now, so: at startup.
    Computed on the CPU, because the eigenvalues of a GPU cost gigabytes of its memory.
    """
    model = env.sim.model
    worlds = torch.arange(env.num_envs) if env_ids is None else env_ids.cpu().long()
    (body,) = env.scene[asset_cfg.name].indexing.body_ids[asset_cfg.body_ids].tolist()
    fields = (model.body_mass, model.body_ipos, model.body_inertia, model.body_iquat)
    at = (worlds.to(env.device), body)
    mass, com, moments, quat = (field[at].double().cpu() for field in fields)

    axes = matrix_from_quat(quat)
    second = torch.diag_embed(moments.sum(-1, keepdim=True) / 2 - moments)
    matter = torch.zeros(len(worlds), 4, 4, dtype=torch.double)
    matter[:, :3, :3] = axes @ second @ axes.mT + mass[:, None, None] * _outer(com)
    matter[:, :3, 3] = matter[:, 3, :3] = mass[:, None] * com
    matter[:, 3, 3] = mass
    low, high = mass_range
    drawn = low + (high - low) * torch.rand(len(worlds), dtype=torch.double)
    matter += drawn[:, None, None] * torch.tensor(box, dtype=torch.double)

    mass = matter[:, 3, 3]
    com = matter[:, :3, 3] / mass[:, None]
    spread, axes = torch.linalg.eigh(matter[:, :3, :3] - mass[:, None, None] * _outer(com))
    axes[torch.linalg.det(axes) < 0, :, 2] *= -1.0
    values = (mass, com, spread.sum(-1, keepdim=True) - spread, quat_from_matrix(axes))
    for field, value in zip(fields, values, strict=True):
        field[at] = value.to(env.device, torch.float)


def _outer(vector):
    return vector[:, :, None] * vector[:, None, :]'''


def _payloads(randomize: Randomize, tree: Tree) -> Iterator[str]:
    for index, payload in _carried(randomize, tree):
        body, X_body_link = tree.placement(payload.link)
        box = move_inertial(homogeneous_box(1.0, payload.size, payload.at), X_body_link)
        rows = tuple(tuple(float(value) for value in row) for row in pseudo_inertia(box))
        params = {"mass_range": payload.mass, "box": rows}
        written = body_names(tree)[body]
        yield _term(f"payload_{index}", CARRY, _names("body_names", (written,)), params)


def _carried(randomize: Randomize, tree: Tree) -> list[tuple[int, RandomPayload]]:
    """Those on bodies that MuJoCo knows as matter."""
    massive = {body.name for body in tree.bodies if not body.is_massless}
    return [
        (index, payload)
        for index, payload in enumerate(randomize.payloads)
        if tree.placement(payload.link)[0] in massive
    ]


def _log_cholesky(matter: RandomMatter) -> dict[str, object]:
    low, high = matter.density
    shift = dict(zip(("t1", "t2", "t3"), per_axis(matter.com), strict=True))
    stretch = {"d": matter.stretch} if matter.stretch else {}
    shear = dict.fromkeys(("s12", "s13", "s23"), matter.shear) if matter.shear else {}
    most = {**shift, **stretch, **shear}
    ranges = {f"{name}_range": (-value, value) for name, value in most.items()}
    return {"alpha_range": (math.log(low) / 2, math.log(high) / 2), **ranges}


def _joints(randomize: Randomize, tree: Tree, groups: Sequence[DriveGroup]) -> Iterator[str]:
    for index, (_, ranges, joints) in enumerate(randomize.of_joints(tree)):
        mine = [i for i, group in enumerate(groups) if set(group.joints) <= set(joints)]
        loops = [i for i in mine if groups[i].actuator.model in WITH_GAINS]
        if loops and (ranges.kp, ranges.kd) != ((1.0, 1.0), (1.0, 1.0)):
            gains = {"kp_range": ranges.kp, "kd_range": ranges.kd}
            yield _term(f"gains_{index}", "dr.pd_gains", f"actuator_ids={loops!r}", gains)
        limited = [i for i in loops if groups[i].actuator.effort is not None]
        if limited and ranges.effort != (1.0, 1.0):
            share = {"effort_limit_range": ranges.effort}
            yield _term(f"effort_{index}", "dr.effort_limits", f"actuator_ids={limited!r}", share)
        names = _names("joint_names", joints)
        for key in ("damping", "friction", "armature"):
            factor = getattr(ranges, key)
            if factor != (1.0, 1.0):
                scale = {"ranges": factor, "operation": "scale"}
                yield _term(f"{key}_{index}", f"dr.joint_{key}", names, scale)
        if ranges.encoder_bias:
            bias = {"bias_range": (-ranges.encoder_bias, ranges.encoder_bias)}
            yield _term(f"encoder_bias_{index}", "dr.encoder_bias", names, bias)


def _friction(randomize: Randomize) -> Iterator[str]:
    if randomize.friction is not None:
        drawn = {"ranges": randomize.friction, "operation": "abs"}
        params = {**drawn, "axes": [0], "shared_random": True}
        yield _term("friction", "dr.geom_friction", 'geom_names=(r".*_collision\\d*",)', params)


def _names(field: str, names: Sequence[str]) -> str:
    return block(f"{field}=", map(exactly, names), 16)


# --- literals ------------------------------------------------------------------------------------


def literal(value: str) -> str:
    """A string literal: raw where a backslash would need two."""
    if "\\" in value and not value.endswith("\\") and '"' not in value and "\n" not in value:
        return f'r"{value}"'
    escaped = repr(value)
    return f'"{escaped[1:-1]}"' if escaped[0] == "'" and '"' not in value else escaped


def block(head: str, items: Iterable[str], indent: int = 0, brackets: str = "()") -> str:
    """`head(` ... `)` on a line indented by so many spaces, with a line for each item."""
    pad = "\n" + " " * indent
    lines = "".join(f"{pad}    {item}," for item in items)
    return f"{head}{brackets[0]}{lines}{pad if lines else ''}{brackets[1]}"


def exactly(name: str) -> str:
    """A literal of the regular expression that matches this name alone."""
    return literal(re.escape(name))
