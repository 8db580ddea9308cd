"""How many meshes of a robot need a decomposition of their own, the rest being equal or mirrored.

python tests/benchmarks/reuse.py [g1_description]
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from links import robots_root
from ten_links import cpu

from assetbuild.engine.step import Files
from assetbuild.steps.convert_mesh import ConvertMesh
from assetbuild.steps.match_shapes import MatchShapes


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


if __name__ == "__main__":
    main(*sys.argv[1:])
