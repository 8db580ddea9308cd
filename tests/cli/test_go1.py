"""The main job on the real Go1, through the command line: what a user sees and relies on."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from pathlib import Path

import pytest

from .conftest import Workplace

pytestmark = pytest.mark.slow  # whole builds of a real robot
CONTROL_READERS = {
    "control",
    "state_ranges",
    "ratings",
    "mjcf",
    "mjx",
    "mjlab",
    "usd",
    "urdf",
    "pose",
}


def test_the_bundle_is_whole_and_matches_its_manifest(place: Workplace):
    done = place.build()
    assert done.returncode == 0, done.stdout + done.stderr
    for path in (
        "manifest.json", "provenance.json", "NOTICE", "model_card.md", "urdf/go1.urdf",
        "mjcf/go1.xml", "mjcf/scene.xml", "usd/go1.usda", "report/index.html", "report/report.json",
        "report/report.md",
    ):  # fmt: skip
        assert (place.bundle / path).is_file(), path
    manifest = json.loads((place.bundle / "manifest.json").read_text())
    for row in manifest["files"]:
        data = (place.bundle / row["path"]).read_bytes()
        assert hashlib.sha256(data).hexdigest() == row["sha256"], row["path"]
        assert len(data) == row["size"]
    again = place.build()
    assert (again.returncode, again.stderr) == (0, "")
    assert "0 ran" in again.stdout
    verified = place.run("verify", "build/go1")
    assert verified.returncode == 0, verified.stdout
    report = json.loads((place.bundle / "report/report.json").read_text())
    assert report["verdict"]["ready"] is True
    assert {check["status"] for check in report["checks"].values()} <= {"pass", "skip"}


def test_a_new_gain_runs_only_what_reads_actuators(place: Workplace):
    place.build()
    place.edit_recipe("kp: 80", "kp: 90")
    done = place.build()
    assert done.returncode == 0, done.stdout + done.stderr
    ran = place.ran()
    assert {"control", "mjcf", "usd"} <= ran
    assert all(name in CONTROL_READERS or name.startswith("check ") for name in ran), ran
    assert "check urdf_equal" not in ran
    told = place.run("explain", "recipes/go1.yaml", "control").stdout
    assert re.search(r"rows\[0\]\.kp: 80(\.0)? -> 90", told), told


def test_a_comment_in_the_urdf_runs_only_the_reader_and_moves_the_lines(place: Workplace):
    place.build()
    before = _lines_of_findings(place)
    lines = place.urdf.read_text().split("\n")
    place.urdf.write_text("\n".join([lines[0], "<!-- a remark -->", *lines[1:]]))
    done = place.build()
    assert done.returncode == 0, done.stdout + done.stderr
    assert place.ran() == {"read_urdf"}
    after = _lines_of_findings(place)
    assert before and all(after[key] == line + 1 for key, line in before.items())


def test_a_mesh_saved_anew_with_the_same_geometry_runs_only_its_conversion(place: Workplace):
    place.build()
    mesh = place.robot / "robots/go1_description/meshes/hip.dae"
    text = mesh.read_text(encoding="utf-8")
    mesh.write_text(re.sub(r"<modified>.*?</modified>", "<modified>2001-01-01T00:00:00</modified>",
                           text) + "\n<!-- saved anew -->\n", encoding="utf-8")  # fmt: skip
    done = place.build()
    assert done.returncode == 0, done.stdout + done.stderr
    companions = "mesh_companions robots/go1_description/meshes/hip.dae"
    assert place.ran() == {"convert_mesh hip", companions}  # both read the file


def test_another_folder_seed_zone_and_job_count_give_the_same_manifest(
    cold_place: Workplace, place: Workplace
):
    odd = {"PYTHONHASHSEED": "7", "TZ": "Asia/Kathmandu", "LANG": "tr_TR.UTF-8", "LC_ALL": "C"}
    kernels = {"OPENBLAS_CORETYPE": "Zen", "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL"}
    done = cold_place.build("-j1", **odd, **kernels)
    assert done.returncode == 0, done.stdout + done.stderr
    place.build(PYTHONHASHSEED="1", TZ="UTC")
    manifests = [p.bundle / "manifest.json" for p in (cold_place, place)]
    assert manifests[0].read_bytes() == manifests[1].read_bytes()


def test_what_the_user_edited_in_the_bundle_is_kept_aside_and_restored(place: Workplace):
    place.build()
    model = place.bundle / "mjcf/go1.xml"
    original = model.read_bytes()
    model.write_bytes(original + b"<!-- mine -->")
    done = place.build()
    assert done.returncode == 0
    assert "mjcf/go1.xml" in done.stdout
    assert model.read_bytes() == original
    kept = place.bundle.with_name("go1.edited") / "mjcf/go1.xml"
    assert kept.read_bytes().endswith(b"<!-- mine -->")


def test_a_bundle_that_was_moved_still_loads(place: Workplace, tmp_path: Path):
    import mujoco

    place.build()
    moved = tmp_path / "elsewhere" / "robot of mine"
    shutil.copytree(place.bundle, moved)
    shutil.rmtree(place.bundle)
    model = mujoco.MjModel.from_xml_path(str(moved / "mjcf" / "scene.xml"))
    assert (model.nq, model.nv, model.nu, model.nkey) == (19, 18, 12, 2)


def _lines_of_findings(place: Workplace) -> dict[tuple[str, str], int]:
    report = json.loads((place.bundle / "report/report.json").read_text())
    return {
        (f["rule"], f["subject"]): int(f["where"].rsplit(":", 1)[1])
        for f in report["findings"]
        if f["where"].startswith("robots/")
    }
