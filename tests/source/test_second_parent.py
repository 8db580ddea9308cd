"""A link with two parents is refused, and the hint is the loop that takes a joint's place."""

from __future__ import annotations

from pathlib import Path

import pytest

from assetbuild.cli import main

INERTIA = """<inertial><origin xyz="0 0 .1"/><mass value="1"/>
<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>"""
PIN = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><origin xyz="{}"/>{}</joint>'
AXIS, DRIVEN = '<axis xyz="0 1 0"/>', '<limit lower="-1" upper="1" effort="5" velocity="3"/>'


def bar(last: str = "continuous", drive: str = "j3") -> str:
    """Four bars of 0.3 m and 0.4 m; `b` hangs on `a` by j3 and on `c` by j4."""
    links = "".join(f'<link name="{name}">{INERTIA}</link>' for name in ("base", "a", "c", "b"))

    def pin(name: str, parent: str, child: str, xyz: str, kind: str = "continuous") -> str:
        kind = "revolute" if name == drive else kind
        more = (AXIS if kind != "fixed" else "") + (DRIVEN if name == drive else "")
        return PIN.format(name, kind, parent, child, xyz, more)

    pins = [pin("j1", "base", "a", "0 0 0"), pin("j2", "base", "c", ".4 0 0")]
    pins += [pin("j3", "a", "b", "0 0 .3"), pin("j4", "c", "b", "-.4 0 .3", last)]
    return f'<robot name="bar">{links}{"".join(pins)}</robot>'


def hint(text: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    (folder / "bar.urdf").write_text(text)
    (folder / "bar.yaml").write_text(RECIPE)
    assert main(["check", str(folder / "bar.yaml")]) == 2
    said = capsys.readouterr().err
    assert "link `b` already hangs on joint `j3`" in said
    return said


@pytest.mark.parametrize(("drive", "cut"), [("j3", "j4"), ("j4", "j3"), ("j1", "j4")])
def test_the_driven_joint_stays(
    drive: str, cut: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert f"remove `{cut}` and write `loops:" in hint(bar(drive=drive), tmp_path, capsys)


def test_a_fixed_joint_becomes_a_weld(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert "kind: weld, a: {link: c, xyz: [-0.4, 0, 0.3]}" in hint(bar("fixed"), tmp_path, capsys)


RECIPE = """schema: assetbuild/v1
robot: bar
source: {path: ., urdf: bar.urdf}
base: fixed
actuators:
  - {joints: j3, model: pd, kp: 20, kd: 1, effort: 5}
  - {joints: "j[12]", model: passive}
simulation: {timestep: 0.002}
targets: [mjcf]
"""


def test_a_joint_whose_parent_hangs_on_the_link_itself_is_the_one_to_cut(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """Driven or not: without j3 nothing would hold b, which c hangs on."""
    text = bar(drive="j4").replace(
        '<parent link="base"/><child link="c"/>', '<parent link="b"/><child link="c"/>'
    )
    assert "remove `j4`" in hint(text, tmp_path, capsys)
