"""`init` on a xacro: its packages are found, its arguments listed, and the recipe builds."""

from __future__ import annotations

from pathlib import Path

import pytest
from proposals import proposed

from assetbuild.errors import SourceError, UsageError
from assetbuild.init import propose, write
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.recipe.loader import LoadedRecipe

NAMESPACE = "xmlns:xacro='http://www.ros.org/wiki/xacro'"
MAIN = f"""<robot name='bot' {NAMESPACE}>
  <xacro:arg name='size' default='0.1'/>
  <xacro:include filename='$(find parts)/arm.xacro'/>
  <link name='world'/>
  <link name='base'><visual><geometry>
    <mesh filename='package://shapes/base.obj'/></geometry></visual></link>
  <joint name='bolt' type='fixed'><parent link='world'/><child link='base'/></joint>
  <xacro:arm size='$(arg size)'/>
</robot>"""
ARM = f"""<robot {NAMESPACE}>
  <xacro:arg name='effort' default='12'/>
  <xacro:macro name='arm' params='size'>
    <link name='arm'>
      <inertial><mass value='1'/>
        <inertia ixx='0.01' iyy='0.01' izz='0.01' ixy='0' ixz='0' iyz='0'/></inertial>
      <collision><geometry><sphere radius='${{size}}'/></geometry></collision>
    </link>
    <joint name='swing' type='continuous'><parent link='base'/><child link='arm'/>
      <limit effort='$(arg effort)' velocity='3'/></joint>
  </xacro:macro>
</robot>"""
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def packages(tmp_path: Path) -> Path:
    """`bot/urdf/bot.urdf.xacro`, which includes package `parts` and shows one of `shapes`."""
    for path, text in (
        ("ws/bot/urdf/bot.urdf.xacro", MAIN),
        ("ws/bot/package.xml", "<package><name>bot</name></package>"),
        ("ws/parts/arm.xacro", ARM),
        ("elsewhere/my_shapes/base.obj", OBJ),
    ):
        file = tmp_path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return tmp_path


def initialised(folder: Path, **args: str) -> LoadedRecipe:
    shapes = {"shapes": folder / "elsewhere/my_shapes"}
    out = folder / "bot.yaml"
    write(propose(folder / "ws/bot/urdf/bot.urdf.xacro", out, shapes, args), force=True)
    return load_recipe(out)


def test_packages_are_found_and_arguments_are_listed(packages: Path):
    source = initialised(packages).recipe.source
    assert source.xacro == "ws/bot/urdf/bot.urdf.xacro"
    assert source.packages == {"parts": "ws/parts", "shapes": "elsewhere/my_shapes"}
    assert source.args == {}
    text = (packages / "bot.yaml").read_text()
    assert '# size: "0.1"' in text
    assert '# effort: "12"' in text


def test_arguments_decide_the_robot(packages: Path):
    loaded = initialised(packages, effort="30")
    assert loaded.recipe.source.args == {"effort": "30"}
    text = (packages / "bot.yaml").read_text()
    assert "1 joint: 30 N m" in text
    assert "# effort:" not in text  # given, so not among those that could be


def test_an_argument_that_the_robot_does_not_have_is_refused(packages: Path):
    with pytest.raises(SourceError, match="--arg efort: ") as raised:
        initialised(packages, efort="30")
    assert raised.value.hint == "did you mean `effort`?"


def test_arguments_without_a_default_are_all_asked_for_at_once(packages: Path):
    main_file = packages / "ws/bot/urdf/bot.urdf.xacro"
    main_file.write_text(MAIN.replace("name='bot'", "name='$(arg model)$(arg side)'"))
    with pytest.raises(SourceError, match="Undefined substitution argument model") as raised:
        initialised(packages)
    assert raised.value.hint.endswith("`--arg` of `init`; it also needs `side`")
    assert initialised(packages, model="two", side="s").recipe.robot == "twos"


def test_arguments_are_for_a_xacro(robots: Path):
    with pytest.raises(UsageError, match="for a xacro file"):
        propose(robots / "four_legs.urdf", None, {}, {"a": "b"})


def test_a_xacro_that_calls_itself_urdf_is_one(packages: Path):
    old = packages / "ws/bot/urdf/bot.urdf.xacro"
    old.rename(packages / "ws/bot/urdf/bot.urdf")
    shapes = {"shapes": packages / "elsewhere/my_shapes"}
    proposal = propose(packages / "ws/bot/urdf/bot.urdf", packages / "bot.yaml", shapes)
    assert "xacro: ws/bot/urdf/bot.urdf" in proposal.text


def test_a_urdf_that_only_declares_the_namespace_is_none(robots: Path, tmp_path: Path):
    text = (robots / "four_legs.urdf").read_text()
    dog = text.replace("<robot ", f"<robot {NAMESPACE} ", 1)
    assert proposed(dog, tmp_path).recipe.source.urdf == "robot.urdf"


def test_a_urdf_that_defines_its_macro_is_a_xacro(robots: Path, tmp_path: Path):
    macro = "<xacro:macro name='tip'><link name='tip'/></xacro:macro><xacro:tip/></robot>"
    text = (robots / "four_legs.urdf").read_text().replace("</robot>", macro)
    with pytest.raises(SourceError, match="tip"):  # no joint holds it
        proposed(text.replace("<robot ", f"<robot {NAMESPACE} ", 1), tmp_path)
