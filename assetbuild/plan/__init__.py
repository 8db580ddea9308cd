"""Recipe to graph, top to bottom: the only wiring, and the map of the project.

    source -> read -> lint -> edits -> merge fixed joints -> lint -> meshes -> collision -> assemble
           -> control -> targets -> pictures -> checks

A plan may ask: where the graph depends on what a built file says (which meshes does this URDF
name?), `Planner.ask` gives its bytes, or None while it is not built. Then the plan ends early,
the open question is built, and the recipe is planned again. An answer only ever adds nodes.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from assetbuild.body.lint import LintBodies, LintLinks
from assetbuild.body.measure_bodies import MeasureBodies
from assetbuild.body.merge_fixed_joints import MergeFixedJoints
from assetbuild.compose.plan import Ready, compose
from assetbuild.control.keep import KeepPose, KeepRatings
from assetbuild.control.plan import control, control_step, own_side
from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner
from assetbuild.errors import Gather, RecipeError
from assetbuild.geometry.assemble import Assemble
from assetbuild.geometry.measure_assets import MeasureAssets
from assetbuild.geometry.plan import Geometry, assemble, companions, lint_density, lint_meshes
from assetbuild.lock import Lock, lock_path, read_lock
from assetbuild.plan.asked import checks_of, readers_of
from assetbuild.plan.edits import AGAIN, apply_edits, edits_of, guessed_links
from assetbuild.plan.patience import patience
from assetbuild.plan.recipe_consistency import check_against_robot, check_names, turned_meshes
from assetbuild.plugin_types import Target, lacking
from assetbuild.plugins import load_plugin
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import Recipe
from assetbuild.recipe.validation import KeyedError
from assetbuild.rendering.plan import PICTURE_MODEL, looks
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Tree
from assetbuild.robot.shapes import SourceShapes
from assetbuild.samples.state_ranges import StateRanges
from assetbuild.source.patches import patch_keys
from assetbuild.source.plan import (
    Description,
    Reading,
    SourceFiles,
    description_of,
    open_source,
    read_description,
)


@dataclass
class Outline:
    """What a plan leaves for the report and the bundle: references into the graph.

    skipped: checks that this machine cannot run, and why. looks: pictures and the 3D view.
    subjects: what a node works on, where the node itself does not know. edits: label of an edit's
    node -> its key in the recipe. expanded: the URDF behind a xacro, which its lines count.
    ranges: `dr.yaml`, where the recipe randomizes. fits: one for each entry of `identify`.
    bodies: what the report shows of them.
    composed: the recipe of a composite, which knows the lines of its parts.
    """

    composed: LoadedRecipe | None = None
    source_map: Ref | None = None
    expanded: Ref | None = None
    robot: dict[str, Ref] = field(default_factory=dict)
    targets: dict[str, Node] = field(default_factory=dict)
    checks: dict[str, Node] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)
    licenses: dict[str, Ref] = field(default_factory=dict)
    looks: dict[str, Node] = field(default_factory=dict)
    subjects: dict[str, str] = field(default_factory=dict)
    edits: dict[str, tuple[str | int, ...]] = field(default_factory=dict)
    ranges: Node | None = None
    fits: tuple[Node, ...] = ()
    bodies: Ref | None = None
    tree: Tree | None = None


def plan(loaded: LoadedRecipe, lock: Lock | None, p: Planner, *, drawn: bool = True) -> Outline:
    """Add the graph of one recipe to the planner, as far as the answers reach.

    drawn: with pictures and the 3D view.
    """
    with patience(loaded.path):
        return _planned(loaded, lock, p, drawn)


def _planned(loaded: LoadedRecipe, lock: Lock | None, p: Planner, drawn: bool) -> Outline:
    check_recipes(loaded)
    outline = begun(loaded)
    ready = _prepare(loaded, lock, outline, p)
    if ready is None:
        return outline
    if loaded.parts:
        parts = [
            (part, _prepare_part(loaded, index, outline, p))
            for index, part in enumerate(loaded.parts)
        ]
        composite = compose(loaded, ready, parts, p)
        if composite is None:
            return outline
        loaded, ready = composite
        outline.source_map, outline.composed = ready.source_map, loaded
    with loaded.placing():
        return _finished(loaded.recipe, loaded.folder, ready, outline, drawn, p)


def begun(loaded: LoadedRecipe) -> Outline:
    """An outline that knows only where the recipe asks for each edit and patch."""
    keys = patch_keys(loaded.recipe.source.patches, loaded.folder, loaded.world)
    edits = {label: key for label, _, key in edits_of(loaded.recipe.edits)}
    return Outline(edits=edits | keys)


def check_recipes(*recipes: LoadedRecipe) -> None:
    """Files and cross references inside of recipes and of their parts. RecipeError."""
    wrong = Gather(RecipeError)
    for loaded in recipes:
        for each in (loaded, *loaded.parts):
            with wrong, each.placing():
                check_names(each.recipe, each.folder, each.world)
    wrong.stop()


def _finished(
    recipe: Recipe, folder: Path, ready: Ready, outline: Outline, drawn: bool, p: Planner
) -> Outline:
    """Plan from the edited robot on."""
    read, edited, geometry, sides = ready.read, ready.robot, ready.geometry, ready.sides
    tree = _merge(recipe, ready, p)
    links, shapes = p.ask(edited["links.json"]), p.ask(edited["shapes.json"])
    merged = p.ask(tree["tree.json"])
    if links is None or shapes is None or merged is None:
        return outline
    step = control_step(recipe, sides, ready.poses, ready.common_surfaces)
    outline.tree = decode(Tree, merged)
    check_against_robot(recipe, decode(Tree, links), outline.tree, step)

    if geometry is None:
        return outline
    geometry.shapes = decode(SourceShapes, shapes)
    assembled = assemble(
        recipe, folder, decode(Tree, links), geometry, edited["shapes.json"], sides, p
    )
    lint_meshes(edited["links.json"], edited["shapes.json"], geometry, p)
    outline.subjects = geometry.subjects
    if assembled is None:
        return outline
    samples = recipe.collision.exclude.sampled
    controlled = control(step, read, tree, assembled, samples, p)["control.json"]
    if recipe.identify:
        from assetbuild.identify.plan import identify  # few recipes have logs

        controlled, outline.fits = identify(
            recipe.identify, folder, outline.tree, tree["tree.json"], controlled, p
        )
    outline.robot = _robot(edited["links.json"], tree, assembled, controlled, p)
    pose = p.add("pose", KeepPose(), {"control.json": controlled})["control.json"]
    inputs = {"tree.json": tree["tree.json"], "control.json": pose}
    outline.bodies = p.add("measure_bodies", MeasureBodies(), inputs)["bodies.json"]
    outline.targets = {name: add_target(recipe, name, outline.robot, p) for name in recipe.targets}
    if recipe.randomize is not None:
        ports = {port: outline.robot[port] for port in StateRanges.reads}
        outline.ranges = p.add("state_ranges", StateRanges.configure(recipe), ports)
    if drawn:
        outline.looks = looks(recipe, outline.robot, pose, p)
    _checks(recipe, folder, outline, _sources(recipe, outline, read), p)
    return outline


# --- reading and merging --------------------------------------------------------------------


def _prepare(loaded: LoadedRecipe, lock: Lock | None, outline: Outline, p: Planner) -> Ready | None:
    """One robot, read and edited; None while an answer is missing."""
    recipe, folder = loaded.recipe, loaded.folder
    with loaded.placing():
        source = open_source(recipe.source, folder, lock, p)
        description = description_of(recipe.source, folder, loaded.where, source, p)
        outline.licenses = source.licenses()
        if description is None:
            return None
        read = read_description(recipe, source, description, p)
        if read is None:
            return None
        bounds = recipe.validate_.inertia
        p.add("lint_links", LintLinks(bounds=bounds), dict(read.robot))
        outline.source_map = read.source_map
        outline.expanded = description.ref if recipe.source.xacro else None
        geometry = _geometry(recipe.source.honour_up_axis, source, description, read, p)
        if geometry is not None:
            outline.subjects = geometry.subjects
            lint_density(read.robot, geometry, p)
        edited = apply_edits(recipe.edits, read.robot, geometry, p)
        if edited is None:
            return None
        if recipe.edits:  # what the edits answered, and what they left or made
            lint = LintLinks(bounds=bounds, guessed=guessed_links(recipe.edits))
            p.add(f"lint_links{AGAIN}", lint, edited)
        return Ready(read, edited, geometry, read.source_map, (own_side(recipe),))


def _prepare_part(whole: LoadedRecipe, index: int, outline: Outline, p: Planner) -> Ready | None:
    """A part of a composite; its licences come with it."""
    part, prefix = whole.parts[index], whole.recipe.compose[index].as_
    part_outline = Outline()
    ready = _prepare(part, part_lock(part), part_outline, p.scoped(f"{prefix} "))
    outline.licenses |= {f"{prefix}/{path}": ref for path, ref in part_outline.licenses.items()}
    return ready


def part_lock(part: LoadedRecipe) -> Lock | None:
    """The pin of a part's source, which lies beside its own recipe."""
    return read_lock(lock_path(part.path), part.world) if part.recipe.source.moving else None


