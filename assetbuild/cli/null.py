"""The null build's record: written after a build, read before anything else is imported.

The record of a command is found by its words and working folder, so that nothing has to be
parsed to find it: the very same command, run again, is answered by `stat` alone.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path

from assetbuild.engine import null
from assetbuild.engine.digest import digest_file
from assetbuild.engine.folders import cache_root
from assetbuild.engine.world import World
from assetbuild.pipeline.bundling import manifest_of
from assetbuild.pipeline.publish import OWN_FILES


def remember(
    argv: Sequence[str], bundles: Sequence[Path], world: World, summary: str, began_ns: int
) -> None:
    """Record finished builds; a store that cannot be written to costs only speed.

    world: all that they asked. began_ns: before the first question.
    """
    made: dict[str, str] = {}
    for bundle in bundles:
        made |= _bundle_files(bundle)
    options = options_of(argv)
    with contextlib.suppress(OSError):
        null.write(
            null.record_file(cache_root(), options),
            options=options,
            asked=world.record,
            made=made,
            folders=[str(bundle) for bundle in bundles],
            exit_code=0,
            summary=summary,
            began_ns=began_ns,
        )


def _bundle_files(bundle: Path) -> dict[str, str]:
    """Path -> sha256 of every file of the bundle."""
    own = {name: digest_file(bundle / name) for name in OWN_FILES}
    return {str(bundle / name): digest for name, digest in (manifest_of(bundle) | own).items()}


def options_of(argv: Sequence[str]) -> str:
    """What tells one command from another."""
    return "\n".join((os.getcwd(), *argv))  # noqa: PTH109 # as `__main__` does
