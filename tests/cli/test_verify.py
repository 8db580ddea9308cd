"""`verify`: the bundle against its manifest and its provenance."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from .conftest import Place


@pytest.fixture
def legs(tmp_path: Path, built_legs: Place) -> Place:
    """A folder with a copy of the built bundle, and nothing else."""
    copy = Place(tmp_path, built_legs.store)
    shutil.copytree(built_legs.bundle, copy.bundle)
    return copy


def test_a_bundle_is_what_its_papers_say(legs: Place):
    done = legs.run("verify", "build/legs")
    assert (done.returncode, done.stderr) == (0, "")
    assert "0 differences (manifest, provenance)" in done.stdout


def change(path: str, how: Callable[[str], str]) -> Callable[[Place], None]:
    def do(legs: Place) -> None:
        file = legs.bundle / path
        file.write_text(how(file.read_text()))

    return do


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        (change("urdf/legs.urdf", lambda t: t + " "), "changed: urdf/legs.urdf"),
        (lambda legs: (legs.bundle / "NOTICE").unlink(), "missing: NOTICE"),
        (lambda legs: (legs.bundle / "mine").write_text("x"), "added: mine"),
        (lambda legs: (legs.bundle / "mine").symlink_to("/"), "added: mine"),
        (lambda legs: (legs.bundle / "provenance.json").unlink(), "missing: provenance.json"),
        (change("provenance.json", lambda t: "[" * 99_999), "not a provenance"),
        (change("provenance.json", lambda t: t.replace("slsa.dev", "x.org")), "SLSA's predicate"),
        (change("manifest.json", lambda t: t + "\n"), "not as the provenance says: manifest.json"),
    ],
)
def test_each_difference_is_named(legs: Place, fault: Callable[[Place], object], told: str):
    fault(legs)
    done = legs.run("verify", "build/legs")
    assert done.returncode == 1
    assert told in done.stdout


def test_provenance_names_recipe_source_and_tools_as_slsa_asks(legs: Place):
    statement = json.loads((legs.bundle / "provenance.json").read_text())
    needed = statement["predicate"]["buildDefinition"]["resolvedDependencies"]
    assert all("uri" in row or "digest" in row for row in needed)
    named = {row["name"] for row in needed if "name" in row}
    assert named == {"legs.yaml", "robot/four_legs.urdf"}
    packages = {row["uri"].partition("@")[0] for row in needed if "uri" in row}
    assert packages >= {"pkg:pypi/assetbuild", "pkg:pypi/lxml"}
    assert statement["predicate"]["runDetails"]["builder"]["id"].startswith("pkg:pypi/assetbuild@")


def test_what_is_no_bundle_is_a_wrong_command(legs: Place):
    assert legs.run("verify", "build").returncode == 2
    assert legs.run("verify", "absent").returncode == 2


@pytest.mark.parametrize(
    ("path", "verb", "code"),
    [
        ("manifest.json", ("verify",), 2),
        ("manifest.json", ("diff", "build/legs"), 2),
        ("provenance.json", ("verify",), 1),
        ("report/robot.json", ("validate",), 2),
        ("extra", ("validate",), 2),
        ("extra", ("diff", "build/legs"), 2),
    ],
)
def test_a_pipe_in_the_place_of_a_file_is_not_waited_for(
    legs: Place, path: str, verb: tuple[str, ...], code: int
):
    (legs.bundle / path).unlink(missing_ok=True)
    os.mkfifo(legs.bundle / path)
    done = legs.run(*verb, "build/legs")
    assert done.returncode == code
    assert path in done.stdout + done.stderr
