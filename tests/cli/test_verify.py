"""`verify`: the bundle against its manifest and its provenance."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from .conftest import LEGS_RECIPE, Place, new_legs


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory, legs_store: Path) -> Place:
    folder = tmp_path_factory.mktemp("verify")
    legs = new_legs(folder / "legs", shutil.copytree(legs_store, folder / "store"))
    assert legs.build().returncode == 0
    shutil.copytree(legs.bundle, folder / "as built")
    return legs


@pytest.fixture
def legs(built: Place) -> Place:
    """The built bundle, put right again before each test."""
    built.recipe.write_text(LEGS_RECIPE)
    shutil.rmtree(built.bundle)
    shutil.copytree(built.folder.parent / "as built", built.bundle)
    return built


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
    assert {row["name"] for row in needed if "name" in row} == {
        "legs.yaml",
        "robot/four_legs.urdf",
    }
    assert {row["uri"].partition("@")[0] for row in needed if "uri" in row} >= {
        "pkg:pypi/assetbuild",
        "pkg:pypi/lxml",
    }
    assert statement["predicate"]["runDetails"]["builder"]["id"].startswith("pkg:pypi/assetbuild@")


def test_what_is_no_bundle_is_a_wrong_command(legs: Place):
    assert legs.run("verify", "robot").returncode == 2
    assert legs.run("verify", "absent").returncode == 2
