"""`diff`, `doctor`, `completion`: as a user runs them."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from assetbuild.cli import main
from assetbuild.cli.doctor import examine

from .conftest import Legs


def test_doctor_names_each_thing_once_and_says_how_to_get_what_is_missing():
    rows = list(examine())
    assert len({row.name for row in rows}) == len(rows)
    assert {"libraries", "store", "Landlock", "pictures", "3D view"} <= {row.name for row in rows}
    assert all(row.fix for row in rows if row.level != "ok")


def test_doctor_tells_a_store_that_cannot_be_written_to(monkeypatch, tmp_path: Path):
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path))
    monkeypatch.setattr("os.access", lambda *_: False)  # root may write anywhere
    (store,) = [row for row in examine() if row.name == "store"]
    assert store.level == "missing" and "ASSETBUILD_CACHE" in store.fix


def test_doctor_without_opengl_names_the_package(monkeypatch):
    monkeypatch.setattr("assetbuild.looks.plan.renderer", lambda _: "none")
    (pictures,) = [row for row in examine() if row.name == "pictures"]
    assert pictures.level == "missing" and "libegl1" in pictures.fix


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("assetbuild di", "diff"),
        ("assetbuild diff --mark", "--markdown"),
        ("assetbuild build --fail-on n", "never"),
    ],
)
def test_bash_completes_verbs_and_options(line: str, expected: str, capsys):
    if shutil.which("bash") is None:
        pytest.skip("no bash")
    main(["completion", "bash"])
    words = line.split()
    script = capsys.readouterr().out + (
        f"\nCOMP_WORDS=({line})\nCOMP_CWORD={len(words) - 1}\n"
        f"_shtab_assetbuild assetbuild {words[-1]}\n"
        'printf "%s\\n" "${COMPREPLY[@]}"\n'
    )
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True)
    assert expected in done.stdout.split(), done.stderr


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
def test_all_files_of_the_folder_name_each_recipe_once(warm_legs: Legs, verb: str):
    """A shell turns `*.yaml` into recipes and locks alike."""
    (warm_legs.folder / "legs.lock.yaml").write_text("schema: assetbuild-lock/v1\n")
    words = ["legs.lock.yaml", "legs.yaml"]
    done = warm_legs.run(verb, *words)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("legs.yaml: ") <= 1


def test_check_names_what_each_warning_is_about(legs: Legs):
    """Also where no line of the recipe's own source says it: of the parts of a composite."""
    text = legs.urdf.read_text()
    first = text.index("<link name=")
    name = text[first:].split('"')[1]
    heavy = text[:first] + text[first:].replace('mass value="', 'mass value="1e-9" was="', 1)
    legs.urdf.write_text(heavy)
    done = legs.run("check", "legs.yaml")
    assert f": link {name}: " in done.stdout


@pytest.mark.parametrize("shell", ["zsh", "fish", "tcsh"])
def test_other_shells_have_a_script_that_knows_the_verbs(shell: str, capsys):
    assert main(["completion", shell]) == 0
    assert "validate" in capsys.readouterr().out
