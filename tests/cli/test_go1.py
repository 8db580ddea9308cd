"""The main job on the real Go1, through the command line: what a user sees and relies on."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path

import mujoco
import pytest

from tests.benchmarks import beside_gold

from .conftest import Place, from_path

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.slow  # whole builds of a real robot
CONTROL_READERS = {
    "control", "state_ranges", "ratings", "mjcf", "mjx", "mjlab", "usd", "urdf", "pose",
}  # fmt: skip


def test_the_bundle_is_whole_and_verified_and_loads_wherever_it_is_moved(
    place: Place, tmp_path: Path
):
    place.ran()
    for path in (
        "manifest.json", "provenance.json", "NOTICE", "model_card.md", "urdf/go1.urdf",
        "mjcf/go1.xml", "mjcf/scene.xml", "usd/go1.usda", "report/index.html", "report/report.json",
        "report/report.md",
    ):  # fmt: skip
        assert (place.bundle / path).is_file(), path
    again = place.build()
    assert (again.returncode, again.stderr) == (0, "")
    assert "0 ran" in again.stdout
    report = json.loads((place.bundle / "report/report.json").read_text())
    assert report["verdict"]["ready"] is True
    assert {check["status"] for check in report["checks"].values()} <= {"pass", "skip"}
    moved = tmp_path / "elsewhere" / "robot of mine"
    shutil.copytree(place.bundle, moved)
    shutil.rmtree(place.bundle)
    model = mujoco.MjModel.from_xml_path(str(moved / "mjcf" / "scene.xml"))
    assert (model.nq, model.nv, model.nu, model.nkey) == (19, 18, 12, 2)
    assert place.run("verify", str(moved)).returncode == 0


def test_the_readme_shows_what_a_build_of_its_recipe_says(place: Place):
    place.recipe.write_text(from_path((ROOT / "recipes/go1_minimal.yaml").read_text()))
    done = place.build()
    shown = re.search(r"```text\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)[1]
    for line in shown.replace("\n    ", " ").splitlines():
        # A copy without its wheel, built without pictures, has more notes.
        start = line.rpartition(", ")[0] if "findings:" in line else line
        assert any(said.startswith(start) for said in done.stdout.splitlines()), line


def test_an_edit_runs_only_the_steps_that_read_what_changed(place: Place):
    """A comment in the URDF, a mesh saved anew with the same geometry, a gain in the recipe."""
    place.ran()
    before = _lines_of_findings(place)
    urdf = place.robot / "robots/go1_description/urdf/go1.urdf"
    first, rest = urdf.read_text().split("\n", 1)
    urdf.write_text(f"{first}\n<!-- a remark -->\n{rest}")
    assert place.ran() == {"read_urdf"}
    after = _lines_of_findings(place)
    assert before and all(after[key] == line + 1 for key, line in before.items())

    mesh = place.robot / "robots/go1_description/meshes/hip.dae"
    text = mesh.read_text(encoding="utf-8")
    mesh.write_text(re.sub(r"<modified>.*?</modified>", "<modified>2001-01-01T00:00:00</modified>",
                           text) + "\n<!-- saved anew -->\n", encoding="utf-8")  # fmt: skip
    companions = "mesh_companions robots/go1_description/meshes/hip.dae"
    assert place.ran() == {"convert_mesh hip", companions}  # both read the file

    place.edit("kp: 80", "kp: 90")
    ran = place.ran()
    assert {"control", "mjcf", "usd"} <= ran
    assert all(name in CONTROL_READERS or name.startswith("check ") for name in ran), ran
    assert not {"check urdf_equal", "check mjcf_meshes", "check oracle", "pictures"} & ran
    told = place.run("explain", "recipes/go1.yaml", "control").stdout
    assert re.search(r"rows\[0\]\.kp: 80(\.0)? -> 90", told), told


def test_every_difference_from_the_hand_made_model_of_menagerie_has_a_reason(
    place: Place, capsys: pytest.CaptureFixture[str]
):
    if not os.environ.get("ASSETBUILD_SHARED"):
        pytest.skip("the gold tables are not here: set ASSETBUILD_SHARED (docs/contributing.md)")
    place.ran()
    assert beside_gold.main(str(place.bundle)) == 0, capsys.readouterr().out


def _lines_of_findings(place: Place) -> dict[tuple[str, str], int]:
    report = json.loads((place.bundle / "report/report.json").read_text())
    return {
        (f["rule"], f["subject"]): int(f["where"].rsplit(":", 1)[1])
        for f in report["findings"]
        if f["where"].startswith("robots/")
    }
