"""Meshes and collision: each conversion and each decomposition once, then put in place."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import PurePosixPath

from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner
from assetbuild.geometry.assemble import Assemble, CollisionUse, TextureUse, VisualUse
from assetbuild.geometry.companions import Companions
from assetbuild.geometry.convert_mesh import ConvertMesh
from assetbuild.geometry.convert_texture import ConvertTexture
from assetbuild.geometry.decimate_mesh import DecimateMesh
from assetbuild.geometry.jobs import Job, OwnMesh, Twins, collision_jobs, equal_shapes
from assetbuild.geometry.lint_density import LintDensity
from assetbuild.geometry.lint_meshes import LintMeshes
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import Recipe
from assetbuild.robot.model import Mesh, Shapes, Tree
from assetbuild.robot.sides import Side, side_of


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
        self.shapes, self.textures = shapes, dict(textures)
        self._files, self._companions, self._p = dict(files), dict(companions), p
        self._turned = set(turned)
        self._converted: dict[tuple[str, tuple[float, float, float]], Node] = {}
        self._decimated: dict[str, Node] = {}
        self._own: dict[OwnMesh, Node] = {}
        self.subjects: dict[str, str] = {}
        self._stems = _short_names(tuple(files))

    def mount(self, part: Geometry, path_of: Callable[[str], str]) -> None:
        """Take in the files of a part; path_of: their paths in the whole."""
        self._files |= {path_of(path): ref for path, ref in part._files.items()}
        self._companions |= {path_of(path): named for path, named in part._companions.items()}
        self.textures |= {path_of(path): ref for path, ref in part.textures.items()}
        self._turned |= {path_of(path) for path in part._turned}
        self._stems = _short_names(tuple(self._files)) | self._stems

    def stem(self, mesh: Mesh) -> str:
        """The short name of a mesh file: `calf`."""
        return PurePosixPath(mesh.mesh).stem

    def is_converted(self, mesh: Mesh) -> bool:
        """Has anything asked for this mesh so far?"""
        return (mesh.mesh, mesh.scale) in self._converted

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

    def own(self, mesh: OwnMesh) -> Node:
        """A mesh file of the user's own, as OBJ; its colours and pictures do not matter."""
        if mesh not in self._own:
            name = mesh.path.name
            step = ConvertMesh(format=mesh.path.suffix.lower().lstrip("."), scale=mesh.scale)
            label = f"convert_mesh own {len(self._own)} {name}"
            self.subjects[label] = f"mesh {name}"
            self._own[mesh] = self._p.add(label, step, {"mesh": self._p.source(mesh.path)})
        return self._own[mesh]

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
    """Do the meshes stand as the rest of the robot says they should?

    Only those that the build converts: one that nothing uses may be broken.
    """
    inputs = {"links.json": links, "shapes.json": shapes}
    uses: list[str] = []
    for shape in geometry.shapes.shapes:
        if isinstance(shape.geometry, Mesh) and geometry.is_converted(shape.geometry):
            inputs[f"meshes/{len(uses)}.json"] = geometry.converted(shape.geometry)["mesh.json"]
            uses.append(shape.name)
    return p.add("lint_meshes", LintMeshes(shapes=tuple(uses)), inputs)


def lint_density(robot: Mapping[str, Ref], geometry: Geometry, p: Planner) -> None:
    """Add the lint of densities, over the source's own masses and meshes."""
    inputs = dict(robot)
    names: list[str] = []
    for shape in geometry.shapes.of("visual"):
        if isinstance(shape.geometry, Mesh):
            inputs[f"meshes/{len(names)}.json"] = geometry.converted(shape.geometry)["mesh.json"]
            names.append(shape.name)
    if names:
        p.add("lint_density", LintDensity(shapes=tuple(names)), inputs)


