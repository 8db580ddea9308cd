"""Meshes and collision: each conversion and each decomposition once, then put in place."""

from __future__ import annotations

import functools
import json
import posixpath
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import get_args

from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner
from assetbuild.engine.step import Step
from assetbuild.geometry.assemble import Assemble, Use
from assetbuild.geometry.companion_files import ConvertTexture, MeshCompanions
from assetbuild.geometry.convert_mesh import ConvertMesh
from assetbuild.geometry.decimate_mesh import DecimateMesh
from assetbuild.geometry.jobs import Job, Twins, collision_jobs, equal_shapes
from assetbuild.geometry.lint_meshes import LintDensity, LintMeshes
from assetbuild.mesh.companions import Naming, format_of
from assetbuild.recipe.models import Recipe
from assetbuild.robot.model import Tree
from assetbuild.robot.shapes import MeshFile, Role, SourceShape, SourceShapes
from assetbuild.robot.sides import Side, side_of
from assetbuild.source.plan import SourceFiles

PLAIN = ("stl", "msh")
"""Formats without colours: one conversion does for what is drawn and for what collides."""
MESH = ("parts/", "mesh.json")
"""What the conversions write."""
PIECES = ("pieces.npz", "pieces.json")
"""What a collision method writes, its figures aside."""


class Geometry:
    """Conversions of the source's meshes, each file and scale once.

    subjects: label of a node -> the mesh it works on; the steps do not know its path, so that
    equal files share their results. textures: of the description's own materials, by path.
    turned: paths of the meshes whose up axis is honoured.
    """

    def __init__(
        self,
        shapes: SourceShapes,
        files: Mapping[str, Ref],
        companions: Companions,
        textures: Mapping[str, Ref],
        turned: Collection[str],
        p: Planner,
    ) -> None:
        self.shapes, self.textures = shapes, dict(textures)
        self._files, self._companions, self._p = dict(files), dict(companions), p
        self._turned = set(turned)
        self._converted: dict[MeshFile, Node] = {}
        self._decimated: dict[MeshFile, Node] = {}
        self.subjects: dict[str, str] = {}
        self._stems = _short_names(tuple(files))

    def mount(self, part: Geometry, path_of: Callable[[str], str]) -> None:
        """Take in the files of a part; path_of: their paths in the whole."""
        self._files |= {path_of(path): ref for path, ref in part._files.items()}
        self._companions |= {path_of(path): named for path, named in part._companions.items()}
        self.textures |= {path_of(path): ref for path, ref in part.textures.items()}
        self._turned |= {path_of(path) for path in part._turned}
        self._stems = _short_names(tuple(self._files)) | self._stems

    def is_converted(self, shape: SourceShape) -> bool:
        """Is it a mesh that anything asked for so far?"""
        return shape.geometry in self._converted

    def converted(self, mesh: MeshFile) -> Node:
        """The full mesh, one part per material; of the source, or a file of the user's own."""
        if mesh not in self._converted:
            named = self._companions.get(mesh.path, {})
            step = ConvertMesh(
                format=format_of(mesh.path),
                scale=mesh.scale,
                up_axis="honour" if mesh.path in self._turned else "ignore",
                companions=tuple(named),
                keep_uv=mesh.path in self._drawn(textured=True),
                drawn=format_of(mesh.path) in PLAIN or mesh.path in self._drawn(textured=False),
            )
            file = self._files.get(mesh.path) or self._p.source(Path(mesh.path))
            inputs = {"mesh": file}
            inputs |= {f"companions/{i}": ref for i, ref in enumerate(named.values())}
            label = f"convert_mesh {self._label(mesh)}"
            self._converted[mesh] = self._add(label, step, inputs, mesh)
        return self._converted[mesh]

    def visual(self, mesh: MeshFile, max_faces: int | None) -> Node:
        """The mesh within the recipe's budget of faces."""
        full = self.converted(mesh)
        if max_faces is None:
            return full
        if mesh not in self._decimated:
            label = f"decimate_mesh {self._label(mesh)}"
            inputs = {port: full[port] for port in MESH}
            step = DecimateMesh(max_faces=max_faces)
            self._decimated[mesh] = self._add(label, step, inputs, mesh)
        return self._decimated[mesh]

    def _add(self, label: str, step: Step, inputs: Mapping[str, Ref], mesh: MeshFile) -> Node:
        is_own = mesh.path not in self._files
        self.subjects[label] = f"mesh {PurePosixPath(mesh.path).name if is_own else mesh.path}"
        return self._p.add(label, step, inputs)

    def _drawn(self, *, textured: bool) -> set[str]:
        """Meshes that are seen; textured: those that the description itself puts a texture on."""
        names = {m.name for m in self.shapes.materials if m.texture}
        return {
            shape.geometry.path
            for shape in self.shapes.of("visual")
            if isinstance(shape.geometry, MeshFile) and (shape.material in names or not textured)
        }

    def _label(self, mesh: MeshFile) -> str:
        scale = (
            "" if mesh.scale == (1.0, 1.0, 1.0) else " x" + ",".join(f"{s:g}" for s in mesh.scale)
        )
        own = f"own {len(self._converted)} {PurePosixPath(mesh.path).name}"
        return self._stems.get(mesh.path, own) + scale


