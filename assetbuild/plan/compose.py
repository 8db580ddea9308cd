"""Parts mounted on a robot: one tree, one set of shapes, one recipe for what follows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from assetbuild.engine.graph import Planner, Ref
from assetbuild.errors import did_you_mean
from assetbuild.plan.collision import file_of
from assetbuild.plan.geometry import Geometry
from assetbuild.plan.reading import Reading
from assetbuild.recipe.collision import CollisionRule
from assetbuild.recipe.compose import Part
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.merging import Mounted, composed, left_out
from assetbuild.recipe.models import Recipe
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Tree
from assetbuild.steps.compose_parts import ComposeParts, PartOn, part_path


@dataclass(frozen=True)
class Ready:
    """A robot that is read and edited, before its fixed joints are merged.

    robot: `links.json` and `shapes.json`. geometry: None while its meshes are not known.
    """

    read: Reading
    robot: Mapping[str, Ref]
    geometry: Geometry | None
    source_map: Ref


def compose(
    loaded: LoadedRecipe,
    base: Ready,
    parts: Sequence[tuple[LoadedRecipe, Ready | None]],
    p: Planner,
) -> tuple[LoadedRecipe, Ready] | None:
    """The whole as one robot, with a recipe that speaks of its names; None: not known yet."""
    rows = loaded.recipe.compose
    made = [ready for _, ready in parts if ready is not None]
    links = p.ask(base.robot["links.json"])
    trees = [p.ask(ready.robot["links.json"]) for ready in made]
    if len(made) < len(parts) or links is None or any(tree is None for tree in trees):
        return None
    _check_links(loaded, decode(Tree, links))
    inputs = _inputs("base", base)
    for row, ready in zip(rows, made, strict=True):
        inputs |= _inputs(row.as_, ready)
    placed = tuple(
        _part_on(row).model_copy(update={"left_out": left_out(loaded.recipe, part.recipe)})
        for row, (part, _) in zip(rows, parts, strict=True)
    )
    node = p.add("compose_parts", ComposeParts(parts=placed), inputs)
    if base.geometry is not None and all(ready.geometry for ready in made):
        for row, ready in zip(rows, made, strict=True):
            if ready.geometry is not None:
                base.geometry.mount(ready.geometry, partial(part_path, row.as_))
    _check_home(loaded, [decode(Tree, tree) for tree in trees if tree is not None])
    mounted = [
        _mounted(row, part, decode(Tree, tree))
        for row, (part, _), tree in zip(rows, parts, trees, strict=True)
        if tree is not None
    ]
    whole = replace(loaded, recipe=composed(loaded.recipe, mounted))
    robot = {port: node[port] for port in ("links.json", "shapes.json")}
    return whole, replace(base, robot=robot, source_map=node["source_map.json"])


def check_parts(loaded: LoadedRecipe) -> None:
    """Prefixes that cannot be told apart, and descriptions that cannot be composed."""
    hint = "compose robots that come as URDF or xacro"
    if loaded.parts and loaded.recipe.source.mjcf is not None:
        raise loaded.error(("source", "mjcf"), "an MJCF cannot carry parts yet", hint)
    for index, part in enumerate(loaded.parts):
        if part.recipe.source.mjcf is not None:
            message = "a part that comes as MJCF cannot be mounted yet"
            raise loaded.error(("compose", index, "recipe"), message, hint)
    prefixes = [row.as_ for row in loaded.recipe.compose]
    for index, prefix in enumerate(prefixes):
        if any(prefix.startswith(other) for other in prefixes[:index] + prefixes[index + 1 :]):
            message = f"the prefix `{prefix}` begins with that of another part"
            raise loaded.error(("compose", index, "as"), message, "choose another")


def _check_links(loaded: LoadedRecipe, base: Tree) -> None:
    """Links of the base that the rows name, with the line of the one that is not there."""
    for index, row in enumerate(loaded.recipe.compose):
        named: list[tuple[tuple[str | int, ...], str]] = [(("at", "link"), row.at.link)]
        named += [(("exclude", number), link) for number, link in enumerate(row.exclude)]
        for key, link in named:
            if link not in base.by_body:
                hint = did_you_mean(link, base.by_body)
                raise loaded.error(("compose", index, *key), f"no link `{link}`", hint)


def _check_home(loaded: LoadedRecipe, parts: Sequence[Tree]) -> None:
    for index, (row, tree) in enumerate(zip(loaded.recipe.compose, parts, strict=True)):
        names = [joint.name for joint in tree.moving_joints]
        for pattern in row.home:
            if not any(re.fullmatch(pattern, name) for name in names):
                key = ("compose", index, "home", pattern)
                message = f"pattern `{pattern}` matches no joint of the part"
                raise loaded.error(key, message, did_you_mean(pattern, names))


def _inputs(folder: str, ready: Ready) -> dict[str, Ref]:
    refs = {**ready.robot, "source_map.json": ready.source_map}
    return {f"{folder}/{name}": ref for name, ref in refs.items()}


def _part_on(row: Part) -> PartOn:
    place = PartOn(folder=row.as_, prefix=row.as_, link=row.at.link, xyz=row.at.xyz, rpy=row.at.rpy)
    if row.mount is None:
        return place
    return place.model_copy(
        update={
            "mount_mass": row.mount.mass,
            "mount_size": row.mount.size,
            "mount_at": row.mount.at,
        }
    )


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


def _mounted(row: Part, part: LoadedRecipe, tree: Tree) -> Mounted:
    return Mounted(
        row,
        _with_own_files(part),
        links=tuple(row.as_ + body.name for body in tree.bodies),
        joints=tuple(row.as_ + joint.name for joint in tree.moving_joints),
    )
