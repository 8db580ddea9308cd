"""Which collision method works on which shapes, with which fields; and which shapes are equal."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import numpy as np

from assetbuild.collision import CollisionMethod, Likeness, PlacedSource
from assetbuild.engine.graph import Node
from assetbuild.engine.planner import Planner
from assetbuild.engine.world import World
from assetbuild.errors import did_you_mean
from assetbuild.geometry.match_shapes import MatchShapes
from assetbuild.mesh.read import Format
from assetbuild.mesh.verdict import Probe
from assetbuild.plugins import load_plugin
from assetbuild.recipe.models import CollisionRule, Recipe, ShapedRule
from assetbuild.recipe.validation import Key, KeyedError
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import IDENTITY, vec3
from assetbuild.robot.ranges import first_match
from assetbuild.robot.sections import Region, ToleranceRegion
from assetbuild.robot.shapes import MeshFile, Role, SourceShape, SourceShapes

BUILT_IN = ("keep", "none")
"""Methods that need no step of their own."""
DECOMPOSING = ("auto", "coacd", "vhacd", "spheres")
"""Methods whose result is worth the search for an equal shape."""


@dataclass(frozen=True, eq=False)
class Job:
    """One collision use of a link; equal to itself alone. method: None = its shapes as they are.

    fields: of the step, from the recipe; without sources and probes. own: inputs `own/<number>`.
    """

    link: str
    shapes: tuple[SourceShape, ...]
    method: type[CollisionMethod] | None = None
    fields: Mapping[str, Any] = field(default_factory=dict)  # Any: any field of any plug-in
    places: tuple[Region, ...] = ()
    own: tuple[MeshFile, ...] = ()

    @property
    def per_link(self) -> bool:
        """Whether the result is in the frame of the link; else in that of its one shape."""
        scope = self.method.scope if self.method else "shape"
        return scope == "link" or (scope == "shapes" and len(self.shapes) != 1)

    @property
    def label(self) -> str:
        """The label of the job's node."""
        name = self.method.step_name() if self.method else "keep"
        per_shape = self.method is None or self.method.scope == "shape"
        return f"{name} {self.shapes[0].name if per_shape else self.link}"

    def step(self, like: Likeness | None = None) -> CollisionMethod:
        """The step; poses and places are in the frame of the result."""
        if self.method is None:
            raise ValueError("kept shapes need no step")
        sources = []
        for index, shape in enumerate(self.shapes):
            pose = shape.X_link_shape if self.per_link else IDENTITY
            if isinstance(shape.geometry, MeshFile):
                sources.append(PlacedSource(f"shapes/{index}", pose=pose))
            else:
                sources.append(PlacedSource.of_primitive(shape.geometry, pose))
        given = {"sources": tuple(sources), "probes": self._probes(), **self.fields}
        return self.method.model_validate(given | ({"like": like} if like else {}))

    def _probes(self) -> tuple[Probe, ...]:
        alone = self.shapes and not self.per_link
        X_output_link = self.shapes[0].X_link_shape.inverse() if alone else IDENTITY
        made = []
        for place in self.places:
            most = place.max_outside if isinstance(place, ToleranceRegion) else None
            start, end = (vec3(X_output_link.apply(np.asarray([e]))[0]) for e in place.ends)
            made.append(Probe(start=start, end=end, radius=place.radius, max_outside=most))
        return tuple(made)


def collision_jobs(
    recipe: Recipe, folder: Path, links: Tree, shapes: SourceShapes
) -> tuple[Job, ...]:
    """All collision uses of the robot, in the order of its links. folder: of the recipe."""
    by_link = (_jobs_of(recipe, folder, body.name, shapes) for body in links.bodies)
    return tuple(job for jobs in by_link for job in jobs)


def _jobs_of(recipe: Recipe, folder: Path, link: str, shapes: SourceShapes) -> list[Job]:
    rule = first_match(recipe.collision.links, link) or recipe.collision.default
    roles: tuple[Role, ...] = ("collision", "visual")  # of `auto`, the first that there is
    if rule.from_ != "auto":
        roles = (rule.from_,)
    of_roles = (tuple(s for s in shapes.of(role) if s.link == link) for role in roles)
    link_shapes = next(filter(None, of_roles), ())
    if rule.method in BUILT_IN or not isinstance(rule, ShapedRule):
        return [Job(link, (shape,)) for shape in link_shapes] if rule.method == "keep" else []
    method = load_plugin(CollisionMethod, rule.method)
    if not link_shapes and method.step_name() != "explicit":
        return []
    fields = _fields(rule, recipe, method)
    places = (*rule.keep_open, *rule.regions)
    if method.scope != "shape":
        files = _own_meshes(fields, folder)
        return [Job(link, link_shapes, method, fields, places, files)]
    return [
        Job(link, (shape,))
        if isinstance(shape.geometry, method.keeps)
        else Job(link, (shape,), method, fields, places)
        for shape in link_shapes
    ]


