"""Compiled templates are used again, and nothing that is torn or of another template is."""

from __future__ import annotations

from pathlib import Path

import jinja2
import pytest

from assetbuild.report.compiled import Compiled


@pytest.fixture(autouse=True)
def python_keeps_bytecode(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("sys.dont_write_bytecode", False)


def rendered(folder: Path, text: str) -> str:
    """What a new environment makes of it, as a new process would; this file is its settings."""
    (folder / "page.html").write_text(text)
    cache = Compiled(folder / "__pycache__", Path(__file__))
    loader = jinja2.FileSystemLoader(folder)
    made = jinja2.Environment(loader=loader, bytecode_cache=cache, autoescape=True)
    return made.get_template("page.html").render(name="go1")


def kept(folder: Path) -> list[Path]:
    return sorted((folder / "__pycache__").glob("*"))


def test_a_template_is_compiled_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    assert rendered(tmp_path, "a {{ name }}") == "a go1"
    monkeypatch.delattr(jinja2.Environment, "_generate")
    assert rendered(tmp_path, "a {{ name }}") == "a go1"


def test_an_edited_template_is_compiled_again(tmp_path: Path):
    rendered(tmp_path, "a {{ name }}")
    assert rendered(tmp_path, "b {{ name }}") == "b go1"


@pytest.mark.parametrize("cut", [0, 10, 64, 100, -1])
def test_a_torn_file_is_not_used(tmp_path: Path, cut: int):
    rendered(tmp_path, "a {{ name }}")
    (file,) = kept(tmp_path)
    file.write_bytes(file.read_bytes()[:cut])
    assert rendered(tmp_path, "a {{ name }}") == "a go1"


def test_nothing_is_kept_where_python_keeps_no_bytecode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    assert rendered(tmp_path, "a {{ name }}") == "a go1"
    assert kept(tmp_path) == []
