"""`assetbuild validate`: checks on a bundle, or on any MJCF, URDF or USD file."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from assetbuild.cli.progress import progress
from assetbuild.cli.summary import finding_text
from assetbuild.pipeline.opening import remote_cache
from assetbuild.pipeline.validating import Wish, validate


def run(arguments: argparse.Namespace) -> int:
    """Print each finding; 1 when one is an error, else 0."""

    def recipe_for(robot: Path, out: Path) -> None:
        from assetbuild.init import propose, write  # not for a file that is only read

        write(propose(robot, out, dict(arguments.package)), force=True)

    with progress(arguments.path.stem) as shown:
        remote = remote_cache(arguments.remote, shown.say, write=arguments.cache_write)
        wish = Wish(not arguments.static, recipe_for, shown.on_event, remote)
        results = validate(arguments.path, wish)
    code = int(any(f.severity == "error" for one in results for f in one.findings))
    if arguments.json:
        rows = [
            {"file": one.file, "kind": one.kind, "findings": [f.to_json() for f in one.findings]}
            for one in results
        ]
        print(json.dumps(rows, indent=1, sort_keys=True))
        return code
    for one in results:
        for finding in one.findings:
            print(finding_text(finding if finding.where else finding.at(one.file)))
        severities = [finding.severity for finding in one.findings]
        numbers = [(word, severities.count(word)) for word in ("error", "warning")]
        counts = ", ".join(f"{n} {word}{'' if n == 1 else 's'}" for word, n in numbers)
        print(f"{one.file}: {one.kind}, {counts}")
    return code
