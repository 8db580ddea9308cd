"""A `world` with a floating joint below it is a floating base, which every format can hold."""

from __future__ import annotations

from pathlib import Path

from assetbuild.init import propose, write
from assetbuild.pipeline.recipes import load_recipe

BALL = (
    '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" '
    'iyz="0"/></inertial><collision><geometry><sphere radius="0.1"/></geometry></collision>'
)
FLOATS = f"""\
<robot name="buoy">
  <link name="world"/>
  <joint name="free" type="floating">
    <parent link="world"/><child link="hull"/>
  </joint>
  <link name="hull">{BALL}</link>
  <joint name="turn" type="revolute"><parent link="hull"/><child link="mast"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="5" velocity="3"/></joint>
  <link name="mast">{BALL}</link>
</robot>
"""


def test_the_empty_root_is_removed_by_patches_and_the_base_floats(tmp_path: Path):
    (tmp_path / "buoy.urdf").write_text(FLOATS)
    out = tmp_path / "buoy.yaml"
    write(propose(tmp_path / "buoy.urdf", out, {}), force=True)
    recipe = load_recipe(out).recipe
    assert recipe.base == "floating"
    assert tuple(recipe.targets) == ("urdf", "mjcf", "usd")
    assert [str(patch.find)[:20] for patch in recipe.source.patches] == [
        '<joint name="free" t',
        '<link name="world"/>',
    ]
    assert "lets the robot float" in str(recipe.source.patches[0].because)


def test_a_root_with_a_shape_stays(tmp_path: Path):
    (tmp_path / "buoy.urdf").write_text(
        FLOATS.replace('<link name="world"/>', f'<link name="world">{BALL}</link>')
    )
    assert "patches" not in propose(tmp_path / "buoy.urdf", tmp_path / "buoy.yaml", {}).text