def _short_names(paths: tuple[str, ...]) -> dict[str, str]:
    """The stem of each path where that is unique, else the path."""
    stems = [PurePosixPath(path).stem for path in paths]
    return {
        path: stem if stems.count(stem) == 1 else path
        for path, stem in zip(paths, stems, strict=True)
    }


def _inputs(node: Node, outputs: Iterable[str], folder: str) -> dict[str, Ref]:
    """Outputs of a node as inputs of those names below `folder`."""
    return {f"{folder}/{output}": node[output] for output in outputs}


def lint_meshes(links: Ref, shapes: Ref, geometry: Geometry, p: Planner) -> Node:
    """Do the meshes stand as the rest of the robot says they should?

    Only those that the build converts: one that nothing uses may be broken.
    """
    wanted = filter(geometry.is_converted, geometry.shapes.shapes)
    names, records = _records(wanted, geometry)
    inputs = {"links.json": links, "shapes.json": shapes, **records}
    return p.add("lint_meshes", LintMeshes(shapes=names), inputs)


def lint_density(robot: Mapping[str, Ref], geometry: Geometry, p: Planner) -> None:
    """Add the lint of densities, over the source's own masses and meshes."""
    names, records = _records(geometry.shapes.of("visual"), geometry)
    if names:
        p.add("lint_density", LintDensity(shapes=names), {**robot, **records})


def _records(
    shapes: Iterable[SourceShape], geometry: Geometry
) -> tuple[tuple[str, ...], dict[str, Ref]]:
    """Names of those that are meshes, and the records of these as numbered inputs."""
    meshes = {s.name: s.geometry for s in shapes if isinstance(s.geometry, MeshFile)}
    nodes = map(geometry.converted, meshes.values())
    return tuple(meshes), {f"meshes/{n}.json": node["mesh.json"] for n, node in enumerate(nodes)}


def assemble(
    recipe: Recipe,
    folder: Path,
    links: Tree,
    geometry: Geometry,
    shapes: Ref,
    sides: Sequence[Side],
    p: Planner,
) -> Node | None:
    """All final shapes and mesh files of the robot; None while equal shapes are looked for.

    folder: of the recipe. sides: shapes of one that comes as MJCF keep their names.
    """
    inputs: dict[str, Ref] = {"shapes.json": shapes}
    shown = functools.partial(geometry.visual, max_faces=recipe.visual.max_faces)
    uses = [_as_it_is(s, "visual", shown, inputs) for s in geometry.shapes.of("visual")]
    jobs = collision_jobs(recipe, folder, links, geometry.shapes)
    twins = equal_shapes(jobs, geometry.converted, p)
    if twins is None:
        return None
    nodes: dict[Job, Node] = {}
    for job in jobs:
        if job.method is None:
            uses.append(_as_it_is(job.shapes[0], "collision", geometry.converted, inputs))
            continue
        node = nodes[job] = _add(job, twins, nodes, geometry, p)
        place = f"collision/{node.label}"
        inputs |= _inputs(node, PIECES, place)
        origin = None if job.per_link else job.shapes[0].name
        uses.append(Use(job.link, "collision", origin, pieces=place, stem=job.link))
    named = (replace(use, named=side_of(sides, use.link).from_mjcf) for use in uses)
    for number, (path, ref) in enumerate(geometry.textures.items()):
        texture = ConvertTexture(name=PurePosixPath(path).name)
        node = p.add(f"convert_texture {path}", texture, {"picture": ref})
        inputs[f"textures/{number}/"] = node["texture/"]
    step = Assemble(uses=tuple(named), textures=tuple(geometry.textures))
    return p.add("assemble", step, inputs)


