"""`diff`, `doctor`, `completion`: as a user runs them."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from assetbuild.cli import main
from assetbuild.cli.bench import front
from assetbuild.cli.diff import _checked_out
from assetbuild.cli.doctor import examine
from assetbuild.cli.parser import file_or_robot
from assetbuild.errors import UsageError
from assetbuild.library import robots

from .conftest import Place


def test_doctor_names_each_thing_once_and_says_how_to_get_what_is_missing():
    rows = list(examine())
    assert len({row.name for row in rows}) == len(rows)
    assert {"libraries", "store", "Landlock", "pictures", "3D view"} <= {row.name for row in rows}
    assert all(row.fix for row in rows if row.level != "ok")


@pytest.mark.parametrize(
    ("asked", "answer", "name", "fix"),
    [
        ("os.access", False, "store", "ASSETBUILD_CACHE"),  # root may write anywhere
        ("assetbuild.rendering.plan.renderer", "none", "pictures", "libegl1"),
    ],
)
def test_doctor_says_what_mends_a_machine(asked, answer, name, fix, monkeypatch):
    monkeypatch.setattr(asked, lambda *_: answer)
    (row,) = [row for row in examine() if row.name == name]
    assert row.level == "missing" and fix in row.fix


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, in which the user stands."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "tcsh"])
def test_a_shell_has_a_script_that_knows_verbs_options_and_their_values(shell: str, capsys):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert all(word in script for word in ("validate", "markdown", "fail-on", "never"))


def test_diff_of_what_is_not_there_is_a_usage_error(capsys):
    assert main(["diff", "no_such", "no_such"]) == 2
    assert "there is no `no_such`" in capsys.readouterr().err


def test_diff_says_by_its_exit_code_whether_anything_differs(tmp_path: Path, robots: Path, capsys):
    same = str(robots / "four_legs.urdf")
    other = tmp_path / "other.urdf"
    text = Path(same).read_text()
    assert 'mass value="' in text
    other.write_text(text.replace('mass value="', 'mass value="9', 1))
    assert main(["diff", same, same, "--exit-code"]) == 0
    assert main(["diff", same, str(other), "--exit-code"]) == 1
    assert main(["diff", same, str(other)]) == 0
    assert "CRITICAL" in capsys.readouterr().out


@pytest.mark.parametrize("verb", ["build", "lock"])
def test_all_files_of_the_folder_name_each_recipe_once(warm_legs: Place, verb: str):
    """A shell turns `*.yaml` into recipes and locks alike."""
    (warm_legs.folder / "legs.lock.yaml").write_text("schema: assetbuild-lock/v1\n")
    words = ["legs.lock.yaml", "legs.yaml"]
    done = warm_legs.run(verb, *words)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("legs.yaml: ") <= 1


def test_check_names_what_each_warning_is_about(legs: Place):
    """Also where no line of the recipe's own source says it: of the parts of a composite."""
    legs.urdf.write_text(legs.urdf.read_text().replace('mass value="6"', 'mass value="1e-9"', 1))
    assert ": link trunk: " in legs.run("check", "legs.yaml").stdout


def test_two_recipes_are_one_graph_and_share_their_steps(warm_legs: Place):
    other = warm_legs.folder / "other.yaml"
    other.write_text(warm_legs.recipe.read_text().replace("robot: legs", "robot: other", 1))
    done = warm_legs.build("other.yaml", "-j2")
    assert done.returncode == 0, done.stdout + done.stderr
    asked = warm_legs.run("explain", "legs.yaml", "build/legs/urdf/legs.urdf")
    assert asked.stdout.startswith("urdf: up to date"), asked
    places = [warm_legs, Place(warm_legs.folder, warm_legs.store, "other.yaml")]
    for place in places:
        assert place.steps()["read_urdf"] == "cached"
        assert place.manifest()
    assert "0 ran" in warm_legs.build().stdout

    before = [place.bundle.stat().st_ino for place in places]
    other.write_text(other.read_text() + "# a word\n")
    assert warm_legs.build("other.yaml", "-j2").returncode == 0
    after = [place.bundle.stat().st_ino for place in places]
    assert after[0] == before[0]
    assert after[1] != before[1]  # its provenance names the recipe's digest


