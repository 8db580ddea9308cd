"""`assetbuild verify`: every file of a bundle against manifest, provenance, and recipe."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from assetbuild.engine.digest import digest_file
from assetbuild.errors import OutOfDateError
from assetbuild.pipeline.bundling import bundle_files
from assetbuild.pipeline.judging import judged
from assetbuild.pipeline.opening import opened
from assetbuild.pipeline.publish import OWN_FILES
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.report.bundle import manifest_of


def run(arguments: argparse.Namespace) -> int:
    """Print each difference; 0 when there is none, 1, or 3 when the store cannot tell."""
    bundle: Path = arguments.bundle
    wanted = manifest_of(bundle)
    wrong = [*against_manifest(bundle, wanted), *against_provenance(bundle, wanted)]
    compared = "manifest, provenance"
    if arguments.recipe is not None and not wrong:
        compared += f", {arguments.recipe}"
        wrong += against_recipe(bundle, arguments.recipe, arguments.variant)
    for line in wrong:
        print(line)
    print(f"{bundle}: {len(wanted)} files, {len(wrong)} differences ({compared})")
    return 1 if wrong else 0


STATEMENT, PREDICATE = "https://in-toto.io/Statement/v1", "https://slsa.dev/provenance/v1"


def against_manifest(bundle: Path, wanted: Mapping[str, str]) -> Iterator[str]:
    """Each file that is missing, added or changed."""
    found = {
        p.relative_to(bundle).as_posix()
        for p in bundle.rglob("*")
        if p.is_symlink() or not p.is_dir()
    }
    for path in sorted(wanted.keys() - found):
        yield f"missing: {path}"
    for path in sorted(found - wanted.keys() - set(OWN_FILES)):
        yield f"not in the manifest: {path}"
    for path in sorted(wanted.keys() & found):
        if not (bundle / path).is_file() or (bundle / path).is_symlink():
            yield f"not a regular file: {path}"
        elif digest_file(bundle / path) != wanted[path]:
            yield f"changed: {path}"


def against_provenance(bundle: Path, manifest: Mapping[str, str]) -> Iterator[str]:
    """Is the provenance a statement about these very files?"""
    try:
        statement = json.loads((bundle / "provenance.json").read_bytes())
        kinds = (statement["_type"], statement["predicateType"])
        rows = {str(row["name"]): str(row["digest"]["sha256"]) for row in statement["subject"]}
        recipe_of(statement)
    except FileNotFoundError:
        yield "missing: provenance.json"
        return
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OSError):
        yield "not a provenance: provenance.json"
        return
    if kinds != (STATEMENT, PREDICATE):
        yield f"not an in-toto statement with SLSA's predicate: {', '.join(map(str, kinds))}"
    wanted = {**manifest, "manifest.json": digest_file(bundle / "manifest.json")}
    for path in sorted(wanted.keys() | rows.keys()):
        if rows.get(path) != wanted.get(path):
            yield f"not as the provenance says: {path}"


def recipe_of(statement: Mapping[str, Any]) -> str:  # Any: JSON
    """SHA-256 of the recipe that a provenance names."""
    parameters = statement["predicate"]["buildDefinition"]["externalParameters"]
    return str(parameters["recipe_sha256"])


def against_recipe(bundle: Path, recipe: Path, variant: str | None) -> Iterator[str]:
    """Each file that a build of the recipe would make otherwise; nothing is built.

    OutOfDateError when the store does not hold all results: then nobody can say.
    """
    with opened(load_recipe(recipe, variant)) as look:
        done = look.stored()
        if not done.whole or done.results.keys() != done.graph.nodes.keys():
            raise OutOfDateError(
                f"the store does not hold what {recipe} makes now",
                hint="run `assetbuild build` first, or `assetbuild cache pull`",
            )
        report = judged(look.loaded, done, look.session)
        files = bundle_files(look.loaded, look.lock, done, report, look.session)
        made = {file.path: file.sha256 for file in files if file.path != "provenance.json"}
        wanted = look.session.world.digest(look.loaded.path)
    statement = json.loads((bundle / "provenance.json").read_bytes())
    if recipe_of(statement) != wanted:
        yield f"built from another text of the recipe: {recipe.name}"
    for path, digest in sorted(made.items()):
        there = bundle / path
        if not there.is_file():
            yield f"the recipe makes it, the bundle lacks it: {path}"
        elif digest_file(there) != digest:
            yield f"the recipe makes other bytes: {path}"
    for path in sorted(manifest_of(bundle).keys() - made.keys()):
        yield f"the recipe does not make it: {path}"
