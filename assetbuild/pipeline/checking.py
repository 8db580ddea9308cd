"""check(): what can be said about a recipe without a heavy step."""

from __future__ import annotations

from pathlib import Path

from assetbuild.engine.graph import Node
from assetbuild.engine.planner import settle
from assetbuild.findings import Finding
from assetbuild.kinds import Edit
from assetbuild.pipeline.judging import failures, findings_of, locator
from assetbuild.pipeline.opening import opened
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.plan import check_recipes
from assetbuild.report.document import make_report
from assetbuild.source.get.files import MESHES

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
    check_recipes(loaded, *(load_recipe(recipe, variant) for variant in loaded.recipe.variants))
    with opened(loaded) as look:
        done = settle(look.plan, look.session, may_run=_is_light)
        for error in failures(loaded, done):
            raise error
        findings = findings_of(loaded, done)
        locate = locator(loaded, done, look.session)
    return list(make_report("", findings, {}, loaded.recipe.rules, locate).findings)


def _is_light(node: Node) -> bool:
    light = node.step.step_name() in LIGHT_STEPS or isinstance(node.step, Edit)
    return light and node.label != MESHES
