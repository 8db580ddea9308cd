"""The graph of `assetbuild sample`: the robot, its rooms, the draws, one MJCF for each."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner
from assetbuild.errors import RecipeError
from assetbuild.kinds import Target
from assetbuild.lock import Lock
from assetbuild.plan import Outline, plan
from assetbuild.plugins import load_plugin
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.samples.apply_sample import ApplySample
from assetbuild.samples.draw_samples import DrawSamples
from assetbuild.samples.enclose import Enclose


@dataclass
class SamplesOutline:
    """The robot's own outline, the draws, and the MJCF of each sample in order."""

    robot: Outline
    draws: Node | None = None
    variants: list[Node] = field(default_factory=list)


def plan_samples(
    loaded: LoadedRecipe, lock: Lock | None, p: Planner, *, keep: int, judge: int, seed: int | None
) -> SamplesOutline:
    """Add the graph as far as the answers reach. Raises RecipeError without `randomize`."""
    bare = replace(loaded, recipe=loaded.recipe.model_copy(update={"targets": ()}))
    outline = SamplesOutline(plan(bare, lock, p))
    robot, whole = outline.robot.robot, outline.robot.composed or loaded
    randomize = whole.recipe.randomize
    if randomize is None and (robot or not loaded.parts):
        raise RecipeError(
            "the recipe has no `randomize`: nothing says what may vary",
            where=loaded.where(()),
            hint="add for instance `randomize: {links: {'.*': {density: [0.8, 1.2], com: 0.01}}}`",
        )
    if randomize is None or not robot:
        return outline
    if seed is not None:
        randomize = randomize.model_copy(update={"seed": seed})

    step = DrawSamples(randomize=randomize, keep=keep, judge=judge)
    ports = ("tree.json", "shapes.json", "hulls.npz")
    rooms = p.add("enclose", Enclose(), {port: robot[port] for port in ports})
    inputs = {"tree.json": robot["tree.json"], "rooms.json": rooms["rooms.json"]}
    outline.draws = p.add("draw_samples", step, inputs)
    outline.variants = [_variant(loaded, index, outline.draws, robot, p) for index in range(keep)]
    return outline


def _variant(
    loaded: LoadedRecipe, index: int, draws: Node, robot: dict[str, Ref], p: Planner
) -> Node:
    changed = p.add(
        f"apply_sample {index:03}",
        ApplySample(index=index),
        {
            "tree.json": robot["tree.json"],
            "control.json": robot["control.json"],
            "samples.json": draws["samples.json"],
        },
    )
    target = load_plugin(Target, "mjcf")
    ports = {**robot, **{name: changed[name] for name in ("tree.json", "control.json")}}
    return p.add(
        f"mjcf {index:03}",
        target.configure(loaded.recipe),
        {port: ports[port] for port in target.reads},
    )
