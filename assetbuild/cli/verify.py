"""`assetbuild verify`: every file of a bundle against its manifest."""

from __future__ import annotations

import argparse
import hashlib
import json
from pathlib import Path

from assetbuild.errors import UsageError

HELP = "compare every file of a bundle with its manifest"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bundle", type=Path, help="a folder that `assetbuild build` wrote")


def run(arguments: argparse.Namespace) -> int:
    """Print each difference; 0 when there is none, else 1."""
    bundle: Path = arguments.bundle
    wanted = _manifest(bundle)
    found = {
        path.relative_to(bundle).as_posix() for path in bundle.rglob("*") if not path.is_dir()
    } - {"manifest.json", "provenance.json"}
    wrong = [f"missing: {path}" for path in sorted(wanted.keys() - found)]
    wrong += [f"not in the manifest: {path}" for path in sorted(found - wanted.keys())]
    for path in sorted(wanted.keys() & found):
        if hashlib.sha256((bundle / path).read_bytes()).hexdigest() != wanted[path]:
            wrong.append(f"changed: {path}")
    for line in wrong:
        print(line)
    print(f"{bundle}: {len(wanted)} files, {len(wrong)} differences")
    return 1 if wrong else 0


def _manifest(bundle: Path) -> dict[str, str]:
    try:
        manifest = json.loads((bundle / "manifest.json").read_bytes())
        return {str(row["path"]): str(row["sha256"]) for row in manifest["files"]}
    except FileNotFoundError:
        raise UsageError(f"`{bundle}` has no manifest.json, so it is no bundle") from None
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{bundle / 'manifest.json'}: not a manifest: {error}") from None
