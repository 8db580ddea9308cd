"""`init` states the licence and the makers that the source's own files state, and no others."""

from __future__ import annotations

from pathlib import Path

import pytest

from assetbuild.init.draft import Draft
from assetbuild.init.licence import put_licence, stated_about, stated_licence

MIT = "MIT License\n\nPermission is hereby granted, free of charge, to any person obtaining a copy"


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """The root of a source with `arm/urdf/arm.urdf`."""
    (tmp_path / "arm/urdf").mkdir(parents=True)
    (tmp_path / "arm/urdf/arm.urdf").write_text("<robot/>")
    (tmp_path / ".git").mkdir()
    return tmp_path


def lines(root: Path) -> str:
    """What stands in the recipe."""
    draft = Draft()
    put_licence(draft, root, "arm/urdf/arm.urdf")
    return draft.text.strip()


def test_the_text_nearest_to_the_robot_counts(robot: Path):
    (robot / "LICENSE").write_text("Apache License\n   Version 2.0, January 2004")
    assert "license: Apache-2.0   # as LICENSE says" in lines(robot)
    (robot / "arm/LICENSE.txt").write_text(MIT)
    assert "license: MIT   # as LICENSE.txt says" in lines(robot)


@pytest.mark.parametrize(
    ("said", "spdx"),
    [("Apache 2.0", "Apache-2.0"), ("BSD-3-Clause", "BSD-3-Clause"), ("MIT", "MIT")],
)
def test_package_xml_states_it(robot: Path, said: str, spdx: str):
    (robot / "package.xml").write_text(f"<package><license>{said}</license></package>")
    assert f"license: {spdx}   # as package.xml says" in lines(robot)


@pytest.mark.parametrize("said", ["BSD", "TODO: License declaration", "proprietary"])
def test_words_that_name_no_one_licence_are_quoted_and_not_claimed(robot: Path, said: str):
    (robot / "package.xml").write_text(f"<package><license>{said}</license></package>")
    assert said in lines(robot)
    assert not any(line.strip().startswith("license:") for line in lines(robot).splitlines())


def test_a_source_that_states_none_gets_no_placeholder_to_uncomment(robot: Path):
    assert "MIT" not in lines(robot)
    assert "no file of the source states one" in lines(robot)


SAID = """<package><name>arm</name>
  <!-- <author>Nobody</author> -->
  <description>The <b>Arm 3</b>, with six
    joints &amp; a gripper</description>
  <author email="a@b.c">Ada B</author><author>Café Robotics</author><author>Ada B</author>
</package>"""


def about(folder: Path, package: str) -> dict[str, str]:
    (folder / ".git").mkdir()
    (folder / "arm/urdf").mkdir(parents=True)
    (folder / "arm/package.xml").write_text(package)
    return stated_about(folder, "arm/urdf/arm.urdf")


def test_author_and_description_are_those_of_the_package(tmp_path: Path):
    assert about(tmp_path, SAID) == {
        "author": "Ada B, Café Robotics",
        "description": "The Arm 3, with six joints & a gripper",
    }


@pytest.mark.parametrize(
    "left",
    [
        "<author>TODO</author><description>TODO: Package description</description>",
        "<description>The arm_description package</description>",
        "<author> </author>",
        "<description>" + "word " * 100 + "</description>",
        "",
    ],
)
def test_what_a_template_has_left_is_nothing(tmp_path: Path, left: str):
    assert about(tmp_path, f"<package>{left}</package>") == {}


def test_of_several_licences_the_one_behind_the_robots_own_folder_counts(robot: Path):
    text = "<license>MIT</license><!-- for: - arm\n - leg --> <license>Apache-2.0</license>"
    (robot / "package.xml").write_text(f"<package>{text}</package>")
    stated = stated_licence(robot, "arm/urdf/arm.urdf")
    assert stated is not None and stated[0] == "Apache-2.0"
    (robot / "package.xml").write_text(f"<package>{text.replace('arm', 'hand')}</package>")
    stated = stated_licence(robot, "arm/urdf/arm.urdf")
    assert stated is not None and stated[0] == "", "MIT or Apache-2.0? nobody knows"
