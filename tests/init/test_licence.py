"""`init` states the licence that the source's own files state, and no other."""

from __future__ import annotations

from pathlib import Path

import pytest

from assetbuild.init.draft import Draft
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


def package(said: str) -> str:
    return f"<package><license>{said}</license></package>"


APACHE = "Apache License\n   Version 2.0, January 2004"
SHARE_ALIKE = "Attribution-ShareAlike 4.0 International\n====="
TODO = package("TODO: License declaration")
UNKNOWN = "no file of the source states a known one"
# Files of the source | what the recipe says of it.
STATED = {
    "a text at the root": ({"LICENSE": APACHE}, "Apache-2.0   # as LICENSE says"),
    "the text nearest to the robot": (
        {"LICENSE": APACHE, "arm/LICENSE.txt": MIT}, "MIT   # as LICENSE.txt says"),
    "a licence for works": (
        {"arm/LICENSE.txt": SHARE_ALIKE}, "CC-BY-SA-4.0   # as LICENSE.txt says"),
    "Apache": ({"package.xml": package("Apache 2.0")}, "Apache-2.0   # as package.xml says"),
    "BSD": ({"package.xml": package("BSD-3-Clause")}, "BSD-3-Clause   # as package.xml says"),
    "MIT": ({"package.xml": package("MIT")}, "MIT   # as package.xml says"),
    "a package that still says TODO": (
        {"arm/package.xml": TODO, "LICENSE": MIT}, "MIT   # as LICENSE says"),
}  # fmt: skip
UNSTATED = {
    "nothing": ({}, UNKNOWN),
    "TODO": ({"arm/package.xml": TODO}, UNKNOWN),
    "a name of several licences": ({"package.xml": package("BSD")}, "BSD"),
    "no licence that is known": ({"package.xml": package("proprietary")}, "proprietary"),
    "two": ({"package.xml": package("MIT</license><license>Apache-2.0")}, "MIT"),
}


@pytest.mark.parametrize("case", [*STATED, *UNSTATED])
def test_a_licence_is_claimed_where_one_is_stated(case: str, robot: Path):
    """Others are quoted, and nothing is there to uncomment."""
    files, words = (STATED | UNSTATED)[case]
    for name, text in files.items():
        (robot / name).write_text(text)
    said = lines(robot)
    claimed = [line for line in said.splitlines() if line.strip().startswith("license:")]
    assert words in ("".join(claimed) if case in STATED else said)
    assert len(claimed) == (case in STATED)
    assert case != "nothing" or "MIT" not in said


def test_a_text_above_the_source_does_not_come_along_and_the_recipe_says_so(robot: Path):
    (robot / "LICENSE").write_text(MIT)
    draft = Draft()
    put_licence(draft, robot / "arm", "urdf/arm.urdf")
    (line,) = (line for line in draft.text.splitlines() if "license:" in line)
    assert line.endswith("as ../LICENSE says; only a copy below `path` comes into the bundle")
