"""check(): what can be said about a recipe without a heavy step."""

from __future__ import annotations

from pathlib import Path

from assetbuild.engine.execute import NodeResult, execute
from assetbuild.engine.graph import Graph, Node, Planner
from assetbuild.engine.session import Resolver, Session
from assetbuild.findings import Finding
from assetbuild.kinds import Edit
from assetbuild.pipeline.judging import findings_of, located, locator, where_of
from assetbuild.pipeline.opening import open_session, pin
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.plan import plan
from assetbuild.plan.agree import check_names
from assetbuild.report.document import make_report
from assetbuild.source.get.from_archive import MESHES

LIGHT_STEPS = frozenset(
    {
        "compose_parts",
        "list_archive",
        "unpack",
        "expand_xacro",
        "flatten_mjcf",
        "read_urdf",
        "lint_links",
        "merge_fixed_joints",
        "lint_bodies",
    }
)
"""Steps that `check` may run: no simulator, no mesh, no network."""


def check(recipe: Path) -> list[Finding]:
    """What can be said without a heavy step: schema, lock, names, paths and static lints.

    Reads the description only where it needs no download: it lies in a folder, or in the store.
    Raises AssetBuildError; a lock that is out of date is an OutOfDateError.
    """
    loaded = load_recipe(recipe)
    for variant in loaded.recipe.variants:
        check_names(load_recipe(recipe, variant))
    check_names(loaded)
    lock = pin(loaded, frozen=True, say=lambda _: None)
    with open_session(loaded) as session:
        results: dict[str, NodeResult] = {}
        while True:
            planner = Planner(session)
            outline = plan(loaded, lock, planner)
            light = _light(planner.graph(), session)
            known = len(results)
            results |= execute(light, session)
            failed = [
                located(result.error, "", where_of(loaded, outline, label))
                for label, result in results.items()
                if result.error
            ]
            if failed:
                raise failed[0]
            if not planner.questions or len(results) == known:
                break
        findings = findings_of(loaded, outline, results)
        locate = locator(loaded, outline, results, session)
    return list(make_report("", findings, {}, loaded.recipe.rules, locate).findings)


def _light(graph: Graph, session: Session) -> Graph:
    """The part of a graph that `check` may run: light steps, and what the store has already."""
    resolver = Resolver(graph.nodes, session)
    kept: dict[str, Node] = {}
    for label, node in graph.nodes.items():  # each after the nodes it reads
        light = node.step.step_name() in LIGHT_STEPS or isinstance(node.step, Edit)
        may_run = light and label != MESHES
        if all(maker in kept for maker in graph.predecessors(label)) and (
            may_run or resolver.made(label) is not None
        ):
            kept[label] = node
    return Graph(kept, graph.sources)