def _as_it_is(
    shape: SourceShape, role: Role, built: Callable[[MeshFile], Node], inputs: dict[str, Ref]
) -> Use:
    """The source's shape; built: the node of its mesh."""
    use = Use(shape.link, role, shape.name)
    if not isinstance(shape.geometry, MeshFile):
        return use
    node = built(shape.geometry)
    folder = f"{role}/{node.label}"
    inputs |= _inputs(node, MESH, folder)
    return replace(use, mesh=folder, stem=PurePosixPath(shape.geometry.path).stem)


def _add(job: Job, twins: Twins, nodes: Mapping[Job, Node], geometry: Geometry, p: Planner) -> Node:
    """One run of a collision method, shared by all links that ask for the same."""
    inputs: dict[str, Ref] = {}
    for index, shape in enumerate(job.shapes):
        if isinstance(shape.geometry, MeshFile):
            inputs |= _inputs(geometry.converted(shape.geometry), MESH, f"shapes/{index}")
    for index, mesh in enumerate(job.own):
        inputs |= _inputs(geometry.converted(mesh), MESH, f"own/{index}")
    other, likeness = twins.get(job, (None, None))
    if other is not None:
        inputs |= _inputs(nodes[other], (*PIECES, "quality.json"), "like")
    geometry.subjects[job.label] = f"link {job.link}"
    return p.add(job.label, job.step(likeness), inputs)


# --- files that meshes name -------------------------------------------------------------------

Companions = Mapping[str, Mapping[str, Ref]]
"""Path of a mesh -> name from the mesh's folder -> file. What the source lacks is not in it."""


def companions(files: Mapping[str, Ref], source: SourceFiles, p: Planner) -> Companions | None:
    """What every mesh names and the source has; None while a question is open.

    A material library names pictures in its turn; what those are called from the mesh's folder
    is what `convert_mesh` looks for.
    """
    named: dict[str, tuple[str, ...]] = {}
    available: dict[str, Ref] = {}
    new = files
    for question in ("mesh companions", "library pictures"):
        more = _named(new, p)
        if more is None:
            return None
        named |= more
        wanted = {path for paths in more.values() for path in paths} - set(available)
        found = source.present(question, wanted)
        if found is None:
            return None
        available |= found
        new = {path: ref for path, ref in found.items() if format_of(path) == "mtl"}
    return {
        mesh: {
            posixpath.relpath(path, posixpath.dirname(mesh) or "."): available[path]
            for name in names
            for path in (name, *(named.get(name, ()) if format_of(name) == "mtl" else ()))
            if path in available
        }
        for mesh, names in named.items()
        if mesh in files
    }


def _named(files: Mapping[str, Ref], p: Planner) -> dict[str, tuple[str, ...]] | None:
    """Path of each file -> paths below the source's root that it names."""
    nodes = {
        path: p.add(f"mesh_companions {path}", MeshCompanions(format=kind), {"mesh": ref})
        for path, ref in files.items()
        if (kind := format_of(path)) in get_args(Naming)
    }
    answers = {path: p.ask(node["companions.json"]) for path, node in nodes.items()}
    named: dict[str, tuple[str, ...]] = {}
    for path, answer in answers.items():
        if answer is None:
            return None
        folder = posixpath.dirname(path)
        paths = (posixpath.normpath(posixpath.join(folder, n)) for n in json.loads(answer))
        # What leads out of the source is not followed; `convert_mesh` says that it is not there.
        named[path] = tuple(path for path in paths if not path.startswith("../"))
    return named
