"""`assetbuild sample`: robots that could exist."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from assetbuild.cli.progress import progress
from assetbuild.cli.summary import print_findings
from assetbuild.engine.execute import Listener
from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner, Settled
from assetbuild.errors import RecipeError
from assetbuild.findings import Finding
from assetbuild.kinds import Target
from assetbuild.pipeline.bundling import publish_bundle
from assetbuild.pipeline.opening import Opened, Task, at_work
from assetbuild.pipeline.publish import check_replaceable
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.plugins import load_plugin
from assetbuild.report.bundle import BundleFile, json_text, manifest
from assetbuild.robot.ranges import Randomize
from assetbuild.samples.apply_sample import ApplySample
from assetbuild.samples.draw_samples import DrawSamples
from assetbuild.samples.enclose import Enclose


def run(arguments: argparse.Namespace) -> int:
    """Write the samples; prints the table of the draws."""
    wanted = Draws(arguments.count, arguments.judge, arguments.seed)
    with progress(arguments.recipe.name) as shown:
        sampled = sample(Task.of(vars(arguments)), wanted, shown.on_event, shown.say)
    print_findings(sampled.findings)
    _print_table(sampled)
    print(f"{arguments.count} robots in {sampled.out}")
    return 0


def _print_table(sampled: Sampled) -> None:
    rows = sampled.statistics["bodies"]
    if not rows:
        return
    noises = sorted(rows[0]["independent_noise_inconsistent"])
    wide = max(len(name) for name in ("body", *(row["body"] for row in rows)))
    head = [f"±{float(noise):.0%}" for noise in noises]
    print(f"{sampled.statistics['draws']:,} draws; right: inconsistent with independent noise of")
    print(
        f"{'body':{wide}} {'mass, kg':>19} {'kept':>6} {'bad':>4} "
        + " ".join(map("{:>6}".format, head))
    )
    for row in rows:
        mass, shares = row["mass_kg"], row["independent_noise_inconsistent"]
        spread = f"{mass['least']:.4g}..{mass['most']:.4g}"
        noisy = " ".join(f"{shares[noise]:6.1%}" for noise in noises)
        print(
            f"{row['body']:{wide}} {spread:>19} {row['acceptance']:6.1%} "
            f"{row['inconsistent']:4d} {noisy}"
        )


@dataclass(frozen=True)
class Draws:
    """How often to draw. keep: MJCF files; judge: draws for the statistics; seed: else its own."""

    keep: int = 16
    judge: int = 10_000
    seed: int | None = None


@dataclass(frozen=True)
class Sampled:
    """What came of it. statistics: as `draw_samples` wrote them."""

    out: Path
    statistics: dict[str, Any]  # Any: JSON
    findings: tuple[Finding, ...]


@dataclass
class SamplesOutline:
    """The draws, and the MJCF of each sample in order."""

    draws: Node | None = None
    variants: list[Node] = field(default_factory=list)


def sample(task: Task, wanted: Draws, on_event: Listener, say: Callable[[str], None]) -> Sampled:
    """Draw and write. Raises AssetBuildError."""
    loaded = load_recipe(task.recipe, task.variant)
    robot = loaded.recipe.robot
    out = task.out or Path("build") / f"{robot}-samples"
    check_replaceable(out)
    with at_work(loaded, task, on_event, say) as work:
        done = work.made(lambda p: plan_samples(work, wanted, p))
        files = list(_files(robot, work, done))
        publish_bundle([*files, manifest(robot, files)], out, work.session)
    statistics = next(file for file in files if file.path == "statistics.json")
    labels = ("enclose", "draw_samples")
    findings = tuple(finding for label in labels for finding in done.results[label].findings)
    return Sampled(out, json.loads(statistics.content or b""), findings)


def _files(robot: str, work: Opened, done: Settled[SamplesOutline]) -> Iterator[BundleFile]:
    outline = done.outline
    assert outline.draws is not None  # noqa: S101 # a plan without questions is whole
    drawn, figures = (
        work.read(done, outline.draws[name]) for name in ("samples.json", "statistics.json")
    )
    yield BundleFile.of_bytes("samples.json", "samples", drawn)
    yield BundleFile.of_text("statistics.json", "report", json_text(json.loads(figures)))
    for index, node in enumerate(outline.variants):
        tree = work.session.tree(done.results[node.label]["mjcf/"])
        yield BundleFile(f"{robot}_{index:03}.xml", "mjcf", *tree[f"{robot}.xml"])
        if index == 0:  # a draw changes no mesh
            for path, held in sorted(tree.items()):
                if path.startswith("assets/"):
                    yield BundleFile(path, "mjcf", *held)


def plan_samples(work: Opened, wanted: Draws, p: Planner) -> SamplesOutline:
    """The robot, its rooms, the draws, one MJCF for each. RecipeError without `randomize`."""
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
        return SamplesOutline()
    draws = _draws(randomize, wanted, robot, p)
    variants = [_variant(work, index, draws, robot, p) for index in range(wanted.keep)]
    return SamplesOutline(draws, variants)


def _draws(randomize: Randomize, wanted: Draws, robot: dict[str, Ref], p: Planner) -> Node:
    if wanted.seed is not None:
        randomize = randomize.model_copy(update={"seed": wanted.seed})
    ports = ("tree.json", "shapes.json", "hulls.npz")
    rooms = p.add("enclose", Enclose(), {port: robot[port] for port in ports})
    step = DrawSamples(randomize=randomize, keep=wanted.keep, judge=wanted.judge)
    inputs = {"tree.json": robot["tree.json"], "rooms.json": rooms["rooms.json"]}
    return p.add("draw_samples", step, inputs)


def _variant(work: Opened, index: int, draws: Node, robot: dict[str, Ref], p: Planner) -> Node:
    drawn = {port: robot[port] for port in ("tree.json", "control.json")}
    inputs = drawn | {"samples.json": draws["samples.json"]}
    changed = p.add(f"apply_sample {index:03}", ApplySample(index=index), inputs)
    target = load_plugin(Target, "mjcf")
    ports = robot | {port: changed[port] for port in drawn}
    inputs = {port: ports[port] for port in target.reads}
    return p.add(f"mjcf {index:03}", target.configure(work.loaded.recipe), inputs)
