"""Recipe to graph, top to bottom: the only wiring, and the map of the project.

    source -> read -> lint -> edits -> merge fixed joints -> lint -> meshes -> collision -> assemble
           -> control -> targets -> checks

A plan may ask: where the graph depends on what a built file says (which meshes does this URDF
name?), `Planner.ask` gives its bytes, or None while it is not built. Then the plan ends early,
the open question is built, and the recipe is planned again. An answer only ever adds nodes.
"""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from assetbuild.engine.graph import Node, Planner, Ref
from assetbuild.kinds import Check, Target, load_plugin, plugin_names
from assetbuild.lock import Lock
from assetbuild.plan.agree import check_against_robot, check_names, turned_meshes
from assetbuild.plan.companions import companions
from assetbuild.plan.edits import apply_edits, edit_keys
from assetbuild.plan.geometry import Geometry, assemble, lint_meshes
from assetbuild.plan.source import Description, Source, description_of, open_source
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import Recipe
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Shapes, Tree
from assetbuild.steps.control import ControlStep
from assetbuild.steps.lint_bodies import LintBodies
from assetbuild.steps.lint_links import LintLinks
from assetbuild.steps.merge_fixed_joints import MergeFixedJoints
from assetbuild.steps.read_urdf import ReadUrdf


@dataclass
class Outline:
    """What a plan leaves for the report and the bundle: references into the graph.

    skipped: checks that this machine cannot run, and why. subjects: what a node works on, where
    the node itself does not know. edits: label of an edit's node -> its key in the recipe.
    expanded: the URDF behind a xacro, which its lines count. absent: files that were looked for;
    their appearance changes the build.
    """

    source_map: Ref | None = None
    expanded: Ref | None = None
    absent: tuple[Path, ...] = ()
    robot: dict[str, Ref] = field(default_factory=dict)
    targets: dict[str, Node] = field(default_factory=dict)
    checks: dict[str, Node] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)
    licenses: dict[str, Ref] = field(default_factory=dict)
    subjects: dict[str, str] = field(default_factory=dict)
    edits: dict[str, tuple[str | int, ...]] = field(default_factory=dict)


def plan(loaded: LoadedRecipe, lock: Lock | None, p: Planner) -> Outline:
    """Add the graph of one recipe to the planner, as far as the answers reach."""
    recipe, outline = loaded.recipe, Outline()
    check_names(loaded)
    source = open_source(loaded, lock, p)
    description = description_of(loaded, source, p)
    outline.licenses = source.licenses()
    if description is None:
        return outline

    read = _read(recipe, description, p)
    outline.source_map = read["source_map.json"]
    outline.expanded = description.ref if recipe.source.xacro else None
    geometry = _geometry(loaded, source, description, read, p)
    outline.absent = source.absent
    edited = apply_edits(loaded, read, geometry, p)
    outline.edits = edit_keys(loaded)
    if edited is None:
        return outline
    tree = _merge(recipe, edited, p)
    links, shapes = p.ask(edited["links.json"]), p.ask(edited["shapes.json"])
    merged = p.ask(tree["tree.json"])
    if links is None or shapes is None or merged is None:
        return outline
    check_against_robot(loaded, decode(Tree, links), decode(Tree, merged))

    if geometry is None:
        return outline
    geometry.shapes = decode(Shapes, shapes)
    lint_meshes(edited["links.json"], edited["shapes.json"], geometry, p)
    assembled = assemble(loaded, decode(Tree, links), geometry, edited["shapes.json"], p)
    outline.subjects = geometry.subjects
    control = _control(recipe, tree, assembled, p)
    outline.robot = {
        "links.json": edited["links.json"],
        "tree.json": tree["tree.json"],
        "shapes.json": assembled["shapes.json"],
        "control.json": control["control.json"],
        "meshes/": assembled["meshes/"],
    }
    outline.targets = _targets(recipe, outline.robot, p)
    _checks(recipe, outline, _comparable(recipe, outline, read), p)
    return outline


# --- reading and merging --------------------------------------------------------------------


def _read(recipe: Recipe, description: Description, p: Planner) -> Node:
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


def _geometry(
    loaded: LoadedRecipe, source: Source, description: Description, read: Node, p: Planner
) -> Geometry | None:
    """The source's meshes; None while it is not known which there are."""
    meshes, shapes = p.ask(read["meshes.json"]), p.ask(read["shapes.json"])
    if meshes is None or shapes is None:
        return None
    drawn = decode(Shapes, shapes)
    files = source.meshes(json.loads(meshes), description.path)
    textures = source.present("own textures", {m.texture for m in drawn.materials if m.texture})
    if files is None or textures is None:
        return None
    named = companions(files, source, p)
    if named is None:
        return None
    return Geometry(drawn, files, named, textures, turned_meshes(loaded, files), p)


def _merge(recipe: Recipe, edited: Mapping[str, Ref], p: Planner) -> Node:
    fixed = recipe.fixed_joints
    step = MergeFixedJoints(merge=fixed.merge, keep_bodies=fixed.keep_bodies)
    tree = p.add("merge_fixed_joints", step, {"links.json": edited["links.json"]})
    linted = {"tree.json": tree["tree.json"], "shapes.json": edited["shapes.json"]}
    p.add("lint_bodies", LintBodies(), linted)
    return tree


# --- control, targets, checks ---------------------------------------------------------------


def _control(recipe: Recipe, tree: Node, assembled: Node, p: Planner) -> Node:
    step = ControlStep.configure(recipe)
    inputs = {
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


def _comparable(recipe: Recipe, outline: Outline, read: Node) -> Ref | None:
    """The URDF that the robot must equal: the source's; after edits, the one that we wrote."""
    if not recipe.edits:
        return read["source.urdf"]
    written = outline.targets.get("urdf")
    return written["urdf/"] / f"{recipe.robot}.urdf" if written else None


def _checks(recipe: Recipe, outline: Outline, source: Ref | None, p: Planner) -> None:
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
        if "source" in check.needs and source is None:
            outline.skipped[name] = "the edits changed the robot: add `urdf` to the targets"
            continue
        inputs = {port: outline.robot[port] for port in check.reads}
        for need in check.needs:
            if need == "source" and source is not None:
                inputs["source.urdf"] = source
            else:
                inputs[f"{need}/"] = outline.targets[need][f"{need}/"]
        outline.checks[name] = p.add(f"check {name}", step, inputs)
