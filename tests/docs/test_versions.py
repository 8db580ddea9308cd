"""The version is one everywhere: code, changelog, and what pages tell people to install."""

from __future__ import annotations

import re
from pathlib import Path

from assetbuild import __version__

ROOT = Path(__file__).parents[2]
NAMED = re.compile(r"(?:rev: v|@v|[Tt]ag `v|assetbuild-)(\d+\.\d+\.\d+)\b")
"""`rev: v0.2.0` of a hook, `robots@v0.2.0` of an action, a tag, a wheel."""


def test_the_changelog_begins_with_the_version_of_the_code() -> None:
    (first, *_) = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert first == __version__


def test_pages_and_files_to_copy_name_the_version_of_the_code() -> None:
    files = [path for path in (ROOT / "docs").rglob("*.*") if path.suffix in (".md", ".yaml")]
    named = {
        f"{path.relative_to(ROOT)}: {version}": version
        for path in [ROOT / "README.md", *files]
        for version in NAMED.findall(path.read_text(encoding="utf-8"))
    }
    assert len(named) >= 4
    assert [place for place, version in named.items() if version != __version__] == []
