"""Size and seconds of our USD beside urdf-usd-converter's, on the same robots, in one run.

    ASSETBUILD_TEST_DATA=.../share python tests/benchmarks/usd_beside_converter.py PYTHON [ROBOT...]

PYTHON: the interpreter of an environment with urdf-usd-converter; it brings a `pxr` of its own,
which breaks ours, so it may not be this one. Ours is a cold build with an empty store: meshes read
and split, joints merged, the USD written *and* checked; theirs is the conversion. Same goals for
both: no decimation, collision as in the source.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROBOTS = {
    "go1": "go1_description/urdf/go1.urdf",
    "go2": "go2_description/urdf/go2.urdf",
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "talos": "talos_data/robots/talos_full_v2.urdf",
    "pr2": "pr2_description/urdf/pr2.urdf",
    "b1-z1": "b1_description/urdf/b1-z1.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
}
RECIPE = """\
schema: assetbuild/v1
robot: robot
source:
  path: {root}
  urdf: {urdf}
  packages: {{example-robot-data: .}}
collision: {{default: {{method: keep, from: collision}}}}
targets: [usd]
validate: {{free_fall: null}}
"""


@dataclass(frozen=True)
class Made:
    """What one tool made. seconds: wall; cpu: s; megabytes: of all files; code: exit."""

    seconds: float
    cpu: float
    megabytes: float
    code: int


def run(command: list[str], folder: Path, environment: dict[str, str]) -> Made:
    """Run a tool and weigh the folder that it fills."""
    start, before = time.monotonic(), _cpu()
    done = subprocess.run(command, env=environment, capture_output=True, check=False)
    seconds, cpu = time.monotonic() - start, _cpu() - before
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return Made(seconds, cpu, size / 1e6, done.returncode)


def _cpu() -> float:
    """CPU seconds of all children so far."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def ours(name: str, root: Path, place: Path) -> Made:
    """A cold build, checks included."""
    recipe = place / "robot.yaml"
    recipe.write_text(RECIPE.format(root=root, urdf=f"robots/{ROBOTS[name]}"), encoding="utf-8")
    environment = os.environ | {"ASSETBUILD_CACHE": str(place / "store")}
    command = [sys.executable, "-m", "assetbuild", "build", str(recipe), "-o", str(place / "ours")]
    return run([*command, "--fail-on", "never"], place / "ours" / "usd", environment)


def theirs(name: str, root: Path, place: Path, python: str) -> Made:
    """One conversion."""
    tool = str(Path(python).with_name("urdf_usd_converter"))
    package = f"example-robot-data={root}"
    source = str(root / "robots" / ROBOTS[name])
    command = [tool, source, str(place / "theirs"), "--package", package]
    return run(command, place / "theirs", dict(os.environ))


def main() -> None:
    """Print a table in Markdown."""
    python, names = sys.argv[1], sys.argv[2:] or list(ROBOTS)
    root = Path(os.environ["ASSETBUILD_TEST_DATA"]).resolve() / "example-robot-data"
    print("| robot | ours, s (CPU) | theirs, s (CPU) | ours, MB | theirs, MB | exit codes |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            a, b = ours(name, root, place), theirs(name, root, place, python)
        print(
            f"| {name} | {a.seconds:.1f} ({a.cpu:.1f}) | {b.seconds:.1f} ({b.cpu:.1f}) | "
            f"{a.megabytes:.1f} | "
            f"{b.megabytes:.1f} | {a.code}, {b.code} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
