"""`init` on a xacro: its arguments are listed and given, and what calls itself URDF may be one."""

from __future__ import annotations

from pathlib import Path

import pytest
from proposals import Proposed, proposed
from urdfs import inertial, joint, link, robot, shape

from assetbuild.errors import SourceError, UsageError
from assetbuild.init import propose

NAMESPACE = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" '
BALL = shape("collision", '<sphere radius="$(arg size)"/>')
SWING = '<limit effort="$(arg effort)" velocity="3"/>'
MAIN = robot(
    '<xacro:arg name="size" default="0.1"/><xacro:include filename="effort.xacro"/>',
    link("world", "") + link("arm", inertial(), BALL),
    joint("swing", "world", "arm", "continuous", SWING),
    name="bot",
).replace("<robot ", NAMESPACE)
EFFORT = f'{NAMESPACE}><xacro:arg name="effort" default="12"/></robot>'


def initialised(
    folder: Path, text: str = MAIN, name: str = "bot.urdf.xacro", **args: str
) -> Proposed:
    (folder / name).write_text(text)
    (folder / "effort.xacro").write_text(EFFORT)
    return proposed(folder / name, folder, **args)


def test_arguments_are_listed_those_of_included_files_too(tmp_path: Path):
    made = initialised(tmp_path)
    assert made.recipe.source.xacro == "bot.urdf.xacro"
    assert made.recipe.source.args == {}
    assert '# size: "0.1"' in made.text
    assert '# effort: "12"' in made.text


def test_arguments_decide_the_robot(tmp_path: Path):
    made = initialised(tmp_path, effort="30")
    assert made.recipe.source.args == {"effort": "30"}
    assert "1 joint: 30 N m" in made.text
    assert "# effort:" not in made.text  # given, so not among those that could be


def test_an_argument_that_the_robot_does_not_have_is_refused(tmp_path: Path):
    with pytest.raises(SourceError, match="--arg efort: ") as raised:
        initialised(tmp_path, efort="30")
    assert raised.value.hint == "did you mean `effort`?"


def test_arguments_without_a_default_are_all_asked_for_at_once(tmp_path: Path):
    text = MAIN.replace('"bot"', '"$(arg model)$(arg side)"').replace("$(arg effort)", "12")
    with pytest.raises(SourceError, match="Undefined substitution argument model") as raised:
        initialised(tmp_path, text)
    assert raised.value.hint.endswith("`--arg` of `init`; it also needs `side`")
    assert initialised(tmp_path, text, model="two", side="s").recipe.robot == "twos"


def test_arguments_are_for_a_xacro(robots: Path):
    with pytest.raises(UsageError, match="for a xacro file"):
        propose(robots / "four_legs.urdf", None, {}, {"a": "b"})


def test_a_xacro_that_calls_itself_urdf_is_one(tmp_path: Path):
    assert initialised(tmp_path, name="bot.urdf").recipe.source.xacro == "bot.urdf"


def test_a_urdf_that_only_declares_the_namespace_is_none(robots: Path, tmp_path: Path):
    dog = (robots / "four_legs.urdf").read_text().replace("<robot ", NAMESPACE, 1)
    assert proposed(dog, tmp_path).recipe.source.urdf == "robot.urdf"


@pytest.mark.parametrize("is_comment", [False, True])
def test_a_urdf_with_an_expression_in_a_value_is_a_xacro(is_comment: bool, tmp_path: Path):
    """Without a tag of xacro's; `<!-- ... -->` is what an expanded file may have kept of one."""
    limit = '<limit lower="-${pi}" effort="1" velocity="1"/>'
    swing = joint("swing", "world", "arm", content=limit)
    kept = f"<!-- {swing} -->" + joint("swing", "world", "arm") if is_comment else swing
    text = robot(link("world", ""), link("arm", inertial()), kept)
    assert bool(proposed(text, tmp_path).recipe.source.xacro) != is_comment


def test_a_urdf_that_defines_its_macro_is_a_xacro(tmp_path: Path):
    macro = '<xacro:macro name="tip"><link name="tip"/></xacro:macro><xacro:tip/></robot>'
    text = robot(link("a")).replace("<robot ", NAMESPACE).replace("</robot>", macro)
    with pytest.raises(SourceError, match="tip"):  # no joint holds it
        proposed(text, tmp_path)
