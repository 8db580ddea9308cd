"""What nobody foresaw is a sentence and a file, never a traceback on the terminal."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import assetbuild.cli
from assetbuild.cli import doctor


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
