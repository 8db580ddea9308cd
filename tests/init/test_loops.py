"""`init` proposes the loops that the names of a URDF's frames show, in a comment."""

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
    plain, text = recipe_of(four_bar(tmp_path, one, other))
    assert "loops" not in plain
    row = next(line for line in text.splitlines() if one in line and other in line)
    (loop,) = yaml.safe_load(row.lstrip("# "))
    whole_model().model_validate(plain | {"loops": [loop]})
    assert {loop["a"]["link"], loop["b"]["link"]} == {one, other}
