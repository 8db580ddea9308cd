"""A four-bar whose loop only the recipe states builds as a user builds it; wrong loops do not."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from assetbuild.cli import main

from .conftest import Place

FOUR_BAR = Path(__file__).parents[1] / "writers"


@pytest.fixture
def four_bar(tmp_path: Path) -> Place:
    for name in ("four_bar.urdf", "four_bar.yaml"):
        shutil.copy(FOUR_BAR / name, tmp_path)
    return Place(tmp_path, tmp_path / "store", "four_bar.yaml")


@pytest.mark.slow  # a whole build, pictures and all
def test_a_four_bar_closes_in_every_format_that_holds_loops(four_bar: Place):
    four_bar.ran()
    report = json.loads((four_bar.bundle / "report/report.json").read_text())
    assert report["checks"]["loops"]["figures"]["largest_gap"] < 1e-4
    assert "urdf.loop" in {finding["rule"] for finding in report["findings"]}
    models = [
        mujoco.MjModel.from_xml_path(str(four_bar.bundle / f"mjcf/{name}.xml"))
        for name in ("four_bar_mjx", "four_bar_bare", "four_bar")
    ]
    assert [model.neq for model in models] == [1, 1, 1]
    model = models[-1]
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    ends = [data.site(f"coupler_loop_{end}").xpos for end in "ab"]
    assert np.linalg.norm(ends[0] - ends[1]) < 1e-9


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rocker, xyz: [0", "base, xyz: [1", "loops: `coupler_loop` cannot close: the nearest"),
        ("link: rocker", "link: rockr", "no link `rockr`\nhint: did you mean `rocker`"),
        ("[0.2, 0, 0]", "[.nan, 0, 0]", "loops[0].a.xyz[0]: must be finite"),
        ("kind: connect", "solimp: [1, 0.99, 0.001, 0.5, 2]", "solimp[0]: must be at most 0.9999"),
    ],
    ids=["cannot close", "no such link", "not a number", "impedance"],
)
def test_a_wrong_loop_is_one_error_with_its_line(
    four_bar: Place, old: str, new: str, message: str, capsys, monkeypatch
):
    monkeypatch.setenv("ASSETBUILD_CACHE", str(four_bar.store))
    four_bar.edit(old, new)
    assert main(["build", str(four_bar.recipe), "-o", str(four_bar.folder / "out")]) == 2
    said = capsys.readouterr().err
    assert "four_bar.yaml:" in said and message in said
    assert said.count("error: ") == 1 and "Traceback" not in said
    assert not (four_bar.folder / "out").exists()
