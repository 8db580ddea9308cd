"""Parts mounted on a robot: one tree, one set of shapes, one recipe for what follows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from assetbuild.compose.compose_parts import ComposeParts, PartOn, part_path
from assetbuild.compose.composed_control import KeyOf
from assetbuild.compose.merging import (
    HOME,
    Mounted,
    composed,
    home_of_parts,
    left_out,
    poses_in_source_keys,
)
from assetbuild.engine.graph import Ref
from assetbuild.engine.planner import Planner
from assetbuild.errors import did_you_mean
from assetbuild.geometry.jobs import file_of
from assetbuild.geometry.plan import Geometry
from assetbuild.recipe.collision import CollisionRule
from assetbuild.recipe.compose import Part
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import Recipe
from assetbuild.recipe.sides import Side
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Tree
from assetbuild.robot.source import SourceControl
from assetbuild.source.reading import Reading


@dataclass(frozen=True)
class Ready:
    """A robot that is read and edited, before its fixed joints are merged.

    robot: `links.json` and `shapes.json`. geometry: None while its meshes are not known.
    sides: see `Side`. poses: of parts in keyframes that only the base's MJCF has.
    """

    read: Reading
    robot: Mapping[str, Ref]
    geometry: Geometry | None
    source_map: Ref
    sides: tuple[Side, ...]
    poses: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def compose(
    loaded: LoadedRecipe,
    base: Ready,
    parts: Sequence[tuple[LoadedRecipe, Ready | None]],
    p: Planner,
) -> tuple[LoadedRecipe, Ready] | None:
    """The whole as one robot, with a recipe that speaks of its names; None: not known yet."""
    rows = loaded.recipe.compose
    made = [ready for _, ready in parts if ready is not None]
    known = _known(base, p)
    trees = [_known(ready, p) for ready in made]
    if len(made) < len(parts) or known is None or any(tree is None for tree in trees):
        return None
    _check_links(loaded, known.tree)
    found = [robot for robot in trees if robot is not None]
    _check_home(loaded, [robot.tree for robot in found], known)
    mounted = [
        _mounted(row, part, robot) for row, (part, _), robot in zip(rows, parts, found, strict=True)
    ]
    whole = _whole(loaded.recipe, known, mounted)
    added = poses_in_source_keys(whole, mounted, known.keyframes)
    poses = {name: key.joints for name, key in whole.keyframes.items()} | added
    inputs = _inputs("base", base)
    for row, ready in zip(rows, made, strict=True):
        inputs |= _inputs(row.as_, ready)
    step = ComposeParts(
        parts=tuple(
            _part_on(each, loaded.recipe, robot, poses)
            for each, robot in zip(mounted, found, strict=True)
        ),
        keeps=base.sides[0].keeps,
    )
    node = p.add("compose_parts", step, inputs)
    from_mjcf = any(ready.read.control for ready in (base, *made))
    read = replace(base.read, control=node["source_control.json"] if from_mjcf else None)
    ready = replace(
        base,
        read=read,
        robot={port: node[port] for port in ("links.json", "shapes.json")},
        geometry=_geometry(base, {row.as_: r for row, r in zip(rows, made, strict=True)}),
        source_map=node["source_map.json"],
        sides=(*base.sides, *(each.side for each in mounted)),
        poses=added,
    )
    return replace(loaded, recipe=whole), ready


def _geometry(base: Ready, parts: Mapping[str, Ready]) -> Geometry | None:
    """The base's with those of the parts, by prefix; None while one is not known yet."""
    found = [(prefix, ready.geometry) for prefix, ready in parts.items()]
    if base.geometry is None or any(geometry is None for _, geometry in found):
        return None
    for prefix, geometry in found:
        if geometry is not None:
            base.geometry.mount(geometry, partial(part_path, prefix))
    return base.geometry


def check_parts(loaded: LoadedRecipe) -> None:
    """Prefixes that cannot be told apart."""
    prefixes = [row.as_ for row in loaded.recipe.compose]
    for index, prefix in enumerate(prefixes):
        if any(prefix.startswith(other) for other in prefixes[:index] + prefixes[index + 1 :]):
            message = f"the prefix `{prefix}` begins with that of another part"
            raise loaded.error(("compose", index, "as"), message, "choose another")


@dataclass(frozen=True)
class _Known:
    """What the plan needs to know of a robot. keyframes: of its source, joint by joint."""

    tree: Tree
    said: SourceControl | None

    @property
    def keyframes(self) -> dict[str, dict[str, float]]:
        """Values of the joints that mimic no other, rad or m."""
        free = {joint.name for joint in self.tree.moving_joints if joint.mimic is None}
        keys = self.said.control.keyframes if self.said else ()
        return {key.name: {n: q for n, q in key.joints if n in free} for key in keys}


def _known(ready: Ready, p: Planner) -> _Known | None:
    """None while an answer is missing; both are asked for at once."""
    links = p.ask(ready.robot["links.json"])
    said = p.ask(ready.read.control) if ready.read.control else b""
    if links is None or said is None:
        return None
    return _Known(decode(Tree, links), decode(SourceControl, said) if said else None)


