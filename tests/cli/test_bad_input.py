"""Wrong input: one clear error with file, line and hint, the right exit code, no traceback."""

from __future__ import annotations

from pathlib import Path

from .conftest import Place


def refused(legs: Place, code: int, command: str, *parts: str) -> None:
    """One error with `parts` in it; a bundle that is there stays as it was."""
    before = _snapshot(legs.bundle)
    done = legs.run(*command.split())
    assert done.returncode == code, done.stdout + done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    assert done.stderr.count("error: ") == 1, done.stderr
    for part in parts:
        assert part in done.stderr, done.stderr
    assert _snapshot(legs.bundle) == before


def _snapshot(folder: Path) -> dict[str, int]:
    return {str(p): p.stat().st_mtime_ns for p in sorted(folder.rglob("*")) if p.is_file()}


def test_a_missing_mesh(built_legs: Place):
    assert built_legs.manifest()
    shown = '</inertial><visual><geometry><mesh filename="trunk.stl"/></geometry></visual>'
    built_legs.urdf.write_text(built_legs.urdf.read_text().replace("</inertial>", shown, 1))
    refused(built_legs, 2, "build legs.yaml", "four_legs.urdf:4", "trunk.stl", "hint: ")


def test_a_stale_lock_is_out_of_date(legs: Place):
    legs.edit("path: robot", "pypi: example-robot-data==6.0.0")
    legs.recipe.with_name("legs.lock.yaml").write_text(
        "schema: assetbuild-lock/v1\nsource:\n  pypi: example-robot-data==5.0.0\n"
        f'  file: example_robot_data-5.0.0-py3-none-any.whl\n  sha256: "{"0" * 64}"\n  size: 1\n'
    )
    refused(legs, 3, "check legs.yaml", "legs.lock.yaml", "assetbuild lock")
    refused(legs, 3, "build --frozen legs.yaml", "legs.lock.yaml")
