"""A four-bar whose loop only the recipe states builds as a user builds it; wrong loops do not."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from urdfs import inertial, joint, link, robot, shape, tensor

from assetbuild.cli import main

from .conftest import Place

BARS = {"base": 0.4, "crank": 0.1, "coupler": 0.2, "rocker": 0.15}
"""Lengths along x, m."""
JOINTS = {"crank": ("base", 0.0), "coupler": ("crank", 0.1), "rocker": ("base", 0.2)}


def bar(name: str, length: float) -> str:
    weight = inertial(0.2, tensor(1e-4, 5e-4, 5e-4), f"{length / 2} 0 0")
    shown = shape("visual", f'<box size="{length} 0.02 0.02"/>', f"{length / 2} 0 0")
    return link(name, weight, shown)


def hinge(child: str, parent: str, at: float) -> str:
    limit = '<limit lower="-3" upper="3" effort="5" velocity="10"/>'
    return joint(f"{child}_joint", parent, child, content=limit, xyz=f"{at} 0 0")


URDF = robot(
    *itertools.starmap(bar, BARS.items()),
    *(hinge(child, *at) for child, at in JOINTS.items()),
    name="four_bar",
)
RECIPE = """schema: assetbuild/v1
robot: four_bar
source: {path: ., urdf: four_bar.urdf, license: MIT}
loops:
  - {name: pin, a: {link: coupler, xyz: [0.2, 0, 0]}, b: {link: rocker, xyz: [0.15, 0, 0]}}
actuators:
  - {joints: crank_joint, model: pd, kp: 20, kd: 0.5}
  - {joints: coupler_joint|rocker_joint, model: passive}
keyframes:
  home: {joints: {crank_joint: 0.3}}
collision: {default: {method: none}}
targets: [urdf, mjcf, mjx, usd, mjlab, isaaclab]
"""


@pytest.mark.slow  # a whole build, pictures and all
def test_a_four_bar_closes_in_every_format_that_holds_loops(tmp_path: Path):
    place = Place(tmp_path, tmp_path / "store", "four_bar.yaml")
    (tmp_path / "four_bar.urdf").write_text(URDF)
    place.recipe.write_text(RECIPE)
    place.ran()
    report = json.loads((place.bundle / "report/report.json").read_text())
    assert report["checks"]["loops"]["figures"]["largest_gap"] < 1e-4
    assert "urdf.loop" in {finding["rule"] for finding in report["findings"]}
    models = [
        mujoco.MjModel.from_xml_path(str(place.bundle / f"mjcf/{name}.xml"))
        for name in ("four_bar_mjx", "four_bar_bare", "four_bar")
    ]
    assert [model.neq for model in models] == [1, 1, 1]
    model = models[-1]
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert np.linalg.norm(data.site("pin_a").xpos - data.site("pin_b").xpos) < 1e-9


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("link: rocker,", "link: rockr,", "b: no link `rockr`\nhint: did you mean `rocker`"),
        ("rocker, xyz: [0.15", "base, xyz: [1", "loops: `pin` cannot close: the nearest that its"),
        ("[0.2, 0, 0]", "[.nan, 0, 0]", "loops[0].a.xyz[0]: must be finite"),
        ("pin,", "pin, solimp: [1, 0.99, 0.001, 0.5, 2],", "solimp[0]: must be at most 0.9999"),
    ],
    ids=["no such link", "cannot close", "not a number", "impedance"],
)
def test_a_wrong_loop_is_one_error_with_its_line(
    old: str, new: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "four_bar.urdf").write_text(URDF)
    recipe = tmp_path / "four_bar.yaml"
    recipe.write_text(RECIPE.replace(old, new))
    assert main(["build", str(recipe), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "four_bar.yaml:5:" in said
    assert message in said
    assert said.count("error: ") == 1 and "Traceback" not in said
    assert not (tmp_path / "out").exists()
