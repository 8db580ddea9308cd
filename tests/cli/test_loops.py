"""A four-bar whose loop only the recipe states builds as a user builds it; wrong loops do not."""

from __future__ import annotations

import json
import os
from pathlib import Path

import commands
import mujoco
import numpy as np
import pytest

from assetbuild.cli import main

BAR = """<link name="{0}"><inertial><origin xyz="{1} 0 0"/><mass value="0.2"/>
<inertia ixx="1e-4" iyy="5e-4" izz="5e-4" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz="{1} 0 0"/><geometry><box size="{2} 0.02 0.02"/></geometry></visual></link>"""
JOINT = """<joint name="{0}_joint" type="revolute"><parent link="{1}"/><child link="{0}"/>
<origin xyz="{2} 0 0"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="5" velocity="10"/></joint>"""
URDF = "\n".join(
    [
        '<robot name="four_bar">',
        *(BAR.format(name, x / 2, x) for name, x in
          (("base", 0.4), ("crank", 0.1), ("coupler", 0.2), ("rocker", 0.15))),
        JOINT.format("crank", "base", 0.0),
        JOINT.format("coupler", "crank", 0.1),
        JOINT.format("rocker", "base", 0.2),
        "</robot>",
    ]
)  # fmt: skip
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
    (tmp_path / "four_bar.urdf").write_text(URDF)
    (tmp_path / "four_bar.yaml").write_text(RECIPE)
    environment = os.environ | {"ASSETBUILD_CACHE": str(tmp_path / "cache")}
    done = commands.run(["build", "four_bar.yaml", "-o", "out"], tmp_path, environment)
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads((tmp_path / "out/report/report.json").read_text())
    assert report["checks"]["loops"]["figures"]["largest_gap"] < 1e-4
    assert "urdf.loop" in {finding["rule"] for finding in report["findings"]}
    for name in ("four_bar", "four_bar_mjx", "four_bar_bare"):
        model = mujoco.MjModel.from_xml_path(str(tmp_path / f"out/mjcf/{name}.xml"))
        assert model.neq == 1
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/mjcf/four_bar.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert np.linalg.norm(data.site("pin_a").xpos - data.site("pin_b").xpos) < 1e-9


PIN = (
    "  - {name: pin, a: {link: coupler, xyz: [0.2, 0, 0]}, b: {link: rocker, xyz: [0.15, 0, 0]}}\n"
)
HOME = "home: {joints: {crank_joint: 0.3}}"
LINE = RECIPE[: RECIPE.index(PIN)].count("\n") + 1


@pytest.mark.parametrize(
    ("old", "new", "line", "message", "hint"),
    [
        (
            "link: rocker,", "link: rockr,", LINE,
            "loops[0].b: no link `rockr`", "did you mean `rocker`",
        ),
        (
            "{link: rocker, xyz: [0.15, 0, 0]}", "{link: base, xyz: [1, 0, 0]}", LINE,
            "loops: `pin` cannot close: the nearest that its ends `coupler` and `base` come is "
            "0.7002 m",
            "check the frames of both ends",
        ),
        (
            "{link: rocker, xyz: [0.15, 0, 0]}}", "{link: base, xyz: [0.25, 0, 0]}}", LINE,
            "loops: `pin` locks joint `crank_joint`, which is driven",
            "a loop must leave its driven joints a motion",
        ),
        (
            "link: rocker, xyz: [0.15", "link: coupler, xyz: [0.15", LINE,
            "loops[0]: no joint moves between `coupler` and `coupler`, so loop `pin` holds nothing",
            "name two links with moving joints between them",
        ),
        (PIN, PIN + PIN, LINE + 1, "loops[1]: a second loop is named `pin`", "choose another name"),
        ("[0.2, 0, 0]", "[.nan, 0, 0]", LINE, "loops[0].a.xyz[0]: must be finite", ""),
        (
            "name: pin,", "name: pin, solimp: [1, 0.99, 0.001, 0.5, 2],", LINE,
            "loops[0].solimp[0]: must be at most 0.9999", "",
        ),
    ],
    ids=[
        "no such link", "cannot close", "locked drive", "one link", "two of a name",
        "not a number", "impedance",
    ],
)  # fmt: skip
def test_a_wrong_loop_is_one_error_with_its_line(
    old: str, new: str, line: int, message: str, hint: str,
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
):  # fmt: skip
    text = RECIPE.replace(old, new)
    if "locks" in message:
        text = text.replace(HOME, "home: {}")
    (tmp_path / "four_bar.urdf").write_text(URDF)
    recipe = tmp_path / "four_bar.yaml"
    recipe.write_text(text)
    assert main(["build", str(recipe), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert f"four_bar.yaml:{line}:" in said
    assert message in said and hint in said
    assert said.count("error: ") == 1 and "Traceback" not in said
    assert not (tmp_path / "out").exists()
