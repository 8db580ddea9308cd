"""`init` says of a robot's makers what package.xml says, and nothing that a template has left."""

from __future__ import annotations

from pathlib import Path

import pytest

from assetbuild.init.licence import stated_about

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
        "description": "The Arm 3 , with six joints & a gripper",
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


def test_of_a_long_description_the_first_sentence_is_taken(tmp_path: Path):
    said = "An arm. " + "It has many joints. " * 20
    assert about(tmp_path, f"<description>{said}</description>") == {"description": "An arm"}


def test_of_many_authors_the_first_is_named(tmp_path: Path):
    many = "".join(f"<author>Author Number {i}</author>" for i in range(40))
    assert about(tmp_path, many) == {"author": "Author Number 0 and 39 others"}
