"""The site builds without a warning: every page is in its menu and no link leads nowhere."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from docs.site.pages import generated

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "docs/site/mkdocs.yml"


def built(config: Path, out: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", str(config), "-d", out]
    quiet = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    return subprocess.run(command, capture_output=True, text=True, env=quiet)


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    done = built(CONFIG, tmp_path)
    assert done.returncode == 0, done.stderr
    pages = {page.parent.name for page in tmp_path.rglob("index.html")}
    assert {"go1", "new-robot", "recipe", "verbs", "concepts"} <= pages


@pytest.mark.slow
def test_a_page_with_a_dead_link_fails_it(tmp_path: Path) -> None:
    site = tmp_path / "docs/site"
    site.mkdir(parents=True)
    (tmp_path / "docs/index.md").write_text("# Home\n\n[gone](gone.md)\n")
    menu = CONFIG.read_text().partition("nav:\n  - Home")[0]
    (site / "mkdocs.yml").write_text(menu + "nav:\n  - Home: index.md\n")
    done = built(site / "mkdocs.yml", tmp_path / "out")
    assert done.returncode != 0
    assert "gone.md" in done.stderr


def test_what_the_code_states_is_what_the_pages_say() -> None:
    folder, written = ROOT / "docs/reference", generated()
    names = {*written, *(f"rules/{page.name}" for page in folder.glob("rules/*.md"))}
    pages = {name: folder / name for name in names}
    said = {name: path.read_text("utf-8") for name, path in pages.items() if path.is_file()}
    stale = {name for name in names if said.get(name) != written.get(name)}
    assert not stale, "renew them: python -m docs.site.pages"
