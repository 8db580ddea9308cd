"""Meshes and collision: each conversion and each decomposition once, then put in place."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from pathlib import PurePosixPath

from assetbuild.collision import CollisionMethod, PlacedSource
from assetbuild.engine.graph import Node, Planner, Ref
from assetbuild.errors import RecipeError, did_you_mean
from assetbuild.kinds import load_plugin, plugin_names
from assetbuild.plan.companions import Companions
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import CollisionRule, Recipe
from assetbuild.robot.model import Mesh, Shape, Shapes, Tree
from assetbuild.steps.assemble import Assemble, CollisionUse, TextureUse, VisualUse
from assetbuild.steps.convert_mesh import ConvertMesh
from assetbuild.steps.convert_texture import ConvertTexture
from assetbuild.steps.decimate_mesh import DecimateMesh
from assetbuild.steps.lint_meshes import LintMeshes

BUILT_IN = ("auto", "keep", "none")
"""Methods that need no step of their own: see `_kept`."""


class Geometry:
    """Conversions of the source's meshes, each file and scale once.

    subjects: label of a node -> the mesh it works on; the steps do not know its path, so that
    equal files share their results. textures: of the description's own materials, by path.
    turned: paths of the meshes whose up axis is honoured.
    """

    def __init__(
        self,
        shapes: Shapes,
        files: Mapping[str, Ref],
        companions: Companions,
        textures: Mapping[str, Ref],
        turned: Collection[str],
        p: Planner,
    ) -> None:
        self.shapes, self.textures = shapes, textures
        self._files, self._companions, self._p = files, companions, p
        self._turned = turned
        self._converted: dict[tuple[str, tuple[float, float, float]], Node] = {}
        self._decimated: dict[str, Node] = {}
        self.subjects: dict[str, str] = {}
        self._stems = _short_names(tuple(files))

    def stem(self, mesh: Mesh) -> str:
        """The short name of a mesh file: `calf`."""
        return PurePosixPath(mesh.mesh).stem

    def converted(self, mesh: Mesh) -> Node:
        """The full mesh, as OBJ per material."""
        key = (mesh.mesh, mesh.scale)
        if key not in self._converted:
            named = self._companions.get(mesh.mesh, {})
            step = ConvertMesh(
                format=PurePosixPath(mesh.mesh).suffix.lower().lstrip("."),
                scale=mesh.scale,
                up_axis="honour" if mesh.mesh in self._turned else "ignore",
                companions=tuple(named),
                keep_uv=mesh.mesh in self._papered(),
            )
            label = f"convert_mesh {self._label(mesh)}"
            self.subjects[label] = f"mesh {mesh.mesh}"
            inputs = {"mesh": self._files[mesh.mesh]}
            inputs |= {f"companions/{i}": ref for i, ref in enumerate(named.values())}
            self._converted[key] = self._p.add(label, step, inputs)
        return self._converted[key]

    def _papered(self) -> set[str]:
        """Meshes that the description itself puts a texture on."""
        textured = {m.name for m in self.shapes.materials if m.texture}
        return {
            shape.geometry.mesh
            for shape in self.shapes.of("visual")
            if isinstance(shape.geometry, Mesh) and shape.material in textured
        }

    def for_the_eye(self, mesh: Mesh, max_faces: int | None) -> Node:
        """The mesh within the recipe's budget of faces."""
        full, label = self.converted(mesh), self._label(mesh)
        if max_faces is None:
            return full
        if label not in self._decimated:
            self.subjects[f"decimate_mesh {label}"] = f"mesh {mesh.mesh}"
            self._decimated[label] = self._p.add(
                f"decimate_mesh {label}",
                DecimateMesh(max_faces=max_faces),
                {"parts/": full["parts/"], "mesh.json": full["mesh.json"]},
            )
        return self._decimated[label]

    def _label(self, mesh: Mesh) -> str:
        scale = (
            "" if mesh.scale == (1.0, 1.0, 1.0) else " x" + ",".join(f"{s:g}" for s in mesh.scale)
        )
        return self._stems[mesh.mesh] + scale