def _own_meshes(
    fields: dict[str, Any],  # Any: as Job.fields
    folder: Path,
) -> tuple[MeshFile, ...]:
    """The mesh files of a rule's pieces; in `fields` they become inputs, whatever their names."""
    meshes: list[MeshFile] = []
    for piece in fields.get("pieces", ()):
        if piece["file"] is not None:
            path = str(file_of(piece["file"], folder))
            mesh = MeshFile(path, piece["scale"] or (1.0, 1.0, 1.0))
            meshes += [mesh] * (mesh not in meshes)
            piece |= {"file": f"own/{meshes.index(mesh)}", "scale": None}
    return tuple(meshes)


def file_of(name: str, folder: Path) -> Path:
    """The absolute path of a file that a recipe in `folder` names."""
    return Path(os.path.normpath(folder / name))


def check_files(rule: CollisionRule, key: Key, folder: Path, world: World) -> None:
    """KeyedError for a piece whose file is not there, or no mesh by its name."""
    for number, piece in enumerate(getattr(rule, "pieces", None) or ()):
        if piece.file is None:
            continue
        path = file_of(piece.file, folder)
        place = (*key, "pieces", number, "file")
        if path.suffix.lower().lstrip(".") not in get_args(Format):
            hint = f"known formats: {', '.join(get_args(Format))}"
            raise KeyedError(place, f"`{piece.file}` is no mesh by its name", hint)
        if not world.is_file(path):
            hint = did_you_mean(path.name, world.names(path.parent))
            hint = hint or "paths are relative to the recipe's folder"
            raise KeyedError(place, f"no file `{piece.file}`", hint)


def _fields(
    rule: CollisionRule, recipe: Recipe, method: type[CollisionMethod]
) -> dict[str, Any]:  # Any: as Job.fields
    """The keys of a rule that are fields of its step; a preset fills in what it does not state."""
    preset = method.preset(rule.preset or recipe.collision.preset)
    dumped = rule.model_dump(include=set(method.keys()))
    stated = {k: v for k, v in dumped.items() if v is not None}
    return dict(preset) | stated


# --- equal shapes ---------------------------------------------------------------------------


Converted = Callable[[MeshFile], Node]
"""The node of a converted mesh."""
Twins = Mapping[Job, tuple[Job, Likeness]]
"""Job that may reuse a result -> the earlier one with an equal shape and equal fields."""


def equal_shapes(jobs: Sequence[Job], converted: Converted, p: Planner) -> Twins | None:
    """Jobs that may take the result of another; None while that is not known.

    A question to the graph: meshes are compared once they are converted.
    """
    groups: dict[MeshFile, dict[str, list[Job]]] = {}
    for job in jobs:
        if job.method is None or job.method.step_name() not in DECOMPOSING:
            continue
        mesh = job.shapes[0].geometry
        if not job.per_link and not job.places and isinstance(mesh, MeshFile):
            options = json.dumps([job.method.step_name(), job.fields], sort_keys=True, default=str)
            groups.setdefault(mesh, {}).setdefault(options, []).append(job)
    if len(groups) < 2:
        return {}
    folders = {f"shapes/{number}": mesh for number, mesh in enumerate(groups)}
    inputs = {f"{folder}/parts/": converted(mesh)["parts/"] for folder, mesh in folders.items()}
    node = p.add("match_shapes", MatchShapes(folders=tuple(folders)), inputs)
    answer = p.ask(node["matches.json"])
    if answer is None:
        return None
    twins: dict[Job, tuple[Job, Likeness]] = {}
    for folder, match in json.loads(answer).items():
        likeness = Likeness(vec3(match["signs"]), vec3(match["shift"]))
        earlier = groups[folders[match["like"]]]
        for options, same in groups[folders[folder]].items():
            others = earlier.get(options)
            if others and jobs.index(others[0]) < jobs.index(same[0]):  # else not planned yet
                twins |= dict.fromkeys(same, (others[0], likeness))
    return twins
