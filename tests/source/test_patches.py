"""A patch of the recipe repairs the source's text, exactly where it says, or stops the build."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from robot_files import edit, run_step
from urdfs import joint, link, robot

from assetbuild.cli.check import check
from assetbuild.errors import AssetBuildError, SourceError
from assetbuild.source.patch_text import PatchText

RECIPE = "schema: assetbuild/v1\nrobot: r\nsource:\n  path: src\n  {main}\n{keys}targets: [urdf]\n"
XACRO = "<robot name='r' xmlns:xacro='http://www.ros.org/wiki/xacro'>{}</robot>"


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "cache"))


def recipe(folder: Path, files: dict[str, str], *patches: str, main: str = "urdf: r.urdf") -> Path:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    rows = "".join(f"    - {patch}\n" for patch in patches)
    keys = f"  patches:\n{rows}" if patches else ""
    (folder / "r.yaml").write_text(RECIPE.format(main=main, keys=keys))
    return folder / "r.yaml"


def bad(mass: str = "heavy") -> str:
    return robot(link("a"), link("b"), joint("j", "a", "b")).replace(
        'value="1.0"', f'value="{mass}"'
    )


TWICE = '{file: r.urdf, find: "heavy", replace: "2", times: 2, because: a typo}'


def test_a_patch_mends_what_the_reader_refuses_and_is_reported(tmp_path: Path):
    with pytest.raises(SourceError, match="not a finite number"):
        check(recipe(tmp_path, {"src/r.urdf": bad()}))
    findings = check(recipe(tmp_path, {"src/r.urdf": bad()}, TWICE))
    (found,) = (f for f in findings if f.rule == "source.patch")
    assert found.message == "r.urdf:2: `heavy` was replaced by `2` 2 times: a typo"
    assert found.where == "r.yaml:6:3"


@pytest.mark.parametrize(
    ("find", "message"),
    [("heavi", "occurs nowhere in `r.urdf`, not once"), ("heavy", "occurs 2 times in `r.urdf`")],
)
def test_a_passage_that_is_not_there_once_stops_the_build(tmp_path: Path, find: str, message: str):
    patch = f'{{file: r.urdf, find: "{find}", replace: "2", because: a typo}}'
    with pytest.raises(AssetBuildError, match=message) as raised:
        check(recipe(tmp_path, {"src/r.urdf": bad()}, patch))
    assert (raised.value.where.line, raised.value.where.column) == (7, 7)


def test_a_patch_of_no_text_names_those_that_there_are(tmp_path: Path):
    patch = '{file: s.urdf, find: "a", replace: "b", because: a typo}'
    with pytest.raises(AssetBuildError, match=r"`s\.urdf` is no text") as raised:
        check(recipe(tmp_path, {"src/r.urdf": bad()}, patch))
    assert raised.value.hint == "known: `r.urdf`"


def test_a_diff_file_is_patches(tmp_path: Path):
    text = bad("1").replace("\n", "\n\n")
    old, new = text.splitlines()[2], text.splitlines()[2].replace('value="1"', 'value="7"')
    diff = f"--- a/r.urdf\n+++ b/r.urdf\n@@ -2,3 +2,3 @@\n \n-{old}\n+{new}\n \n"
    files = {"src/r.urdf": text, "fix.diff": diff}
    findings = check(recipe(tmp_path, files, "{diff: fix.diff, because: a typo}"))
    assert [f.data["line"] for f in findings if f.rule == "source.patch"] == [2]
    files["fix.diff"] = diff.replace(" \n", "")
    with pytest.raises(AssetBuildError, match="cut off"):
        check(recipe(tmp_path, files, "{diff: fix.diff, because: a typo}"))


@pytest.mark.parametrize("archived", [False, True])
def test_includes_of_a_xacro_are_patched(tmp_path: Path, archived: bool):
    parts = link("a") + link("b") + joint("j", "a", "b").replace("revolute", "hinge")
    files = {
        "src/r.xacro": XACRO.format("<xacro:include filename='more.gazebo'/>"),
        "src/more.gazebo": XACRO.format(parts),
        "src/mesh.stl": "no xacro reads this",
    }
    patch = '{file: more.gazebo, find: "hinge", replace: "revolute", because: no such type}'
    path = recipe(tmp_path, files, patch, main="xacro: r.xacro")
    if archived:
        shutil.make_archive(str(tmp_path / "src"), "zip", tmp_path / "src")
        edit(path, ("path: src", "path: src.zip"))
    assert "source.patch" in [f.rule for f in check(path)]


def test_includes_of_an_mjcf_are_patched(tmp_path: Path):
    files = {
        "src/r.xml": "<mujoco><include file='more.xml'/></mujoco>",
        "src/more.xml": "<mujoco><worldbody><body><geom type='ball' size='.1'/></body></worldbody>"
        "</mujoco>",
    }
    patch = "{file: more.xml, find: ball, replace: sphere, because: no such type}"
    check(recipe(tmp_path, files, patch, main="mjcf: r.xml"))


def test_line_ends_of_a_passage_follow_the_file(tmp_path: Path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in/text").write_bytes(b"one\r\ntwo\r\n")
    step = PatchText(file="r.urdf", find="one\ntwo", replace="1\n2", because="a test")
    run_step(step, tmp_path / "in", tmp_path / "out")
    assert (tmp_path / "out/text").read_bytes() == b"1\r\n2\r\n"


def test_a_patch_of_a_part_is_named_by_its_line(tmp_path: Path):
    path = recipe(tmp_path, {"src/r.urdf": bad("1")})
    patch = '{file: r.urdf, find: heavy, replace: "2", because: a typo}'
    part = f"{{path: src, urdf: r.urdf, patches: [{patch}]}}"
    path.write_text(
        path.read_text() + f"compose:\n  - as: up_\n    at: {{link: b}}\n    source: {part}\n"
    )
    with pytest.raises(AssetBuildError, match="occurs nowhere") as raised:
        check(path)
    assert raised.value.where.line == 10
