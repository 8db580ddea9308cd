"""Wrong input: one clear error with file, line and hint, the right exit code, no traceback."""

from __future__ import annotations

from pathlib import Path

import pytest

from .conftest import Workplace


def refused(place: Workplace, code: int, *parts: str, command: tuple[str, ...] = ()) -> str:
    """Build, expect one error with `parts` in it; the old bundle must be as it was."""
    before = _snapshot(place.bundle)
    words = command or ("build", "recipes/go1.yaml")
    done = place.run(*words)
    assert done.returncode == code, done.stdout + done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    assert done.stderr.count("error: ") == 1, done.stderr
    for part in parts:
        assert part in done.stderr, done.stderr
    assert _snapshot(place.bundle) == before
    return done.stderr


def _snapshot(folder: Path) -> dict[str, int]:
    return {str(p): p.stat().st_mtime_ns for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture
def built(place: Workplace) -> Workplace:
    assert place.build().returncode == 0
    return place


def test_a_misspelt_key(built: Workplace):
    built.edit_recipe("\nactuators:", "\nacutators:")
    refused(built, 2, "recipes/go1.yaml:", "acutators", "did you mean `actuators`?")


def test_a_joint_pattern_that_matches_nothing(built: Workplace):
    built.edit_recipe('".*_calf_joint", motor', '".*_knee_joint", motor')
    refused(built, 2, "recipes/go1.yaml:", "hint: ", "_calf_joint")


def test_a_joint_matched_twice(built: Workplace):
    built.edit_recipe('".*_(hip|thigh)_joint"', '".*_joint"')
    refused(built, 2, "recipes/go1.yaml:", "FR_calf_joint")


def test_a_missing_mesh(built: Workplace):
    (built.robot / "robots/go1_description/meshes/calf.dae").unlink()
    refused(built, 2, "go1.urdf:201", "calf.dae", "hint: ")


def test_a_cut_off_mesh(built: Workplace):
    mesh = built.robot / "robots/go1_description/meshes/calf.dae"
    mesh.write_bytes(mesh.read_bytes()[:100_000])
    refused(built, 1, "calf.dae", "hint: ")


def test_a_nan_in_an_inertia(built: Workplace):
    built.urdf.write_text(built.urdf.read_text().replace('ixx="0.0168128557"', 'ixx="nan"'))
    refused(built, 2, "go1.urdf:50", "trunk", "ixx", "nan", "hint: ")


def test_a_cut_off_description(built: Workplace):
    built.urdf.write_bytes(built.urdf.read_bytes()[:20_000])
    refused(built, 2, "go1.urdf:", "hint: ")


def test_no_such_recipe(place: Workplace):
    refused(place, 2, "recipes/go7.yaml", command=("build", "recipes/go7.yaml"))


def test_a_folder_that_is_no_bundle_is_never_replaced(place: Workplace):
    precious = place.folder / "precious"
    precious.mkdir()
    (precious / "thesis.tex").write_text("x")
    refused(place, 2, "precious", command=("build", "recipes/go1.yaml", "-o", "precious"))
    assert (precious / "thesis.tex").read_text() == "x"


def test_a_stale_lock_is_out_of_date(place: Workplace):
    place.edit_recipe("  path: ../robot\n", "  pypi: example-robot-data==6.0.0\n")
    lock = place.recipe.with_name("go1.lock.yaml")
    lock.write_text(
        "schema: assetbuild-lock/v1\nsource:\n  pypi: example-robot-data==5.0.0\n"
        f'  file: example_robot_data-5.0.0-py3-none-any.whl\n  sha256: "{"0" * 64}"\n  size: 1\n'
    )
    refused(place, 3, "go1.lock.yaml", "assetbuild lock", command=("check", "recipes/go1.yaml"))
    refused(place, 3, "go1.lock.yaml", command=("build", "--frozen", "recipes/go1.yaml"))
