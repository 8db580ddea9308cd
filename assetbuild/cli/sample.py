"""`assetbuild sample`: robots that could exist."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from assetbuild.cli.progress import at_work
from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner, Settled
from assetbuild.errors import RecipeError
from assetbuild.pipeline.bundling import publish_bundle
from assetbuild.pipeline.opening import Opened
from assetbuild.pipeline.publish import check_replaceable
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.plan import add_target
from assetbuild.report.bundle import BundleFile, json_text, manifest
from assetbuild.report.tables import table, text_table
from assetbuild.samples.draw_samples import ApplySample, DrawSamples


def run(arguments: argparse.Namespace) -> int:
    """Write the samples; prints the table of the draws."""
    loaded = load_recipe(arguments.recipe, arguments.variant)
    robot = loaded.recipe.robot
    out = arguments.out or Path("build") / f"{robot}-samples"
    check_replaceable(out)
    with at_work(loaded, arguments) as (work, _):
        wanted = (arguments.count, arguments.judge, arguments.seed)
        done = work.made(lambda p: plan_samples(work, *wanted, p))
        files = list(_files(robot, work, done))
        publish_bundle([*files, manifest(robot, files)], out, work.session)
    statistics = next(file for file in files if file.path == "statistics.json")
    _print_table(json.loads(statistics.content or b""))
    print(f"{arguments.count} robots in {out}")
    return 0


def _print_table(statistics: dict[str, Any]) -> None:  # Any: JSON
    rows = [
        (row["body"], row["mass_kg"]["least"], row["mass_kg"]["most"], row["inconsistent"])
        for row in statistics["bodies"]
    ]
    head = ("body", "least mass, kg", "most", "bad")
    print(text_table(table(f"{statistics['draws']:,} draws", head, rows)))


Samples = tuple[Node, list[Node]] | None
"""The draws, and the MJCF of each sample in order."""


def _files(robot: str, work: Opened, done: Settled[Samples]) -> Iterator[BundleFile]:
    assert done.outline is not None  # noqa: S101 # a plan without questions is whole
    draws, variants = done.outline
    drawn, figures = (work.read(done, draws[name]) for name in ("samples.json", "statistics.json"))
    yield BundleFile.of_bytes("samples.json", "samples", drawn)
    yield BundleFile.of_text("statistics.json", "report", json_text(json.loads(figures)))
    for index, node in enumerate(variants):
        tree = work.session.tree(done.results[node.label]["mjcf/"])
        yield BundleFile(f"{robot}_{index:03}.xml", "mjcf", *tree[f"{robot}.xml"])
        if index == 0:  # a draw changes no mesh
            for path, held in sorted(tree.items()):
                if path.startswith("assets/"):
                    yield BundleFile(path, "mjcf", *held)


def plan_samples(work: Opened, keep: int, judge: int, seed: int | None, p: Planner) -> Samples:
    """The robot, the draws, one MJCF for each. RecipeError without `randomize`.

    keep: MJCF files; judge: draws for the statistics; seed: None = the recipe's.
    """
    outline = work.robot(p)
    robot, loaded = outline.robot, outline.composed or work.loaded
    randomize = loaded.recipe.randomize
    if randomize is None and (robot or not work.loaded.parts):
        raise RecipeError(
            "the recipe has no `randomize`: nothing says what may vary",
            where=work.loaded.where(()),
            hint="add for instance `randomize: {links: {'.*': {density: [0.8, 1.2], com: 0.01}}}`",
        )
    if randomize is None or not robot:
        return None
    if seed is not None:
        randomize = randomize.model_copy(update={"seed": seed})
    step = DrawSamples(randomize=randomize, keep=keep, judge=judge)
    draws = p.add("draw_samples", step, {"tree.json": robot["tree.json"]})
    return draws, [_variant(work, index, draws, robot, p) for index in range(keep)]


def _variant(work: Opened, index: int, draws: Node, robot: dict[str, Ref], p: Planner) -> Node:
    drawn = {port: robot[port] for port in ("tree.json", "control.json")}
    inputs = drawn | {"samples.json": draws["samples.json"]}
    changed = p.add(f"apply_sample {index:03}", ApplySample(index=index), inputs)
    ports = robot | {port: changed[port] for port in drawn}
    return add_target(work.loaded.recipe, "mjcf", ports, p, label=f"mjcf {index:03}")
