"""`init` proposes the loops that the names of a URDF's frames show, in a comment."""

from __future__ import annotations

from pathlib import Path

import pytest
import urdfs
import yaml
from proposals import proposed

from assetbuild.pipeline.recipes import whole_model

SIZE = '<box size="{} 0.02 0.02"/>'


def four_bar(one: str, other: str) -> str:
    """A motor on the crank, and a frame at both ends of the cut."""
    parts = [urdfs.link(one, ""), urdfs.link(other, "")]
    for name, length in (("base", 0.4), ("crank", 0.1), ("coupler", 0.2), ("rocker", 0.15)):
        middle = f"{length / 2} 0 0"
        solid = urdfs.inertial(0.2, urdfs.tensor(1e-4, 5e-4, 5e-4), middle)
        seen = urdfs.shape("visual", SIZE.format(length), middle)
        parts.append(urdfs.link(name, solid, seen))
    parts += [
        urdfs.joint("motor", "base", "crank", xyz="0 0 0"),
        urdfs.joint("free_1", "crank", "coupler", xyz="0.1 0 0"),
        urdfs.joint("free_2", "base", "rocker", xyz="0.2 0 0"),
        urdfs.joint(f"{one}_frame", "coupler", one, "fixed", "", xyz="0.2 0 0"),
        urdfs.joint(f"{other}_frame", "rocker", other, "fixed", "", xyz="0.15 0 0"),
    ]
    return urdfs.robot(*parts, name="four_bar")


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
