"""The pages: every command is one that the program takes; every rule, link and version exists."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
from pathlib import Path

import pytest
import yaml

from assetbuild import __version__
from assetbuild.cli import main
from assetbuild.pipeline.recipes import whole_model
from docs.site.pages import generated
from docs.site.pages.rules import entries_of, package_modules

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"(?:^|[ ;(])(?:\.venv/bin/)?(assetbuild (?:[a-z]|--)[^\n#;)]*)")


def blocks(page: Path, kind: str) -> list[str]:
    found = [m for m in BLOCK.finditer(page.read_text(encoding="utf-8")) if m.group(2) == kind]
    return [re.sub(rf"^{m.group(1)}", "", m.group(3), flags=re.MULTILINE) for m in found]


def commands() -> list[tuple[str, str]]:
    found = []
    for page in PAGES:
        for block in blocks(page, "sh"):
            for line in block.replace("\\\n", " ").splitlines():
                found += [(page.name, c.strip()) for c in COMMAND.findall(line)]
    return sorted(set(found))


@pytest.mark.parametrize(("page", "command"), commands(), ids=lambda v: v[:60])
def test_the_program_takes_every_command_of_the_pages(page: str, command: str, monkeypatch):
    """Parsed, not run: what a command does is tested where it lives."""
    command = re.split(r" (?:&&|\|\|?|>>?|2>) ?", command)[0]
    words = shlex.split(command)[1:]
    monkeypatch.setattr("assetbuild.cli.runner", lambda verb: lambda arguments: 0)
    errors = io.StringIO()
    with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(io.StringIO()):
        try:
            code = main(words)
        except SystemExit as end:
            code = end.code
    assert code == 0, f"{page}: {command}\n{errors.getvalue()}"


def test_every_rule_of_the_troubleshooting_page_exists():
    known = {entry.rule.id for entry in entries_of(package_modules())}
    for name in ("troubleshooting", "solidworks", "gripper"):
        text = (ROOT / f"docs/how-to/{name}.md").read_text()
        named = set(re.findall(r"`([a-z_]+(?:\.[a-z_*]+)+)`", text))
        rules = {n for n in named if n.split(".")[0] in {k.split(".")[0] for k in known}}
        rules -= {"collision.links", "collision.exclude", "visual.max_faces"}  # keys of the recipe
        assert rules
        assert rules - known == set(), name


def test_every_link_between_pages_leads_somewhere():
    made = {(ROOT / "docs/reference" / name).resolve() for name in generated()}
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            if "://" not in target:
                led = (page.parent / target).resolve()
                assert led.exists() or led in made, f"{page.name}: {target}"


def test_the_readme_shows_the_recipe_that_it_builds():
    (shown,) = blocks(ROOT / "README.md", "yaml")
    lines = (ROOT / "recipes/go1_minimal.yaml").read_text().splitlines(keepends=True)
    assert shown == "".join(line for line in lines if not line.startswith("#"))
    assert any("assetbuild build go1_minimal" in command for _, command in commands())


def test_the_readme_has_ten_links_at_most():
    assert len(re.findall(r"\]\(", (ROOT / "README.md").read_text())) <= 10


FULL = {
    "schema": "assetbuild/v1",
    "robot": "r",
    "source": {"path": ".", "urdf": "r.urdf", "license": "MIT"},
}


def test_every_piece_of_recipe_on_the_pages_is_one():
    for name in ("troubleshooting", "solidworks", "gripper"):
        for block in blocks(ROOT / f"docs/how-to/{name}.md", "yaml"):
            whole_model().model_validate({**FULL, **yaml.safe_load(block)})


NAMED = re.compile(r"(?:rev: v|@v|[Tt]ag `v|assetbuild-)(\d+\.\d+\.\d+)\b")
"""`rev: v0.2.0` of a hook, `robots@v0.2.0` of an action, a tag, a wheel."""


def test_the_changelog_begins_with_the_version_of_the_code() -> None:
    (first, *_) = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert first == __version__


def test_pages_and_files_to_copy_name_the_version_of_the_code() -> None:
    named = {
        f"{path.relative_to(ROOT)}: {version}": version
        for path in [*PAGES, *(ROOT / "docs").rglob("*.yaml")]
        for version in NAMED.findall(path.read_text(encoding="utf-8"))
    }
    assert len(named) >= 4
    assert [place for place, version in named.items() if version != __version__] == []
