"""`init` cuts a link with two parents where a driven joint stays, and the loop closes."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest
import yaml

from assetbuild.cli import main
from tests.source.test_second_parent import bar


def proposed(text: str, folder: Path) -> str:
    (folder / "bar.urdf").write_text(text)
    assert main(["init", str(folder / "bar.urdf"), "-o", str(folder / "bar.yaml")]) == 0
    return (folder / "bar.yaml").read_text()


@pytest.mark.slow
def test_the_loop_stands_in_the_recipe_and_its_bundle_closes(tmp_path: Path):
    recipe = yaml.safe_load(proposed(bar(drive="j4"), tmp_path))
    (loop,) = recipe["loops"]
    assert (loop["name"], loop["kind"], loop["axis"]) == ("j3", "hinge", [0, 1, 0])
    assert loop["a"] == {"link": "a", "xyz": [0, 0, 0.3]}
    assert loop["b"] == {"link": "b"}
    (patch,) = recipe["source"]["patches"]
    assert patch["find"].startswith('<joint name="j3"') and patch["replace"] == ""
    assert [row["joints"] for row in recipe["actuators"]] == ["j4", "j[12]"]
    main(["build", str(tmp_path / "bar.yaml"), "-o", str(tmp_path / "bar"), "--fail-on", "never"])
    model = mujoco.MjModel.from_xml_path(str(next(tmp_path.glob("bar*/mjcf/bar.xml"))))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert model.neq == 2
    assert abs(data.efc_pos[:6]).max() < 1e-9


def test_limits_that_no_loop_holds_are_said(tmp_path: Path):
    text = bar().replace('name="j4" type="continuous"', 'name="j4" type="revolute"')
    text = text.replace('<axis xyz="0 1 0"/></joint></robot>', LIMITED)
    assert "`j4` does not hold its limits -0.5 to 0.5" in proposed(text, tmp_path)


LIMITED = (
    '<axis xyz="0 1 0"/><limit lower="-0.5" upper="0.5" effort="0" velocity="1"/></joint></robot>'
)


def test_a_sliding_joint_is_refused_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "bar.urdf").write_text(bar("planar", drive="j3").replace("><", ">\n<"))
    assert main(["init", str(tmp_path / "bar.urdf"), "-o", str(tmp_path / "bar.yaml")]) == 2
    assert "already hangs on joint `j3`" in capsys.readouterr().err


def test_a_second_way_without_a_motion_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    text = bar("fixed", drive="j1").replace('"j2" type="continuous"', '"j2" type="fixed"')
    text = text.replace('"j3" type="continuous"', '"j3" type="fixed"')
    text = text.replace('"j1" type="revolute"', '"j1" type="fixed"')
    (tmp_path / "bar.urdf").write_text(text)
    assert main(["init", str(tmp_path / "bar.urdf"), "-o", str(tmp_path / "bar.yaml")]) == 2
    assert "already hangs on joint `j3`" in capsys.readouterr().err
