"""URDFs straight into MuJoCo's own importer: does one load, and is its mass still there?

    python -m tests.benchmarks.importers FOLDER

FOLDER: an unpacked example-robot-data (`.../share/example-robot-data`). Prints the table of
docs/explanation/importers.md. `package://` becomes an absolute path first, which MuJoCo does not
do itself; each robot is then read without its visual meshes, MuJoCo's default for URDFs.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import mujoco

ROBOTS = {
    "Go1": "robots/go1_description/urdf/go1.urdf",
    "Go2": "robots/go2_description/urdf/go2.urdf",
    "A1": "robots/a1_description/urdf/a1.urdf",
    "ANYmal C": "robots/anymal_c_simple_description/urdf/anymal.urdf",
    "G1": "robots/g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "Panda": "robots/panda_description/urdf/panda.urdf",
    "UR10": "robots/ur_description/urdf/ur10_robot.urdf",
    "Allegro": "robots/allegro_hand_description/urdf/allegro_right_hand.urdf",
    "SO-101": "robots/so_arm_description/urdf/so101.urdf",
}


def main(folder: Path) -> None:
    """Print one row a robot."""
    print(
        "| robot | as shipped | with its mesh paths mended | mass, kg |\n| --- | --- | --- | --- |"
    )
    for robot, path in ROBOTS.items():
        urdf = folder / path
        text = urdf.read_text(encoding="utf-8")
        mended = re.sub(r"package://([^/]+)", lambda found: package(folder, found[1]), text)
        stated = sum(map(float, re.findall(r'<mass\s+value="([^"]+)"', text)))
        raw, (said, mass) = compiled(text)[0], compiled(mended)
        kept = f"{mass:.2f} of {stated:.2f}" if mass is not None else f"- of {stated:.2f}"
        print(f"| {robot} | {raw} | {said} | {kept} |")


def package(folder: Path, name: str) -> str:
    """Where a package of the wheel lies: a robot's own folder, or all of it."""
    own = folder / "robots" / name
    return str(own if own.is_dir() else folder)


def compiled(text: str) -> tuple[str, float | None]:
    """What MuJoCo says, and the model's mass in kg where it loads."""
    try:
        model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        return f"refused: {reason(str(error))}", None
    return "loads", float(model.body_mass.sum())


def reason(text: str) -> str:
    """MuJoCo's message without paths and places."""
    line = next((line for line in text.splitlines() if line.strip()), "").strip()
    for known in ("inertia must satisfy A + B >= C", "inertia must have positive eigenvalues"):
        if known in text:
            return known
    return "a mesh is not found" if "opening file" in text else re.sub(r"'[^']*/", "'", line)[:60]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
