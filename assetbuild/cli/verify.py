"""`assetbuild verify`: every file of a bundle against its manifest and its provenance."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from assetbuild.engine.digest import digest_file, regular_bytes
from assetbuild.pipeline.publish import OWN_FILES
from assetbuild.report.bundle import PREDICATE, STATEMENT, differing_files, manifest_of


def run(arguments: argparse.Namespace) -> int:
    """Print each difference; 0 when there is none, else 1."""
    bundle: Path = arguments.bundle
    wanted = manifest_of(bundle)
    differing = differing_files(bundle, wanted, bytecode=True)
    wrong = [f"{what}: {path}" for what, path in differing if path not in OWN_FILES]
    wrong += _against_provenance(bundle, wanted)
    for line in wrong:
        print(line)
    differences = f"{len(wrong)} difference{'s' * (len(wrong) != 1)}"
    print(f"{bundle}: {len(wanted)} files, {differences} (manifest, provenance)")
    return 1 if wrong else 0


def _against_provenance(bundle: Path, manifest: Mapping[str, str]) -> Iterator[str]:
    """Is the provenance a statement about these very files?"""
    try:
        statement = json.loads(regular_bytes(bundle / "provenance.json"))
        kinds = (statement["_type"], statement["predicateType"])
        rows = {str(row["name"]): str(row["digest"]["sha256"]) for row in statement["subject"]}
        str(statement["predicate"]["buildDefinition"]["externalParameters"]["recipe_sha256"])
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
