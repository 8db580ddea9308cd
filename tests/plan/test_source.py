"""Where a robot may come from, as far as `check` looks: every kind gives the same links."""

from __future__ import annotations

from pathlib import Path

import pytest

from assetbuild.errors import RecipeError, SourceError
from assetbuild.pipeline import check

URDF = """<robot name="r">
  <link name="base"><inertial><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tip"><inertial><mass value="1"/>
    <inertia ixx="0.1" iyy="0.1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j" type="continuous"><parent link="base"/><child link="tip"/></joint>
</robot>
"""
XACRO = """<robot name="r" xmlns:xacro="http://wiki.ros.org/xacro">
  <xacro:arg name="mass" default="0"/>
  <xacro:include filename="$(find arm)/parts/tip.xacro"/>
  <link name="base"/>
  <joint name="j" type="continuous"><parent link="base"/><child link="tip"/></joint>
</robot>
"""
TIP = """<robot xmlns:xacro="http://wiki.ros.org/xacro">
  <link name="tip"><inertial><mass value="$(arg mass)"/>
    <inertia ixx="0.1" iyy="0.1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
"""


@pytest.fixture(autouse=True)
def own_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "store"))


def recipe(folder: Path, source: str) -> Path:
    path = folder / "r.yaml"
    path.write_text(f"schema: assetbuild/v1\nrobot: r\nsource: {{{source}, license: MIT}}\n")
    return path


def rules(findings) -> set[str]:
    """What the planted defect (izz > ixx + iyy on `tip`) is told as."""
    return {f"{f.rule} {f.subject}" for f in findings if f.rule.startswith("inertia")}


def test_a_xacro_is_expanded_and_its_lines_are_those_of_the_urdf(tmp_path):
    robot = tmp_path / "robot"
    (robot / "parts").mkdir(parents=True)
    (robot / "r.xacro").write_text(XACRO)
    (robot / "parts/tip.xacro").write_text(TIP)
    source = "path: robot, xacro: r.xacro, args: {mass: 1.5}, packages: {arm: .}"
    findings = check(recipe(tmp_path, source))
    assert "inertia.triangle link tip" in rules(findings)
    (tip,) = {f.where for f in findings if f.rule == "inertia.triangle"}
    assert tip.startswith("r.xacro (expanded):")


def test_a_xacro_may_not_look_beside_its_packages(tmp_path):
    robot = tmp_path / "robot"
    (robot / "xacro").mkdir(parents=True)
    (robot / "other").mkdir()
    (robot / "other/tip.xacro").write_text(TIP)
    (robot / "xacro/r.xacro").write_text(XACRO.replace("$(find arm)/parts", "../other"))
    source = "path: robot, xacro: xacro/r.xacro"
    with pytest.raises(SourceError, match=r"no file `other/tip\.xacro`") as caught:
        check(recipe(tmp_path, source))
    assert "source.packages" in caught.value.hint


def test_arguments_need_a_xacro(tmp_path):
    with pytest.raises(RecipeError, match="`args` are for a `xacro`"):
        check(recipe(tmp_path, "path: robot, urdf: r.urdf, args: {a: 1}"))
