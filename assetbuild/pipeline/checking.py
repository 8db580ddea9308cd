"""check(): what can be said about a recipe without a heavy step."""

from __future__ import annotations

import functools
from pathlib import Path

from assetbuild.engine.graph import Node
from assetbuild.engine.planner import settle
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
        "patch_text",
        "expand_xacro",
        "flatten_mjcf",
        "list_includes",
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
    check_names(loaded, *(load_recipe(recipe, variant) for variant in loaded.recipe.variants))
    lock = pin(loaded, frozen=True, say=lambda _: None)
    with open_session(loaded) as session:
        done = settle(functools.partial(plan, loaded, lock), session, may_run=_is_light)
        for label, result in done.results.items():
            if result.error:
                raise located(result.error, "", where_of(loaded, done.outline, label))
        findings = findings_of(loaded, done.outline, done.results)
        locate = locator(loaded, done.outline, done.results, session)
    return list(make_report("", findings, {}, loaded.recipe.rules, locate).findings)


def _is_light(node: Node) -> bool:
    light = node.step.step_name() in LIGHT_STEPS or isinstance(node.step, Edit)
    return light and node.label != MESHES
