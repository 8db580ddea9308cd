"""A command that is spelt wrong: one sentence, the usage of its own verb, a hint that is right."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import assetbuild.cli
from assetbuild.cli import doctor

from .conftest import Place

WRONG = [
    ("buid legs.yaml", "no verb named `buid`", "did you mean `build`?"),
    ("sdf", "no verb named `sdf`", "`assetbuild --help` lists the verbs"),
    ("legs.yaml", "no verb named `legs.yaml`", "`assetbuild build legs.yaml`"),
    ("robot/four_legs.urdf", "no verb named", "`assetbuild init robot/four_legs.urdf`"),
    ("cache stat", "no verb named `stat`", "did you mean `stats`?"),
    ("cache", "`assetbuild cache` needs `WHAT`", "one of stats, check, gc, push, pull"),
    ("--frozn", "`assetbuild` has no option `--frozn`", "`assetbuild --help` lists the options"),
    ("build legs.yaml --frozn", "build` has no option `--frozn`", "did you mean `--frozen`?"),
    ("build legs.yaml -z", "`assetbuild build` has no option `-z`", "`assetbuild build --help`"),
    ("build legs.yaml --re", "ambiguous option: --re could match --remote, --rehash", ""),
    ("build legs.yaml --frozen=1", "`--frozen` ignored explicit argument '1'", ""),
    ("build legs.yaml -j", "`--jobs` needs a value", ""),
    ("policy replay p b --command 0.5", "`--command` needs 3 values", ""),
    ("build legs.yaml -j x", "`--jobs` must be a whole number of at least 1, not `x`", ""),
    ("build legs.yaml --fail-on eror", "must be `error`, `warning` or `never`, not `eror`", "did"),
    ("build", "`assetbuild build` needs `RECIPE`", ""),
    ("sample legs.yaml -n 0", "`--count` must be a whole number from 1 to 1000, not `0`", ""),
    ("validate a b", "`assetbuild validate` takes no further argument: `b`", ""),
    ("cache gc --max-size big", "`--max-size` must be a size such as `500MB`", ""),
]


@pytest.mark.parametrize(("line", "said", "hint"), WRONG)
def test_a_command_that_is_spelt_wrong(legs: Place, line: str, said: str, hint: str):
    words = shlex.split(line)
    text = legs.refused(*words)
    told = text.splitlines()
    error = next(line for line in told if line.startswith("error: "))
    assert said in error
    assert hint in told[-1] if hint else told[-1] == error
    for raw in ("invalid choice", "invalid _", "unrecognized", "argument -", "assetbuild: error"):
        assert raw not in text
    verb = next((word for word in words[:1] if word in ("build", "cache", "plan")), "")
    assert told[0].startswith(f"usage: assetbuild {verb}")


def test_a_dry_run_says_by_its_exit_code_whether_something_would_run(warm_legs: Place):
    warm_legs.edit("kp: 20", "kp: 21")
    assert warm_legs.build("-n").returncode == 3
    assert warm_legs.build().returncode == 0
    assert warm_legs.build("-n").returncode == 0


@pytest.mark.parametrize(
    ("line", "out"),
    [("build legs.yaml", "file/x"), ("bench legs.yaml", "file/x/y"), ("sample legs.yaml", "file")],
)
def test_a_file_where_a_folder_has_to_be_is_named(legs: Place, line: str, out: str):
    (legs.folder / "file").touch()
    legs.edit("targets:", 'randomize: {links: {".*": {density: [0.9, 1.1]}}}\ntargets:')
    told = legs.refused(*line.split(), "-o", out)
    assert "`file` is not a folder" in told
    assert "hint: choose another folder with `-o`" in told
    assert ": [1/" not in told  # it is seen before anything is built
    assert (legs.folder / "file").read_bytes() == b""


def test_a_report_below_a_file_is_a_wrong_command(legs: Place):
    (legs.folder / "file").touch()
    assert "a folder that `build` wrote" in legs.refused("report", "file/x")


def test_a_bug_is_one_error_that_names_the_file_with_the_traceback(monkeypatch, capsys):
    def fall(_: object) -> int:
        raise ZeroDivisionError("no such thing")

    monkeypatch.setattr(doctor, "run", fall)
    assert assetbuild.cli.main(["doctor"]) == 1
    told = capsys.readouterr().err
    assert told.startswith("error: a bug in assetbuild: ZeroDivisionError: no such thing\nhint: ")
    assert told.count("\n") == 2
    file = Path(told.split()[-1])
    assert "in fall" in file.read_text()
    file.unlink()


def test_a_working_folder_that_is_removed_meanwhile_is_told(monkeypatch, capsys, tmp_path):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")

    def remove(_: object) -> int:
        (tmp_path / "gone").rmdir()
        return len(str(Path.cwd()))

    monkeypatch.setattr(doctor, "run", remove)
    assert assetbuild.cli.main(["doctor"]) == 1
    assert capsys.readouterr().err.startswith("error: the working folder was removed")


def test_a_working_folder_that_is_gone_is_one_error(tmp_path):
    (tmp_path / "gone").mkdir()
    command = 'rmdir "$PWD" && exec "$0" -m assetbuild build go1.yaml'
    done = subprocess.run(
        ["sh", "-c", command, sys.executable],
        cwd=tmp_path / "gone",
        env={**os.environ, "PYTHONPATH": str(Path(assetbuild.cli.__file__).parents[2])},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert done.stderr == "error: the folder that this was started in no longer exists\n"


@pytest.mark.parametrize(
    ("shell", "code", "said"),
    [
        ("list >&-", 0, ""),
        ("check no.yaml >&- 2>&-", 2, ""),
        ("list >/dev/full", 1, "No space"),
    ],
)
def test_an_output_that_takes_nothing_is_no_bug(shell: str, code: int, said: str):
    line = f"{shlex.quote(sys.executable)} -m assetbuild {shell}"
    done = subprocess.run(["/bin/sh", "-c", line], capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert said in done.stderr
    assert "bug" not in done.stderr and "Traceback" not in done.stderr
