"""How many meshes of a robot need a decomposition of their own, the rest being equal or mirrored.

python tests/benchmarks/reuse.py [g1_description]
python tests/benchmarks/reuse.py --build [g1]

With --build the robot is built from nothing, by `auto`, with a process per core: how many meshes
were decomposed and how many reused, CPU and wall seconds, and the share of the cores that was used.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from links import robots_root
from same_bytes import ROOT, cold_build
from ten_links import cpu

from assetbuild.engine.step import Files
from assetbuild.geometry.convert_mesh import ConvertMesh
from assetbuild.geometry.match_shapes import MatchShapes


def main(robot: str = "g1_description") -> None:
    """Print counts and CPU seconds."""
    meshes = sorted(
        path
        for path in (robots_root() / robot).rglob("*")
        if path.suffix.lower() in (".stl", ".obj", ".dae")
    )
    distinct = {hashlib.sha256(path.read_bytes()).hexdigest(): path for path in meshes}
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        before = cpu()
        for number, path in enumerate(distinct.values()):
            source, out = root / f"source/{number}", root / f"in/shapes/{number}"
            source.mkdir(parents=True)
            out.mkdir(parents=True)
            shutil.copyfile(path, source / "mesh")
            step = ConvertMesh(format=path.suffix.lower().lstrip("."))
            list(step.run(Files(source, out)))
        converted = cpu() - before
        before = cpu()
        folders = tuple(f"shapes/{number}" for number in range(len(distinct)))
        list(MatchShapes(folders=folders).run(Files(root / "in", root)))
        matched = cpu() - before
        matches = json.loads((root / "matches.json").read_text())
    mirrored = Counter("mirrored" if -1.0 in m["signs"] else "same" for m in matches.values())
    print(
        f"{robot}: {len(meshes)} files, {len(distinct)} distinct, {len(matches)} equal to an "
        f"earlier one ({dict(mirrored)}), {len(distinct) - len(matches)} to decompose; "
        f"converting {converted:.1f} CPU s, matching {matched:.1f} CPU s"
    )


def build(robot: str = "g1") -> None:
    """Print what a cold build decomposed, and what it cost."""
    cores = os.cpu_count() or 1
    before, began = cpu(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        bundle = cold_build(robot, ROOT, Path(folder) / "run", cores)
        spent, wall = cpu() - before, time.monotonic() - began
        findings = json.loads((bundle / "report/report.json").read_text())["findings"]
        steps = json.loads(bundle.with_suffix(".run.json").read_text())["steps"]
    gaps = [f["data"]["method"] for f in findings if f["rule"] == "collision.gap"]
    fitted = [label for label in steps if label.startswith("auto ")]
    print(
        f"{robot}: {len(fitted)} meshes, found by: {dict(Counter(gaps))}; {spent:.0f} CPU s, "
        f"{wall:.0f} s on {cores} cores: {100 * spent / wall / cores:.0f} % of them"
    )


if __name__ == "__main__":
    build(*sys.argv[2:]) if sys.argv[1:2] == ["--build"] else main(*sys.argv[1:])