def assemble(
    loaded: LoadedRecipe,
    links: Tree,
    geometry: Geometry,
    shapes: Ref,
    sides: Sequence[Side],
    p: Planner,
) -> Node | None:
    """All final shapes and mesh files of the robot; None while equal shapes are looked for.

    sides: shapes of one that comes as MJCF keep their names.
    """
    inputs: dict[str, Ref] = {"shapes.json": shapes}
    visuals = _visuals(loaded.recipe, geometry, sides, inputs)
    jobs = collision_jobs(loaded, links, geometry)
    twins = equal_shapes(jobs, geometry, p)
    if twins is None:
        return None
    nodes: dict[int, Node] = {}
    collisions = []
    for job in jobs:
        if job.method is None:
            use = _kept(job, geometry, inputs)
        else:
            node = nodes[id(job)] = _add(job, twins, nodes, geometry, p)
            use = _use(job, node, inputs)
        named = side_of(sides, job.link).from_mjcf
        collisions.append(use.model_copy(update={"named": named}))
    step = Assemble(
        visuals=tuple(visuals),
        collisions=tuple(collisions),
        textures=_textures(geometry, inputs, p),
    )
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


def _visuals(
    recipe: Recipe, geometry: Geometry, sides: Sequence[Side], inputs: dict[str, Ref]
) -> list[VisualUse]:
    uses = []
    for shape in geometry.shapes.of("visual"):
        named = side_of(sides, shape.link).from_mjcf
        if not isinstance(shape.geometry, Mesh):
            uses.append(VisualUse(shape=shape.name, named=named))
            continue
        node = geometry.for_the_eye(shape.geometry, recipe.visual.max_faces)
        folder = f"visual/{node.label}"
        _link_mesh(node, folder, inputs)
        stem = geometry.stem(shape.geometry)
        uses.append(VisualUse(shape=shape.name, folder=folder, stem=stem, named=named))
    return uses


def _link_mesh(node: Node, folder: str, inputs: dict[str, Ref]) -> None:
    inputs[f"{folder}/parts/"] = node["parts/"]
    inputs[f"{folder}/mesh.json"] = node["mesh.json"]


def _kept(job: Job, geometry: Geometry, inputs: dict[str, Ref]) -> CollisionUse:
    """The source's shape as it is."""
    (shape,) = job.shapes
    if not isinstance(shape.geometry, Mesh):
        return CollisionUse(link=job.link, shape=shape.name)
    node = geometry.converted(shape.geometry)
    folder = f"collision/{node.label}"
    _link_mesh(node, folder, inputs)
    stem = geometry.stem(shape.geometry)
    return CollisionUse(link=job.link, shape=shape.name, mesh=folder, stem=stem)


def _add(job: Job, twins: Twins, nodes: Mapping[int, Node], geometry: Geometry, p: Planner) -> Node:
    """One run of a collision method, shared by all links that ask for the same."""
    inputs: dict[str, Ref] = {}
    for index, shape in enumerate(job.shapes):
        if isinstance(shape.geometry, Mesh):
            _link_mesh(geometry.converted(shape.geometry), f"shapes/{index}", inputs)
    for index, mesh in enumerate(job.own):
        _link_mesh(geometry.own(mesh), f"own/{index}", inputs)
    step = job.step()
    twin = twins.get(id(job))
    if twin is not None:
        other = nodes[id(twin.job)]
        step = job.step(like=twin.likeness)
        for output in ("pieces/", "pieces.json", "quality.json"):
            inputs[f"like/{output}"] = other[output]
    node = p.add(job.label, step, inputs)
    geometry.subjects[job.label] = f"link {job.link}"
    return node


def _use(job: Job, node: Node, inputs: dict[str, Ref]) -> CollisionUse:
    folder = f"collision/{node.label}"
    inputs[f"{folder}/pieces/"] = node["pieces/"]
    inputs[f"{folder}/pieces.json"] = node["pieces.json"]
    origin = None if job.per_link else job.shapes[0].name
    return CollisionUse(link=job.link, shape=origin, pieces=folder, stem=job.link)
