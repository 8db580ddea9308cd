"""The same bytes of a real robot: three cold builds, with 1 and 2 processes, from two checkouts.

    python tests/benchmarks/same_bytes.py [panda|go1|g1]

Collision by `auto` from the visual meshes, manipulation preset. The second checkout is a copy of
the package elsewhere. Prints the digest of each manifest, CPU and wall seconds of each build.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from links import robots_root
from ten_links import cpu

ROOT = Path(__file__).parents[2]
URDFS = {
    "panda": "panda_description/urdf/panda.urdf",
    "go1": "go1_description/urdf/go1.urdf",
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
}
RECIPE = """\
schema: assetbuild/v1
robot: {robot}
source:
  path: {root}
  urdf: robots/{urdf}
  packages: {{example-robot-data: .}}
base: fixed
collision: {{preset: manipulation, default: {{method: auto, from: visual}}}}
targets: [mjcf]
validate: {{free_fall: null}}
"""


def cold_build(robot: str, code: Path, place: Path, jobs: int) -> Path:
    """The bundle of a build from nothing, by the package in `code`."""
    place.mkdir()
    recipe = place / "robot.yaml"
    root = robots_root().parent.resolve()
    recipe.write_text(RECIPE.format(robot=robot, root=root, urdf=URDFS[robot]), encoding="utf-8")
    command = [sys.executable, "-m", "assetbuild", "build", "robot.yaml", "-o", "out"]
    subprocess.run(
        [*command, "-j", str(jobs), "--fail-on", "never"],
        cwd=place,
        env=os.environ | {"ASSETBUILD_CACHE": str(place / "store"), "PYTHONPATH": str(code)},
        check=True,
        capture_output=True,
    )
    return place / "out"


def main(robot: str = "panda") -> None:
    """Build three times; the exit code is 1 when the bytes differ."""
    digests = set()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(ROOT / "assetbuild", folder / "checkout/assetbuild")
        runs = [(ROOT, 1), (ROOT, 2), (folder / "checkout", 2)]
        for number, (code, jobs) in enumerate(runs):
            before, began = cpu(), time.monotonic()
            bundle = cold_build(robot, code, folder / f"run {number}", jobs)
            digest = hashlib.sha256((bundle / "manifest.json").read_bytes()).hexdigest()
            spent, wall = cpu() - before, time.monotonic() - began
            where = "this checkout" if code == ROOT else "another checkout"
            print(
                f"{robot}, {where}, -j{jobs}: {digest[:16]} ({spent:.0f} CPU s, {wall:.0f} s)",
                flush=True,
            )
            digests.add(digest)
    print("the same bytes" if len(digests) == 1 else "DIFFERENT BYTES")
    sys.exit(len(digests) != 1)


if __name__ == "__main__":
    main(*sys.argv[1:])
