"""Which line of a usda file states what."""

from __future__ import annotations

import re

_PRIM = re.compile(r'\s*(?:def|over|class)\s+(?:\w+\s+)?"([^"]+)"')
_SET = re.compile(r'\s*variantSet\s+"([^"]+)"\s*=\s*\{')
_VARIANT = re.compile(r'\s*"([^"]+)"\s*[({]')
_PROPERTY = re.compile(r"\s*(?:\w+ )*?(?:rel|[\w:]+(?:\[\])?) ([\w:]+)(?:\.\w+)?\s*(?:=|\(|$)")


def usda_lines(text: str) -> dict[str, int]:
    """Path of a prim or property -> its line, from 1. Of properties the first line that has it."""
    found: dict[str, int] = {}
    stack: list[str] = [""]
    coming, in_metadata = "", False
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.strip()
        if in_metadata:
            in_metadata = not words.startswith(")")
            if in_metadata:
                continue
        elif named := _named(line, stack[-1]):
            coming = named
            found.setdefault(coming, number)
            in_metadata = words.endswith("(")
        elif stated := _PROPERTY.match(line):
            found.setdefault(f"{stack[-1]}.{stated[1]}", number)
        if words.endswith("{"):
            stack.append(coming or stack[-1])
            coming = ""
        elif words.startswith("}") and len(stack) > 1:
            stack.pop()
    return found


def _named(line: str, here: str) -> str:
    """The path of the prim, variant set or variant that begins in a line; "" of others."""
    if prim := _PRIM.match(line):
        return f"{here}/{prim[1]}"
    if chosen := _SET.match(line):
        return f"{here}{{{chosen[1]}=}}"
    if here.endswith("=}") and (variant := _VARIANT.match(line)):
        return f"{here[:-1]}{variant[1]}}}"
    return ""
