"""Edits in a recipe: done in order, and wrong ones are told with their line."""

from __future__ import annotations

from pathlib import Path

import pytest
from source.test_source import URDF

from assetbuild.cli.check import check
from assetbuild.errors import RecipeError

HEAD = "schema: assetbuild/v1\nrobot: r\nsource: {path: ., urdf: r.urdf, license: MIT}\nedits:\n"


@pytest.fixture(autouse=True)
def own_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "store"))


def findings(folder: Path, *edits: str):
    (folder / "r.urdf").write_text(URDF)
    path = folder / "r.yaml"
    path.write_text(HEAD + "".join(f"  - {edit}\n" for edit in edits))
    return check(path)


def test_an_edit_sees_the_names_that_the_one_before_gave(tmp_path):
    found = findings(tmp_path, "rename: {links: {tip: hand}}", "set_mass: {link: hand, mass: 3}")
    assert {f.subject for f in found if f.rule.startswith("edit")} == {"link hand"}
    line = next(n for n, text in enumerate(URDF.splitlines(), 1) if '"tip"' in text)
    assert {f.where for f in found if f.subject == "link hand"} == {f"r.urdf:{line}"}


@pytest.mark.parametrize(
    ("edit", "place", "said"),
    [
        ("set_mas: {link: tip}", "5:5", "set_mas: unknown key"),
        ("set_mass: {link: tip}", "5:5", "missing key `mass`"),
        ("set_mass: {link: tip, mass: -1}", "5:33", "greater than 0"),
        ("set_mass: {link: tip, mas: 1}", "5:27", "unknown key"),
        ("set_mass: {link: tipp, mass: 1}", "5:16", "matches no link"),
        ("rename: {joints: {nobody: a}}", "5:23", "matches no joint"),
        ("rename: {links: {'.*': a}}", "5:5", "would both be called `a`"),
        ("set_limits: {joint: j}", "5:5", "at least one of"),
        ("inertia_from_geometry: {link: tip}", "5:5", "exactly one of `density`, `mass`"),
        (
            "{set_mass: {link: tip, mass: 1}, rename: {joints: {a: b}}}",
            "5:5",
            "one name and its keys",
        ),
    ],
)
def test_a_wrong_edit_is_told_with_its_line(tmp_path, edit, place, said):
    with pytest.raises(RecipeError) as caught:
        findings(tmp_path, edit)
    assert str(caught.value.where).endswith(f"r.yaml:{place}"), caught.value
    assert said in caught.value.message


@pytest.mark.parametrize("edit", ["rename: {links: {a: b}}", "flip_axis: {joint: j}"])
def test_names_and_axes_of_an_mjcf_change_in_the_mjcf(tmp_path, edit):
    path = tmp_path / "r.yaml"
    path.write_text(HEAD.replace("urdf: r.urdf", "mjcf: r.xml") + f"  - {edit}\n")
    with pytest.raises(RecipeError, match="of a robot from MJCF"):
        check(path)


def test_a_motor_that_is_not_there_is_told_before_anything_is_read(tmp_path):
    path = tmp_path / "r.yaml"
    path.write_text(
        HEAD.replace("urdf: r.urdf", "mjcf: r.xml").removesuffix("edits:\n")
        + "motors: {arm: {extends: hand}}\n"
        + "actuators: [{joints: a, motor: arm, model: pd}, {joints: b, motor: leg, model: pd}]\n"
    )
    with pytest.raises(RecipeError) as caught:
        check(path)
    assert {(each.message, each.where.line) for each in caught.value.each()} == {
        ("motors.arm: no motor named `hand`", 4),
        ("actuators[1]: no motor named `leg`", 5),
    }
