"""Renew the committed pages below `docs/reference`."""

from __future__ import annotations

from pathlib import Path

from docs.site.pages import generated

REFERENCE = Path(__file__).parents[2] / "reference"


def main() -> None:
    """Pages of families of rules that are gone are removed."""
    for old in (REFERENCE / "rules").glob("*.md"):
        old.unlink()
    for path, text in generated().items():
        (REFERENCE / path).write_text(text, encoding="utf-8")


main()