def _short_names(paths: tuple[str, ...]) -> dict[str, str]:
    """The stem of each path where that is unique, else the path."""
    stems = [PurePosixPath(path).stem for path in paths]
    return {
        path: stem if stems.count(stem) == 1 else path
        for path, stem in zip(paths, stems, strict=True)
    }


def lint_meshes(links: Ref, shapes: Ref, geometry: Geometry, p: Planner) -> Node:
    """Do the meshes stand as the rest of the robot says they should?"""
    inputs, uses = {"links.json": links, "shapes.json": shapes}, []
    for shape in geometry.shapes.shapes:
        if isinstance(shape.geometry, Mesh):
            inputs[f"meshes/{len(uses)}.json"] = geometry.converted(shape.geometry)["mesh.json"]
            uses.append(shape.name)
    return p.add("lint_meshes", LintMeshes(shapes=tuple(uses)), inputs)


def assemble(
    loaded: LoadedRecipe, links: Tree, geometry: Geometry, shapes: Ref, p: Planner
) -> Node:
    """All final shapes and mesh files of the robot."""
    inputs: dict[str, Ref] = {"shapes.json": shapes}
    visuals = _visuals(loaded.recipe, geometry, inputs)
    collisions: list[CollisionUse] = []
    for body in links.bodies:
        collisions += _collisions(loaded, body.name, geometry, inputs, p)
    textures = _textures(geometry, inputs, p)
    step = Assemble(visuals=tuple(visuals), collisions=tuple(collisions), textures=textures)
    return p.add("assemble", step, inputs)


def _textures(geometry: Geometry, inputs: dict[str, Ref], p: Planner) -> tuple[TextureUse, ...]:
    """Pictures of the description's own materials that the source has, as PNG."""
    uses = []
    for number, (path, ref) in enumerate(geometry.textures.items()):
        step = ConvertTexture(name=PurePosixPath(path).name)
        node = p.add(f"convert_texture {path}", step, {"picture": ref})
        inputs[f"textures/{number}/"] = node["texture/"]
        uses.append(TextureUse(texture=path, folder=f"textures/{number}"))
    return tuple(uses)


def _visuals(recipe: Recipe, geometry: Geometry, inputs: dict[str, Ref]) -> list[VisualUse]:
    uses = []
    for shape in geometry.shapes.of("visual"):
        if not isinstance(shape.geometry, Mesh):
            uses.append(VisualUse(shape=shape.name))
            continue
        node = geometry.for_the_eye(shape.geometry, recipe.visual.max_faces)
        folder = f"visual/{node.label}"
        _link_mesh(node, folder, inputs)
        stem = geometry.stem(shape.geometry)
        uses.append(VisualUse(shape=shape.name, folder=folder, stem=stem))
    return uses


def _link_mesh(node: Node, folder: str, inputs: dict[str, Ref]) -> None:
    inputs[f"{folder}/parts/"] = node["parts/"]
    inputs[f"{folder}/mesh.json"] = node["mesh.json"]


def _collisions(
    loaded: LoadedRecipe, link: str, geometry: Geometry, inputs: dict[str, Ref], p: Planner
) -> list[CollisionUse]:
    rule, key = _rule_of(loaded.recipe, link)
    shapes = _source_of(rule, link, geometry.shapes)
    if rule.method == "none" or not shapes:
        return []
    if rule.method in ("keep", "auto"):
        return [_kept(rule, shape, geometry, inputs, loaded, key, p) for shape in shapes]
    method = collision_method(loaded, rule, key)
    if method.scope == "link":
        return [_pieces(method, rule, shapes, link, geometry, inputs, p)]
    return [_pieces(method, rule, (shape,), link, geometry, inputs, p) for shape in shapes]


def _rule_of(recipe: Recipe, link: str) -> tuple[CollisionRule, tuple[str, ...]]:
    for pattern, rule in recipe.collision.links.items():
        if re.fullmatch(pattern, link):
            return rule, ("collision", "links", pattern)
    return recipe.collision.default, ("collision", "default")