def _whole(recipe: Recipe, base: _Known, parts: Sequence[Mounted]) -> Recipe:
    """The composed recipe; a base without any keyframe gets the `home` of its parts."""
    whole = composed(recipe, parts)
    home = home_of_parts(parts)
    if whole.keyframes or base.keyframes or home is None:
        return whole
    return whole.model_copy(update={"keyframes": {"home": home}})


def _check_links(loaded: LoadedRecipe, base: Tree) -> None:
    """Links of the base that the rows name, with the line of the one that is not there."""
    for index, row in enumerate(loaded.recipe.compose):
        named: list[tuple[tuple[str | int, ...], str]] = [(("at", "link"), row.at.link)]
        named += [(("exclude", number), link) for number, link in enumerate(row.exclude)]
        for key, link in named:
            if link not in base.by_body:
                hint = did_you_mean(link, base.by_body)
                raise loaded.error(("compose", index, *key), f"no link `{link}`", hint)
        # A pattern that begins with the prefix speaks of the part: no name of the base may.
        for name in (*base.by_body, *base.by_joint):
            if name.startswith(row.as_):
                message = f"`{name}` of the base begins with the prefix `{row.as_}` too"
                raise loaded.error(("compose", index, "as"), message, "choose another")


def _check_home(loaded: LoadedRecipe, parts: Sequence[Tree], base: _Known) -> None:
    known = {**loaded.recipe.keyframes, **base.keyframes}
    for index, (row, tree) in enumerate(zip(loaded.recipe.compose, parts, strict=True)):
        if row.home and known and HOME not in known:
            message = "the base has no keyframe `home`, in which the part could stand so"
            hint = f"add one to its keyframes; it has {', '.join(known)}"
            raise loaded.error(("compose", index, "home"), message, hint)
        names = [joint.name for joint in tree.moving_joints]
        for pattern in row.home:
            if not any(re.fullmatch(pattern, name) for name in names):
                key = ("compose", index, "home", pattern)
                message = f"pattern `{pattern}` matches no joint of the part"
                raise loaded.error(key, message, did_you_mean(pattern, names))


def _inputs(folder: str, ready: Ready) -> dict[str, Ref]:
    refs = {**ready.robot, "source_map.json": ready.source_map}
    if ready.read.control is not None:
        refs["source_control.json"] = ready.read.control
    return {f"{folder}/{name}": ref for name, ref in refs.items()}


def _part_on(
    mounted: Mounted, base: Recipe, robot: _Known, poses: Mapping[str, Mapping[str, float]]
) -> PartOn:
    """poses: by keyframe of the whole the value of joints, by pattern, rad or m."""
    row = mounted.part
    used = {name: key for name in poses if (key := mounted.pose_key(name)) is not None}
    keys = tuple(
        KeyOf(name, key, _moved(mounted, robot, poses[name], key))
        for name, (key, by_source) in used.items()
        if by_source
    )
    own = dict.fromkeys((*mounted.recipe.keyframes, *mounted.poses))
    idle = [f"keyframes.{name}" for name in own if name not in {key for key, _ in used.values()}]
    place = PartOn(
        folder=row.as_,
        prefix=row.as_,
        link=row.at.link,
        xyz=row.at.xyz,
        rpy=row.at.rpy,
        left_out=(*left_out(base, mounted.recipe), *idle),
        keeps=mounted.side.keeps,
        keys=keys,
    )
    if row.mount is None:
        return place
    return place.model_copy(
        update={
            "mount_mass": row.mount.mass,
            "mount_size": row.mount.size,
            "mount_at": row.mount.at,
        }
    )


def _moved(mounted: Mounted, robot: _Known, pose: Mapping[str, float], key: str) -> tuple[str, ...]:
    """Joints of the part that a keyframe of the whole puts elsewhere than its source's."""
    found = []
    for joint, before in mounted.poses[key].items():
        values = [q for k, q in pose.items() if re.fullmatch(k, mounted.prefix + joint)]
        if values and values[0] != before:
            found.append(joint)
    followers = [j for j in robot.tree.moving_joints if j.mimic and j.mimic.joint in found]
    return (*found, *(joint.name for joint in followers))


def _with_own_files(part: LoadedRecipe) -> Recipe:
    """The recipe whose collision pieces are files by absolute paths: the whole lies elsewhere."""

    def anchored(rule: CollisionRule) -> CollisionRule:
        pieces = tuple(
            piece
            if piece.file is None
            else piece.model_copy(update={"file": str(file_of(piece.file, part.path.parent))})
            for piece in rule.pieces or ()
        )
        return rule.model_copy(update={"pieces": pieces}) if pieces else rule

    collision = part.recipe.collision
    changed = collision.model_copy(
        update={
            "default": anchored(collision.default),
            "links": {pattern: anchored(rule) for pattern, rule in collision.links.items()},
        }
    )
    return part.recipe.model_copy(update={"collision": changed})


def _mounted(row: Part, part: LoadedRecipe, robot: _Known) -> Mounted:
    return Mounted(
        row,
        _with_own_files(part),
        links=tuple(row.as_ + body.name for body in robot.tree.bodies),
        joints=tuple(row.as_ + joint.name for joint in robot.tree.moving_joints),
        poses=robot.keyframes,
    )
