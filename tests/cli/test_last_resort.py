"""What nobody foresaw is a sentence and a file, never a traceback on the terminal."""

from __future__ import annotations

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
