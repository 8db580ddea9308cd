"""`init` states the licence that the source's own files state, and no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from assetbuild.init.draft import Draft
from assetbuild.init.licence import stated_licence
from assetbuild.init.sections import put_licence

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
    (robot / "arm/LICENSE.txt").write_text("Attribution-ShareAlike 4.0 International\n=====")
    assert "license: CC-BY-SA-4.0   # as LICENSE.txt says" in lines(robot)


def test_a_text_above_the_source_does_not_come_along_and_the_recipe_says_so(robot: Path):
    (robot / "LICENSE").write_text(MIT)
    draft = Draft()
    put_licence(draft, robot / "arm", "urdf/arm.urdf")
    (line,) = (line for line in draft.text.splitlines() if "license:" in line)
    assert line.endswith("as ../LICENSE says; only a copy below `path` comes into the bundle")


@pytest.mark.parametrize(
    ("said", "spdx"),
    [("Apache 2.0", "Apache-2.0"), ("BSD-3-Clause", "BSD-3-Clause"), ("MIT", "MIT")],
)
def test_package_xml_states_it(robot: Path, said: str, spdx: str):
    (robot / "package.xml").write_text(f"<package><license>{said}</license></package>")
    assert f"license: {spdx}   # as package.xml says" in lines(robot)


def test_a_package_that_still_says_todo_states_nothing(robot: Path):
    text = "<package><license>TODO: License declaration</license></package>"
    (robot / "arm/package.xml").write_text(text)
    assert "no file of the source states a known one" in lines(robot)
    (robot / "LICENSE").write_text(MIT)
    assert "license: MIT   # as LICENSE says" in lines(robot)


@pytest.mark.parametrize("said", ["BSD", "proprietary"])
def test_words_that_name_no_one_licence_are_quoted_and_not_claimed(robot: Path, said: str):
    (robot / "package.xml").write_text(f"<package><license>{said}</license></package>")
    assert said in lines(robot)
    assert not any(line.strip().startswith("license:") for line in lines(robot).splitlines())


def test_a_source_that_states_none_gets_no_placeholder_to_uncomment(robot: Path):
    assert "MIT" not in lines(robot)
    assert "no file of the source states a known one" in lines(robot)


def test_of_several_licences_none_is_claimed(robot: Path):
    text = "<license>MIT</license><license>Apache-2.0</license>"
    (robot / "package.xml").write_text(f"<package>{text}</package>")
    stated = stated_licence(robot, "arm/urdf/arm.urdf")
    assert stated is not None and stated[0] == "", "MIT or Apache-2.0? nobody knows"
