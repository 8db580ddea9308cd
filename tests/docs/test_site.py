"""The site builds without a warning: every page is in its menu and no link leads nowhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from assetbuild.pipeline.recipes import schema_text
from docs.site.__main__ import main
from docs.site.pages import generated

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "docs/site/mkdocs.yml"


def built(
    *words: str | Path, env: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", *map(str, words)]
    kept = {k: v for k, v in os.environ.items() if k != "NO_MKDOCS_2_WARNING"} | (env or {})
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=kept)


def test_without_mkdocs_the_site_says_what_brings_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mkdocs", None)
    monkeypatch.setitem(sys.modules, "mkdocs.__main__", None)
    with pytest.raises(SystemExit, match=r"pip install -e '\.\[docs\]'"):
        main(["serve"])


@pytest.mark.slow
def test_the_site_builds_without_a_warning_and_holds_the_generated_pages(tmp_path: Path) -> None:
    done = built("docs.site", "build", "-d", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "end of life" not in done.stdout + done.stderr
    pages = {page.parent.name for page in tmp_path.rglob("index.html")}
    assert {"go1", "new-robot", "recipe", "verbs", "concepts", "inertia"} <= pages
    page = (tmp_path / "how-to/plugins/index.html").read_text()
    assert "class Wind(Check)" in re.sub(r"<[^>]+>", "", page)


@pytest.mark.slow
def test_a_page_with_a_dead_link_fails_it(tmp_path: Path) -> None:
    site = tmp_path / "docs/site"
    site.mkdir(parents=True)
    (tmp_path / "docs/index.md").write_text("# Home\n\n[gone](gone.md)\n")
    menu = CONFIG.read_text().partition("nav:\n  - Home")[0].replace("hooks: [hooks.py]\n", "")
    (site / "mkdocs.yml").write_text(menu + "nav:\n  - Home: index.md\n")
    words = ("mkdocs", "build", "--strict", "-f", site / "mkdocs.yml", "-d", tmp_path / "out")
    done = built(*words, env={"NO_MKDOCS_2_WARNING": "1"})
    assert done.returncode != 0
    assert "gone.md" in done.stderr


def test_what_the_code_states_is_committed_nowhere_but_in_the_schema_of_editors() -> None:
    folder = ROOT / "docs/reference"
    assert not [name for name in generated() if (folder / name).exists()]
    said = (folder / "recipe.schema.json").read_text("utf-8")
    assert said == schema_text(), "renew it: python -m docs.site.pages"


def test_written_pages_stay_short() -> None:
    """Words with a letter or a digit, code blocks left out: tables count, their bars do not."""
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    texts = {page: page.read_text("utf-8") for page in pages}
    prose = [re.sub(r"^( *)```.*?^\1```$", "", text, flags=re.M | re.S) for text in texts.values()]
    assert sum(bool(re.search(r"\w", word)) for text in prose for word in text.split()) <= 20_000
    how_to = {p.name: text.count("\n") for p, text in texts.items() if p.parent.name == "how-to"}
    assert max(how_to.values()) <= 120, how_to
