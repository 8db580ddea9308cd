"""Parts mounted on a robot: one tree, one set of shapes, one recipe for what follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from assetbuild.compose.compose_parts import ComposeParts, part_path
from assetbuild.compose.composed_control import KeyOf, MountedPart
from assetbuild.compose.merging import Composed, composed, left_out, pose_of, pose_rows
from assetbuild.compose.names import HOME, Member
from assetbuild.engine.graph import Ref
from assetbuild.engine.planner import Planner
from assetbuild.errors import did_you_mean
from assetbuild.geometry.plan import Geometry
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import Recipe
from assetbuild.recipe.validation import Key, KeyedError
from assetbuild.robot.codec import decode
from assetbuild.robot.files import SourceControl
from assetbuild.robot.model import Tree
from assetbuild.robot.sides import Side
from assetbuild.source.plan import Reading


@dataclass(frozen=True)
class Ready:
    """A robot that is read and edited, before its fixed joints are merged.

    robot: `links.json` and `shapes.json`. geometry: None while its meshes are not known.
    sides: see `Side`. poses: of parts in keyframes that only the base's MJCF has, by joint, rad or
    m. common_surfaces: see `Composed`.
    """

    read: Reading
    robot: Mapping[str, Ref]
    geometry: Geometry | None
    source_map: Ref
    sides: tuple[Side, ...]
    poses: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    common_surfaces: tuple[str, ...] = ()


def compose(
    loaded: LoadedRecipe,
    base: Ready,
    parts: Sequence[tuple[LoadedRecipe, Ready | None]],
    p: Planner,
) -> tuple[Composed, Ready] | None:
    """The whole as one robot, with a recipe that speaks of its names; None: not known yet."""
    made = [base, *(ready for _, ready in parts if ready is not None)]
    members = _members([loaded, *(part for part, _ in parts)], made, p)
    if members is None:
        return None
    _check_links(members)
    _check_home(members)
    whole = composed(members)
    names = (*whole.recipe.keyframes, *members[0].poses)
    poses = {name: pose_of(pose_rows(members, name)) for name in names}
    mounted = {m.prefix: ready for m, ready in zip(members[1:], made[1:], strict=True)}
    inputs: dict[str, Ref] = {}
    for folder, ready in {"base": base, **mounted}.items():
        refs = {**ready.robot, "source_map.json": ready.source_map}
        if ready.read.control is not None:
            refs["source_control.json"] = ready.read.control
        inputs |= {f"{folder}/{name}": ref for name, ref in refs.items()}
    step = ComposeParts(
        parts=tuple(_part_on(member, loaded.recipe, poses) for member in members[1:]),
        keeps=members[0].side.keeps,
    )
    node = p.add("compose_parts", step, inputs)
    from_mjcf = any(ready.read.control for ready in made)
    read = replace(base.read, control=node["source_control.json"] if from_mjcf else None)
    return whole, replace(
        base,
        read=read,
        robot={port: node[port] for port in ("links.json", "shapes.json")},
        geometry=_geometry(base, mounted),
        source_map=node["source_map.json"],
        sides=tuple(member.side for member in members),
        poses={name: pose for name, pose in poses.items() if name not in whole.recipe.keyframes},
        common_surfaces=whole.common_surfaces,
    )


def _members(
    recipes: Sequence[LoadedRecipe], made: Sequence[Ready], p: Planner
) -> list[Member] | None:
    """The base, which reaches its parts, and these; None while an answer is missing."""
    rows = [None, *recipes[0].recipe.compose]
    known = [_known(ready, p) for ready in made]  # all questions are asked at once
    members = [
        Member(recipe, *answer, row, ("compose", index - 1))
        for index, (recipe, row, answer) in enumerate(zip(recipes, rows, known, strict=False))
        if answer is not None
    ]
    if len(members) < len(recipes):
        return None
    return [replace(members[0], reach=tuple(members[1:])), *members[1:]]


def _known(ready: Ready, p: Planner) -> tuple[Tree, SourceControl | None] | None:
    """None while an answer is missing; both are asked for at once."""
    links = p.ask(ready.robot["links.json"])
    control = p.ask(ready.read.control) if ready.read.control else b""
    if links is None or control is None:
        return None
    return decode(Tree, links), decode(SourceControl, control) if control else None


def _geometry(base: Ready, parts: Mapping[str, Ready]) -> Geometry | None:
    """The base's with those of the parts, by prefix; None while one is not known yet."""
    geometries = [(prefix, ready.geometry) for prefix, ready in parts.items()]
    if base.geometry is None or any(geometry is None for _, geometry in geometries):
        return None
    for prefix, geometry in geometries:
        if geometry is not None:
            base.geometry.mount(geometry, partial(part_path, prefix))
    return base.geometry


