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
    stack: list[str] = []
    coming = ""
    for number, line in enumerate(text.splitlines(), start=1):
        here = stack[-1] if stack else ""
        if prim := _PRIM.match(line):
            coming = f"{here}/{prim[1]}"
        elif named := _SET.match(line):
            coming = f"{here}{{{named[1]}=}}"
        elif here.endswith("=}") and (variant := _VARIANT.match(line)):
            coming = f"{here[:-1]}{variant[1]}}}"
        elif stated := _PROPERTY.match(line):
            found.setdefault(f"{here}.{stated[1]}", number)
        if coming:
            found.setdefault(coming, number)
        if line.rstrip().endswith("{"):
            stack.append(coming or here)
            coming = ""
        elif line.strip().startswith("}") and stack:
            stack.pop()
    return found
