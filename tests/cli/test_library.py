"""The library of robots: listed, built by name, copied to begin from."""

from __future__ import annotations

from pathlib import Path

import pytest

from assetbuild.cli import main
from assetbuild.cli.parser import file_or_robot
from assetbuild.library import robots


def test_every_robot_is_listed_with_a_sentence(capsys: pytest.CaptureFixture[str]):
    assert main(["list"]) == 0
    lines = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    recipes = Path(__file__).parents[2] / "recipes"
    assert lines.keys() == {path.stem for path in recipes.glob("*.yaml")} - {
        path.stem for path in recipes.glob("*.lock.yaml")
    }
    assert all(sentence.endswith(".") for sentence in lines.values())


def test_a_name_is_a_robot_of_the_library_unless_a_file_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    assert file_or_robot("go1") == robots()["go1"]
    assert file_or_robot("go1.yaml") == Path("go1.yaml")
    Path("go1").touch()
    assert file_or_robot("go1") == Path("go1")


def test_a_name_that_no_robot_has_is_told_with_the_nearest(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as ended:
        main(["build", "go2x"])
    assert ended.value.code == 2
    assert "the library has no robot `go2x`; did you mean `go2`?" in capsys.readouterr().err


def test_a_copied_recipe_is_whole_and_replaces_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """The rover carries another robot, and its source lies beside it."""
    monkeypatch.chdir(tmp_path)
    assert main(["init", "--from", "rover"]) == 0
    assert main(["check", "rover.yaml"]) == 0
    assert "# assetbuild build rover.yaml" in Path("rover.yaml").read_text()
    assert main(["init", "--from", "z1"]) == 2
    assert "`z1.yaml` exists" in capsys.readouterr().err
    assert main(["init", "--from", "z2"]) == 2
    assert main(["init"]) == 2