def _geometry(
    turned: Sequence[str],
    source: SourceFiles,
    description: Description,
    read: Reading,
    p: Planner,
) -> Geometry | None:
    """The source's meshes; None while it is not known which there are.

    turned: patterns of those whose up axis is honoured.
    """
    meshes, shapes = p.ask(read.meshes), p.ask(read.robot["shapes.json"])
    if meshes is None or shapes is None:
        return None
    drawn = decode(SourceShapes, shapes)
    files = read.files
    if files is None:
        files = source.meshes(json.loads(meshes), description.path)
    textures = source.present("own textures", {m.texture for m in drawn.materials if m.texture})
    if files is None or textures is None:
        return None
    upright = turned_meshes(turned, files)
    # MuJoCo takes no material from a mesh file, so an MJCF says all about its looks itself.
    named = {} if read.urdf is None else companions(files, source, p)
    if named is None:
        return None
    return Geometry(drawn, files, named, textures, upright, p)


def _merge(recipe: Recipe, ready: Ready, p: Planner) -> Node:
    fixed, edited = recipe.fixed_joints, ready.robot
    inputs = {"links.json": edited["links.json"]}
    keeps = any(side.keeps for side in ready.sides)
    if ready.read.control is not None and keeps:
        inputs["source_control.json"] = ready.read.control
    step = MergeFixedJoints(
        merge=fixed.merge,
        keep_bodies=fixed.keep_bodies,
        keep_source=keeps,
        keep_root=ready.sides[0].from_mjcf,
    )
    tree = p.add("merge_fixed_joints", step, inputs)
    linted = {"tree.json": tree["tree.json"], "shapes.json": edited["shapes.json"]}
    linted["source_links.json"] = ready.read.robot["links.json"]
    p.add("lint_bodies", LintBodies(bounds=recipe.validate_.inertia), linted)
    return tree


