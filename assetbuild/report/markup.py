"""Pieces of the report's page that its sections share."""

from __future__ import annotations

import re
from html import escape
from pathlib import Path
from string import Template

ASSETS = Path(__file__).parent / "assets"


def asset(name: str) -> str:
    """A file that comes with the report."""
    return (ASSETS / name).read_text(encoding="utf-8")


def filled(template: str, **values: str) -> str:
    """An asset with its `$names` replaced by markup."""
    return Template(asset(template)).substitute(values)


def code(text: str) -> str:
    """A literal."""
    return f"<code>{escape(text)}</code>"


def prose(text: str) -> str:
    """A sentence whose backticks become code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def folded(head: str, inner: str) -> str:
    """What is closed at first; head: markup."""
    return f"<details><summary>{head}</summary>{inner}</details>"