def _source_of(rule: CollisionRule, link: str, shapes: Shapes) -> tuple[Shape, ...]:
    of_link = {
        role: tuple(s for s in shapes.shapes if s.link == link and s.role == role)
        for role in ("collision", "visual")
    }
    if rule.from_ == "auto":
        return of_link["collision"] or of_link["visual"]
    return of_link[rule.from_]


def _kept(
    rule: CollisionRule,
    shape: Shape,
    geometry: Geometry,
    inputs: dict[str, Ref],
    loaded: LoadedRecipe,
    key: tuple[str, ...],
    p: Planner,
) -> CollisionUse:
    """`keep`: the source's shape as it is. `auto`: a primitive as it is, a mesh by its hull."""
    if not isinstance(shape.geometry, Mesh):
        return CollisionUse(link=shape.link, shape=shape.name)
    if rule.method == "auto":
        hull = collision_method(loaded, rule.model_copy(update={"method": "hull"}), key)
        return _pieces(hull, rule, (shape,), shape.link, geometry, inputs, p)
    node = geometry.converted(shape.geometry)
    folder = f"collision/{node.label}"
    _link_mesh(node, folder, inputs)
    stem = geometry.stem(shape.geometry)
    return CollisionUse(link=shape.link, shape=shape.name, mesh=folder, stem=stem)


def collision_method(
    loaded: LoadedRecipe, rule: CollisionRule, key: tuple[str, ...]
) -> type[CollisionMethod]:
    """The plug-in of a rule; RecipeError for an unknown one, or a key that it does not have."""
    try:
        method = load_plugin(CollisionMethod, "assetbuild.collision", rule.method)
    except KeyError:
        known = (*plugin_names("assetbuild.collision"), "auto", "keep", "none")
        raise RecipeError(
            f"{'.'.join(key)}: no collision method `{rule.method}`",
            where=loaded.where((*key, "method")),
            hint=did_you_mean(rule.method, known),
        ) from None
    foreign = [name for name in _options(rule) if name not in method.model_fields]
    if foreign:
        raise RecipeError(
            f"{'.'.join(key)}: `{rule.method}` has no key `{foreign[0]}`",
            where=loaded.where((*key, foreign[0])),
            hint=did_you_mean(foreign[0], [n for n in method.model_fields if n != "sources"]),
        )
    return method


def _options(rule: CollisionRule) -> dict[str, object]:
    """The keys of a rule that are parameters of its method."""
    return {
        name: value
        for name, value in rule.model_dump(exclude={"method", "from_"}).items()
        if value is not None
    }


def _pieces(
    method: type[CollisionMethod],
    rule: CollisionRule,
    shapes: tuple[Shape, ...],
    link: str,
    geometry: Geometry,
    inputs: dict[str, Ref],
    p: Planner,
) -> CollisionUse:
    """One run of a collision method, shared by all links that ask for the same."""
    per_link = method.scope == "link"
    sources: list[PlacedSource] = []
    step_inputs: dict[str, Ref] = {}
    for index, shape in enumerate(shapes):
        pose = shape.X_link_shape if per_link else None
        if isinstance(shape.geometry, Mesh):
            folder = f"shapes/{index}"
            _link_mesh(geometry.converted(shape.geometry), folder, step_inputs)
            sources.append(PlacedSource.of_mesh(folder, pose))
        else:
            sources.append(PlacedSource.of_primitive(shape.geometry, pose))
    step = method.model_validate({"sources": tuple(sources), **_options(rule)})
    label = f"{method.step_name()} {link if per_link else shapes[0].name}"
    node = p.add(label, step, step_inputs)
    geometry.subjects[label] = f"link {link}"
    folder = f"collision/{label}"
    inputs[f"{folder}/pieces/"] = node["pieces/"]
    inputs[f"{folder}/pieces.json"] = node["pieces.json"]
    origin = None if per_link else shapes[0].name
    return CollisionUse(link=link, shape=origin, pieces=folder, stem=link)
