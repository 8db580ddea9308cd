"""What `init` proposes in comments works as it stands, once the `#` is gone."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import commands
import pytest
import urdfs
from mjcfs import ROBOTS

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


def proposed(source: Path, recipe: Path, **packages: Path) -> list[str]:
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
    keys = proposed(go1_root / "robots" / urdf, recipe, **{PACKAGE: go1_root})
    assert keys == ["license", "feet", "imu"]  # `stand` is on
    accepted(recipe)


def test_every_proposal_of_an_mjcf_is_accepted(tmp_path: Path):
    keys = proposed(ROBOTS / "hard_arm.xml", tmp_path / "arm.yaml")
    assert {"license", "base", "simulation"} <= set(keys)
    accepted(tmp_path / "arm.yaml")


def humanoid() -> str:
    """Two legs; a foot is an ankle and a sole of two boxes, which a fixed joint holds together."""
    trunk = urdfs.shape("collision", '<box size="0.2 0.3 0.4"/>', "0 0 0.2")
    rod = urdfs.shape("collision", '<cylinder radius="0.04" length="0.3"/>', "0 0 -0.2")
    ankle = urdfs.shape("collision", '<box size="0.1 0.08 0.04"/>', "0 0 -0.04")
    sole = [
        urdfs.shape("collision", '<box size="0.1 0.08 0.01"/>', f"{x} 0 0") for x in (0.06, -0.05)
    ]
    limit = '<limit lower="-1.5" upper="1.5" effort="80" velocity="10"/>'
    parts = [urdfs.link("trunk", urdfs.inertial(8.0, urdfs.tensor(0.2, 0.2, 0.1)), trunk)]
    for side, y in (("left", 0.1), ("right", -0.1)):
        parts += [
            urdfs.link(f"{side}_thigh", urdfs.inertial(1.0, xyz="0 0 -0.2"), rod),
            urdfs.link(f"{side}_shank", urdfs.inertial(1.0, xyz="0 0 -0.2"), rod),
            urdfs.link(f"{side}_ankle", urdfs.inertial(0.5), ankle),
            urdfs.link(f"{side}_sole", urdfs.inertial(0.1), *sole),
        ]
        chain = ("trunk", f"{side}_thigh", f"{side}_shank", f"{side}_ankle")
        places = (f"0 {y} 0", "0 0 -0.4", "0 0 -0.4")
        for parent, child, xyz in zip(chain, chain[1:], places, strict=False):
            parts.append(urdfs.joint(f"{child}_joint", parent, child, content=limit, xyz=xyz))
        ends = (f"{side}_ankle", f"{side}_sole", "fixed", "")
        parts.append(urdfs.joint(f"{side}_sole_joint", *ends, xyz="0 0 -0.065"))
    return urdfs.robot(*parts, name="humanoid")


@pytest.mark.slow  # a whole build, pictures and all
def test_a_humanoid_with_feet_of_several_shapes_builds_for_mjlab(tmp_path: Path):
    (tmp_path / "humanoid.urdf").write_text(humanoid())
    recipe = tmp_path / "humanoid.yaml"
    assert {"feet", "imu"} <= set(proposed(tmp_path / "humanoid.urdf", recipe))
    code, said = run(tmp_path, "build", recipe.name, "-o", "out", "--fail-on", "never")
    assert code == 0, said
    report = json.loads((tmp_path / "out/report/report.json").read_text())
    assert report["checks"]["mjlab_contract"]["status"] == "pass", report["findings"]
    module = (tmp_path / "out/python/humanoid_mjlab.py").read_text()
    assert 'mode="body", pattern=("left_ankle", "right_ankle",)' in module
