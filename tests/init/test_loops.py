"""`init` proposes the loops that the names of a URDF's frames show, with the joints they move."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from assetbuild.init import propose
from assetbuild.pipeline.recipes import whole_model

LINK = """<link name="{0}"><inertial><origin xyz="{1} 0 0"/><mass value="0.2"/>
<inertia ixx="1e-4" iyy="5e-4" izz="5e-4" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz="{1} 0 0"/><geometry><box size="{2} 0.02 0.02"/></geometry></visual></link>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>
<origin xyz="{3} 0 0"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="5" velocity="10"/></joint>"""
FRAME = """<link name="{0}"/><joint name="{0}_frame" type="fixed"><parent link="{1}"/>
<child link="{0}"/><origin xyz="{2} 0 0"/></joint>"""


def four_bar(folder: Path, one: str, other: str, ground: float = 0.2, rocker: float = 0.15) -> Path:
    """A motor on the crank, and a frame at both ends of the cut."""
    bars = (("base", 0.4), ("crank", 0.1), ("coupler", 0.2), ("rocker", 0.15))
    parts = [
        *(LINK.format(name, x / 2, x) for name, x in bars),
        JOINT.format("motor", "base", "crank", 0.0),
        JOINT.format("free_1", "crank", "coupler", 0.1),
        JOINT.format("free_2", "base", "rocker", ground),
        FRAME.format(one, "coupler", 0.2),
        FRAME.format(other, "rocker", rocker),
    ]
    path = folder / "four_bar.urdf"
    path.write_text('<robot name="four_bar">' + "\n".join(parts) + "</robot>")
    return path


def recipe_of(file: Path) -> tuple[dict, str]:
    text = propose(file, file.parent / "four_bar.yaml", {}).text
    plain = yaml.safe_load(text)
    whole_model().model_validate(plain)
    return plain, text


@pytest.mark.parametrize(
    ("one", "other", "name"),
    [
        ("closedloop_knee_1B", "closedloop_knee_1A", "closedloop_knee_1"),
        ("closing_pin_1", "closing_pin_2", "closing_pin"),
        ("constraint_A_3D", "constraint_B_3D", "constraint_3D"),
    ],
)
def test_frames_named_as_the_two_sides_of_a_cut_are_a_loop(
    one: str, other: str, name: str, tmp_path: Path
):
    plain, _ = recipe_of(four_bar(tmp_path, one, other))
    (loop,) = plain["loops"]
    assert loop["name"] == name
    assert {loop["a"]["link"], loop["b"]["link"]} == {one, other}
    assert loop["kind"] == "connect"  # a weld would lock the crank


def test_the_motor_is_driven_and_the_loop_moves_the_others(tmp_path: Path):
    plain, _ = recipe_of(four_bar(tmp_path, "loop_A", "loop_B"))
    models = {row["joints"]: row["model"] for row in plain["actuators"]}
    assert models == {"motor": "pd", ".*_[12]": "passive"}
    assert "free_1" not in plain["keyframes"]["home"]["joints"]


def test_frames_that_cannot_meet_are_a_remark_and_no_loop(tmp_path: Path):
    plain, text = recipe_of(four_bar(tmp_path, "loop_A", "loop_B", ground=2.0))
    assert "loops" not in plain
    assert "`loop_A` and `loop_B` are named as the ends of a loop" in text
