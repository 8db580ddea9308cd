"""Patterns of a part about names with its prefix."""

from __future__ import annotations

import re
from collections.abc import Iterable


def anchored(prefix: str, pattern: str, but: Iterable[str] = ()) -> str:
    """A part's pattern about the names with its prefix; `but`: patterns that win over it."""
    return f"{but_not(but)}{re.escape(prefix)}(?:{pattern})"


def but_not(patterns: Iterable[str]) -> str:
    """A look-ahead that no name of the patterns passes; "" for none."""
    listed = "|".join(f"(?:{pattern})" for pattern in patterns)
    return rf"(?!(?:{listed})\Z)" if listed else ""