def test_two_recipes_of_one_robot_are_refused(legs: Place):
    (legs.folder / "again.yaml").write_text(legs.recipe.read_text())
    told = legs.refused("build", "legs.yaml", "again.yaml")
    assert "two of the recipes build `legs`" in told


@pytest.mark.slow
def test_every_step_gives_the_same_bytes_twice(warm_legs: Place):
    done = warm_legs.build("--rebuild-check")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "legs: reproducible: every step gave the same bytes twice" in done.stdout
    assert not (warm_legs.folder / "build/legs.rebuild-check").exists()


def test_every_robot_is_listed_with_a_sentence(capsys: pytest.CaptureFixture[str]):
    assert main(["list"]) == 0
    lines = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    recipes = Path(__file__).parents[2] / "recipes"
    assert lines.keys() == {path.stem for path in recipes.glob("*.yaml")} - {
        path.stem for path in recipes.glob("*.lock.yaml")
    }
    assert all(sentence.endswith(".") for sentence in lines.values())


def test_a_name_is_a_robot_of_the_library_unless_a_file_has_it(here: Path):
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
    here: Path, capsys: pytest.CaptureFixture[str]
):
    """The rover carries another robot, and its source lies beside it."""
    assert main(["init", "--from", "rover"]) == 0
    assert main(["check", "rover.yaml"]) == 0
    assert "# assetbuild build rover.yaml" in Path("rover.yaml").read_text()
    assert main(["init", "--from", "go2"]) == 0  # its variants have parts
    assert main(["check", "go2.yaml"]) == 0
    assert main(["init", "--from", "z1"]) == 2
    assert "`z1.yaml` exists" in capsys.readouterr().err
    assert main(["init", "--from", "rover", "-o", "cart.yaml"]) == 0  # what it names is there
    Path("z1.yaml").write_text("mine")
    assert main(["init", "--from", "rover", "-o", "other.yaml"]) == 2
    assert not Path("other.yaml").exists()
    assert main(["init", "--from", "z1", "--force"]) == 0
    assert Path("z1.yaml").read_text() != "mine"
    assert main(["init", "--from", "z1", "-o", "z1.yaml/x.yaml"]) == 1
    assert "cannot read or write `z1.yaml`: File exists" in capsys.readouterr().err
    assert main(["init", "--from", "z2"]) == 2
    assert main(["init"]) == 2


def test_a_copied_recipe_is_printed_on_request(here: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["init", "--from", "z1", "-o", "-"]) == 0
    assert "# assetbuild build z1.yaml" in capsys.readouterr().out
    assert not list(here.iterdir())


def test_what_another_beats_in_both_is_not_on_the_front():
    points = {"hull": (4e4, 0.5), "good": (2e4, 0.9), "bad": (1.5e4, 0.8), "slow": (5e3, 0.9)}
    assert front(points) == {"hull", "good"}
    assert front({"a": (1.0, 1.0), "b": (1.0, 1.0)}) == {"a", "b"}


def test_a_recipe_of_a_revision_is_named_as_git_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """From the top folder, or with `./` and `../` from where the user stands."""
    (tmp_path / "recipes").mkdir()
    (tmp_path / "top.yaml").touch()
    (tmp_path / "recipes/arm.yaml").touch()
    for words in (["init", "-q"], ["add", "."], ["commit", "-qm", "one"]):
        git = ["git", "-c", "user.name=a", "-c", "user.email=a@example.org"]
        subprocess.run([*git, *words], cwd=tmp_path, check=True)
    monkeypatch.chdir(tmp_path / "recipes")
    for number, name in enumerate(("recipes/arm.yaml", "./arm.yaml", "../top.yaml", "top.yaml")):
        assert _checked_out("HEAD", name, tmp_path / str(number)).name == name.split("/")[-1]
    with pytest.raises(UsageError, match=r"no `recipes/top\.yaml`"):
        _checked_out("HEAD", "./top.yaml", tmp_path / "other")
