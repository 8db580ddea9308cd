"""Size and seconds of our USD beside those of two converters, on the same robots, in one run.

    ASSETBUILD_TEST_DATA=.../share python tests/benchmarks/usd_beside_converter.py PYTHON [ROBOT...]

PYTHON: the interpreter of an environment with urdf-usd-converter and mujoco-usd-converter; they
bring a `pxr` of their own, which breaks ours, so it may not be this one. Ours is a cold build with
an empty store: meshes read and split, joints merged, the USD written *and* checked; theirs are the
conversions, of the URDF and of the MJCF that we make of it. Same goals for all: no decimation,
collision as in the source.
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
targets: [{target}]
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


def ours(name: str, root: Path, place: Path, target: str) -> Made:
    """A cold build, checks included."""
    recipe = place / f"{target}.yaml"
    urdf = f"robots/{ROBOTS[name]}"
    recipe.write_text(RECIPE.format(root=root, urdf=urdf, target=target), encoding="utf-8")
    environment = os.environ | {"ASSETBUILD_CACHE": str(place / f"store-{target}")}
    command = [sys.executable, "-m", "assetbuild", "build", str(recipe), "-o", str(place / target)]
    return run([*command, "--fail-on", "never"], place / target / target, environment)


def of_urdf(name: str, root: Path, place: Path, python: str) -> Made:
    """One conversion by urdf-usd-converter."""
    tool = str(Path(python).with_name("urdf_usd_converter"))
    package = f"example-robot-data={root}"
    source = str(root / "robots" / ROBOTS[name])
    command = [tool, source, str(place / "of_urdf"), "--package", package]
    return run(command, place / "of_urdf", dict(os.environ))


def of_mjcf(place: Path, python: str) -> Made:
    """One conversion by mujoco-usd-converter, of our MJCF."""
    tool = str(Path(python).with_name("mujoco_usd_converter"))
    command = [tool, str(place / "mjcf" / "mjcf" / "robot.xml"), str(place / "of_mjcf")]
    return run(command, place / "of_mjcf", dict(os.environ))


def main() -> None:
    """Print a table in Markdown."""
    python, names = sys.argv[1], sys.argv[2:] or list(ROBOTS)
    root = Path(os.environ["ASSETBUILD_TEST_DATA"]).resolve() / "example-robot-data"
    print("| robot | ours, s (CPU) | of the URDF | of the MJCF | MB: ours | URDF | MJCF | codes |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder)
            made = [ours(name, root, place, "usd"), of_urdf(name, root, place, python)]
            ours(name, root, place, "mjcf")
            made.append(of_mjcf(place, python))
        cells = [f"{each.seconds:.1f} ({each.cpu:.1f})" for each in made]
        cells += [f"{each.megabytes:.1f}" for each in made]
        codes = ", ".join(str(each.code) for each in made)
        print(f"| {name} | {' | '.join(cells)} | {codes} |", flush=True)


if __name__ == "__main__":
    main()