def check_parts(recipe: Recipe) -> None:
    """Prefixes that cannot be told apart."""
    prefixes = [row.as_ for row in recipe.compose]
    for index, prefix in enumerate(prefixes):
        if any(prefix.startswith(other) for other in prefixes[:index] + prefixes[index + 1 :]):
            message = f"the prefix `{prefix}` begins with that of another part"
            raise KeyedError(("compose", index, "as"), message, "choose another")


def _check_links(members: Sequence[Member]) -> None:
    """Links of the base that the rows name, with the line of the one that is not there."""
    loaded, base = members[0].loaded, members[0].tree
    for part, row in zip(members[1:], loaded.recipe.compose, strict=True):
        named: list[tuple[Key, str]] = [(("at", "link"), row.at.link)]
        named += [(("exclude", number), link) for number, link in enumerate(row.exclude)]
        for key, link in named:
            if link not in base.by_body:
                hint = did_you_mean(link, base.by_body)
                raise loaded.error((*part.row, *key), f"no link `{link}`", hint)
        # A pattern that writes the prefix out speaks of the part: no name of the base may have it.
        for name in (*base.by_body, *base.by_joint):
            if name.startswith(row.as_):
                message = f"`{name}` of the base begins with the prefix `{row.as_}` too"
                raise loaded.error((*part.row, "as"), message, "choose another")


def _check_home(members: Sequence[Member]) -> None:
    base, known = members[0], {**members[0].recipe.keyframes, **members[0].poses}
    for part in members[1:]:
        if part.part and part.part.home and known and HOME not in known:
            message = "the base has no keyframe `home`, in which the part could stand so"
            hint = f"add one to its keyframes; it has {', '.join(known)}"
            raise base.loaded.error((*part.row, HOME), message, hint)


def _part_on(part: Member, base: Recipe, poses: Mapping[str, Mapping[str, float]]) -> MountedPart:
    """poses: by keyframe of the whole the value of joints, rad or m."""
    row = part.part
    assert row is not None  # noqa: S101 # it is no base
    used = {name: key for name in poses if (key := part.pose_key(name)) is not None}
    keys = tuple(
        KeyOf(name, key, _moved(part, poses[name], key))
        for name, (key, by_source) in used.items()
        if by_source
    )
    names = dict.fromkeys((*part.recipe.keyframes, *part.poses))
    idle = [f"keyframes.{name}" for name in names if name not in {key for key, _ in used.values()}]
    return MountedPart(
        prefix=row.as_,
        at=row.at,
        mount=row.mount,
        left_out=(*left_out(base, part.recipe), *idle),
        keeps=part.side.keeps,
        keys=keys,
    )


def _moved(part: Member, pose: Mapping[str, float], key: str) -> tuple[str, ...]:
    """Joints of the part that a keyframe of the whole puts elsewhere than its source's."""
    stated = part.poses[key].items()
    joints = [joint for joint, before in stated if pose.get(part.prefix + joint, before) != before]
    followers = [j for j in part.tree.moving_joints if j.mimic and j.mimic.joint in joints]
    return (*joints, *(joint.name for joint in followers))
