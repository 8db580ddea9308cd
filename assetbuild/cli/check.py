"""`assetbuild check`: what can be said without a heavy step; and `lock`: moving sources pinned."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from assetbuild.cli import print_error
from assetbuild.cli.parser import recipes_of
from assetbuild.cli.summary import every_finding_line
from assetbuild.engine.graph import Node
from assetbuild.engine.planner import settle
from assetbuild.errors import AssetBuildError, UsageError
from assetbuild.findings import Finding
from assetbuild.lock import Pin, lock_path
from assetbuild.pipeline.judging import failures, findings_of, locator
from assetbuild.pipeline.opening import moving_sources, opened, write_pin
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.plan import check_recipes
from assetbuild.plugin_types import Edit
from assetbuild.recipe.loader import shown_path
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
        for error in failures(loaded, done, look.session):
            raise error
        findings = findings_of(loaded, done)
        locate = locator(loaded, done, look.session)
    return list(make_report("", findings, {}, loaded.recipe.rules, locate).findings)


def _is_light(node: Node) -> bool:
    light = node.step.step_name() in LIGHT_STEPS or isinstance(node.step, Edit)
    return light and node.label != MESHES


def run(arguments: argparse.Namespace) -> int:
    """Check each recipe; the worst exit code of all."""
    recipes = arguments.recipes or recipes_of(sorted(Path("recipes").glob("*.yaml")))
    if not recipes:
        raise UsageError("no recipe given, and there is none in `recipes/`")
    codes = [0]
    for recipe in recipes:
        try:
            findings = check(recipe)
        except AssetBuildError as error:
            print_error(error)
            codes.append(error.exit_code)
            continue
        errors = [finding for finding in findings if finding.severity == "error"]
        for line in every_finding_line([one for one in findings if one.severity != "info"]):
            print(line)
        codes.append(1 if errors else 0)
        if not errors:
            print(f"{recipe}: ok")
    return max(codes)


def lock(arguments: argparse.Namespace) -> int:
    """Write the locks; prints each lock file."""
    for recipe in arguments.recipes:
        loaded = load_recipe(recipe)
        variants = [load_recipe(recipe, name) for name in loaded.recipe.variants]
        if not moving_sources(loaded, *variants):
            kind = "a folder" if loaded.recipe.source.path else "pinned in the recipe"
            print(f"{loaded.file}: the source is {kind}; there is nothing to pin")
            continue
        written = write_pin(loaded, lambda text: print(text, file=sys.stderr), variants)
        for pin in written.pins:
            what = pin.file if isinstance(pin, Pin) else pin.commit
            print(f"{shown_path(lock_path(loaded.path))}: {what}, {pin.size / 1e6:.1f} MB")
    return 0
