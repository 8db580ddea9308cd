"""mjlab's own robots in, our MJCF out: are the compiled models equal, item by item?

    python -m tests.benchmarks.mjlab_round_trip FOLDER

FOLDER: mjlab's wheel, unpacked. Each MJCF of its zoo is built with its collision shapes as they
are; the check `mjcf_source` compares what compiles from it with what compiles from ours: bodies,
joints, shapes, sites, sensors, tendons, equalities, options, and both in motion. The table says how
many of each were compared, how many the source has, and every finding.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

RECIPE = """\
schema: assetbuild/v1
robot: {name}
source: {{path: {folder}, mjcf: {file}, license: Apache-2.0}}
collision: {{default: {{method: keep, from: collision}}}}
visual: {{max_faces: 1000000}}
targets: [mjcf]
"""
KINDS = ("body", "joint", "shape", "frame", "sensor", "actuator", "tendon", "equality", "camera")


def main(wheel: str) -> int:
    """Prints the table; 1 when a model differs."""
    differ = 0
    print(f"| robot | {' | '.join(KINDS)} | differences |\n{'| --- ' * (len(KINDS) + 2)}|")
    for path in sorted(Path(wheel).glob("mjlab/asset_zoo/robots/*/xmls/*.xml")):
        if path.name == "scene.xml":
            continue
        with tempfile.TemporaryDirectory() as folder:
            report = _report(path, Path(folder))
        figures = report["checks"]["mjcf_source"]["figures"]["compared"]
        cells = [" of ".join(map(str, figures.get(kind, ["-"]))) for kind in KINDS]
        found = [f for f in report["findings"] if f["rule"].startswith("equal.source")]
        differ += len(found)
        words = "; ".join(f"{f['subject']}: {f['message']}" for f in found) or "none"
        print(f"| {path.stem} | {' | '.join(cells)} | {words} |", flush=True)
    return 1 if differ else 0


def _report(path: Path, folder: Path) -> dict:  # type: ignore[type-arg] # JSON
    recipe = folder / f"{path.stem}.yaml"
    recipe.write_text(RECIPE.format(name=path.stem, folder=path.parent.resolve(), file=path.name))
    out = folder / "out"
    asked = ["build", str(recipe), "-o", str(out), "--fail-on", "never"]
    done = subprocess.run(
        [sys.executable, "-m", "assetbuild", *asked], capture_output=True, text=True, check=False
    )
    if not (out / "report/report.json").is_file():
        sys.exit(f"{path.name} was not built\n{done.stderr}")
    found: dict = json.loads((out / "report/report.json").read_text())  # type: ignore[type-arg]
    return found


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
