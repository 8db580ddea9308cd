"""Names and patterns of a recipe."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Annotated

from pydantic import AfterValidator, Field


def _pattern(text: str) -> str:
    if len(text) > 500:
        raise ValueError("a pattern may have at most 500 characters")
    try:
        re.compile(text)
    except (re.error, OverflowError, RecursionError) as error:
        raise ValueError(f"not a regular expression: {error}") from error
    return text


Pattern = Annotated[str, AfterValidator(_pattern)]
"""A regular expression that must match a whole name of the source."""
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,63}$")]


def anchored(prefix: str, pattern: str, but: Iterable[str] = ()) -> str:
    """A part's pattern about the names with its prefix; `but`: patterns that win over it."""
    return f"{but_not(but)}{re.escape(prefix)}(?:{pattern})"


def but_not(patterns: Iterable[str]) -> str:
    """A look-ahead that no name of the patterns passes; "" for none."""
    listed = "|".join(f"(?:{pattern})" for pattern in patterns)
    return rf"(?!(?:{listed})\Z)" if listed else ""
