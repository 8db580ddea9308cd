"""What `init` proposes in comments works as it stands, once the `#` is gone."""

from __future__ import annotations

import os
import re
from pathlib import Path

import commands
import pytest
import urdfs
import yaml
from mjcfs import ROBOTS
from proposals import proposed

from assetbuild.init import propose, write
from assetbuild.pipeline.recipes import whole_model

KEYS = {*whole_model().model_fields, "license", "stand"}
"""At the top of a recipe, and what `init` proposes below `source` and `validate`."""
PROPOSAL = re.compile(r"( *)# (\w+): (.+)")
PACKAGE = "example-robot-data"


def taken_up(recipe: Path) -> list[str]:
    """Uncomment every proposal of a recipe and add mjlab to its targets; the keys."""
    lines, keys = [], []
    for line in recipe.read_text().splitlines():
        found = PROPOSAL.fullmatch(line)
        if found and found[2] in KEYS:
            keys.append(found[2])
            line = f"{found[1]}{found[2]}: {found[3]}"
        lines.append(re.sub(r"^(targets: \[.*)\]", r"\1, mjlab]", line))
    recipe.write_text("\n".join(lines) + "\n")
    return keys


def written(source: Path, recipe: Path, **packages: Path) -> list[str]:
    write(propose(source, recipe, packages), force=True)
    return taken_up(recipe)


def run(folder: Path, *words: str) -> tuple[int, str]:
    environment = os.environ | {"ASSETBUILD_CACHE": str(folder / "cache")}
    done = commands.run(words, folder, environment)
    return done.returncode, done.stdout + done.stderr


def accepted(recipe: Path) -> None:
    for verb in ("plan", "check"):
        code, said = run(recipe.parent, verb, recipe.name)
        assert code == 0, said


@pytest.mark.parametrize(
    "urdf",
    [
        "go1_description/urdf/go1.urdf",
        pytest.param("talos_data/robots/talos_full_v2.urdf", marks=pytest.mark.slow),
    ],
)
def test_every_proposal_of_a_robot_with_legs_is_accepted(urdf: str, go1_root: Path, tmp_path: Path):
    recipe = tmp_path / "robot.yaml"
    keys = written(go1_root / "robots" / urdf, recipe, **{PACKAGE: go1_root})
    assert keys == ["license", "feet", "imu"]  # `stand` is on
    accepted(recipe)


def test_every_proposal_of_an_mjcf_is_accepted(tmp_path: Path):
    keys = written(ROBOTS / "hard_arm.xml", tmp_path / "arm.yaml")
    assert {"license", "base", "simulation"} <= set(keys)
    accepted(tmp_path / "arm.yaml")


# --- loops, by the names of a URDF's frames ---------------------------------------------------

BARS = Path(__file__).parents[1] / "writers/four_bar.urdf"


def four_bar(one: str, other: str) -> str:
    """A crank, a coupler and a rocker, and a frame at both ends of the cut."""
    frames = (
        urdfs.link(one, "") + urdfs.link(other, ""),
        urdfs.joint(f"{one}_frame", "coupler", one, "fixed", "", xyz="0.2 0 0"),
        urdfs.joint(f"{other}_frame", "rocker", other, "fixed", "", xyz="0 0 0.15"),
    )
    return BARS.read_text().replace("</robot>", f"{''.join(frames)}</robot>")


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("closedloop_knee_1A", "closedloop_knee_1B"),
        ("closing_pin_1", "closing_pin_2"),
        ("constraint_A_3D", "constraint_B_3D"),
    ],
)
def test_frames_named_as_the_two_sides_of_a_cut_are_a_row_to_uncomment(
    one: str, other: str, tmp_path: Path
):
    made = proposed(four_bar(one, other), tmp_path)
    assert "loops" not in made.plain
    row = next(line for line in made.text.splitlines() if one in line and other in line)
    (loop,) = yaml.safe_load(row.lstrip("# "))
    whole_model().model_validate(made.plain | {"loops": [loop]})
    assert {loop["a"]["link"], loop["b"]["link"]} == {one, other}