# --- control, targets, checks ---------------------------------------------------------------


def _robot(links: Ref, tree: Node, assembled: Node, control: Ref, p: Planner) -> dict[str, Ref]:
    """The finished robot: what targets and checks read, by port."""
    ports = {"control.json": control, "tree.json": tree["tree.json"]}
    ratings = p.add("ratings", KeepRatings(), ports)
    shapes = {port: assembled[port] for port in Assemble.outputs}
    measured = p.add("measure_assets", MeasureAssets(), shapes)
    return shapes | {
        "links.json": links,
        "tree.json": tree["tree.json"],
        "control.json": control,
        "ratings.json": ratings["ratings.json"],
        **{port: measured[port] for port in MeasureAssets.outputs},
    }


def add_target(
    recipe: Recipe, name: str, robot: Mapping[str, Ref], p: Planner, label: str = ""
) -> Node:
    """The node of a target that writes the robot. label: the target's name by default."""
    target = load_plugin(Target, name)
    ports = {port: robot[port] for port in target.reads}
    if (before := target.preparation) is not None:
        read = {port: robot[port] for port in before.reads}
        made = p.add(before.step_name(), before(), read)
        ports |= {output: made[output] for output in before.outputs}
    return p.add(label or name, target.configure(recipe), ports)


def _sources(recipe: Recipe, outline: Outline, read: Reading) -> dict[str, dict[str, Ref]]:
    """What checks compare the robot with, by the need that asks for it.

    "source": the URDF that it must equal: the source's; after edits and from an MJCF, the one
    that we wrote. "source_mjcf": the MJCF that it came from, unless edits changed it.
    """
    sources: dict[str, dict[str, Ref]] = {}
    written = outline.targets.get("urdf")
    if read.urdf is not None and not recipe.edits and not recipe.compose:
        sources["source"] = {"source.urdf": read.urdf}
    elif written is not None:
        sources["source"] = {"source.urdf": written["urdf/"] / f"{recipe.robot}.urdf"}
    if read.mjcf and not recipe.edits and not recipe.compose:
        sources["source_mjcf"] = dict(read.mjcf)
    return sources


def _checks(
    recipe: Recipe,
    folder: Path,
    outline: Outline,
    sources: Mapping[str, Mapping[str, Ref]],
    p: Planner,
) -> None:
    """Every check whose needs are built; those that this machine cannot run are named."""
    possible = {*outline.targets, *sources, "source"}
    possible |= {"source_mjcf"} if recipe.source.mjcf else set()
    # A reader of facts is the check of its format.
    equal = ((f"{name}_equal", reader) for name, reader in readers_of(recipe))
    for name, check in (*sorted(checks_of(recipe)), *equal):
        if not set(check.needs) <= possible:
            continue
        step = check.configure(recipe)
        if step is None:
            continue
        if lack := lacking(check.requires, p.world) or step.missing(p.world):
            outline.skipped[name] = lack
            continue
        without = [n for n in check.needs if n not in outline.targets and n not in sources]
        if without:
            mounted = without[0] == "source_mjcf" and recipe.compose
            outline.skipped[name] = _WITHOUT["parts" if mounted else without[0]]
            continue
        inputs = {port: outline.robot[port] for port in check.reads}
        for need in (*check.needs, *(t for t in check.also if t in outline.targets)):
            built = outline.targets.get(need)
            if need == "mjcf" and not check.drives:
                built = outline.looks.get(PICTURE_MODEL, built)
            inputs |= {f"{need}/": built[f"{need}/"]} if built else sources[need]
        for port, (key, path) in step.own_files().items():
            if not p.world.is_file(folder / path):
                raise KeyedError(
                    key, f"`{path}`: there is no such file", "paths begin at the recipe"
                )
            inputs[port] = p.source(folder / path)
        outline.checks[name] = p.add(f"check {name}", step, inputs)


_WITHOUT = {
    "source": "there is no URDF to compare with: add `urdf` to the targets",
    "parts": "parts are mounted on it: the robot is not its source alone",
    "source_mjcf": "the edits changed the robot: it is not the source's any more",
}
