"""Runs the steps of `steps.json` on the robot below `in/`, each into a folder below `out/`.

A process of its own, whose environment chooses the kernels that a build computes with.
"""

from __future__ import annotations

import json
from pathlib import Path

from assetbuild.engine.step import Files
from assetbuild.engine.wire import perform, step_from_json


def main(place: str) -> None:
    """Writes `said.json`: name of a step -> why it failed, "" where it did not."""
    folder = Path(place)
    inputs, said = folder / "in", {}
    for job in json.loads((folder / "steps.json").read_bytes()):
        name = job["name"]
        outputs = inputs if job["prepares"] else folder / "out" / name
        outputs.mkdir(parents=True, exist_ok=True)
        done, _ = perform(step_from_json(job["step"]), Files(inputs, outputs), name)
        error = done.get("error")
        said[name] = str(error["message"]) if isinstance(error, dict) else ""
    (folder / "said.json").write_text(json.dumps(said), encoding="utf-8")
