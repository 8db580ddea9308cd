"""Who made the description and what the robot is, as the package.xml nearest to it says."""

from __future__ import annotations

import html
import re
from pathlib import Path

from assetbuild.init.licence import folders_above, text_of

_AUTHOR = re.compile(r"<author\b[^>]*>([^<]+)</author>")
_DESCRIPTION = re.compile(r"<description\b[^>]*>(.*?)</description>", re.S)
_COMMENT = re.compile(r"<!--.*?-->", re.S)
_TEMPLATE = re.compile(r"\bTODO\b|^(The )?[\w-]+ package\.?$|^$", re.I)
"""What a generator of packages has written, and nobody since."""
LONGEST = 200
"""Characters of a line; a longer description is cut after its first sentence."""


def stated_about(root: Path, file: str) -> dict[str, str]:
    """`author` and `description` of the nearest package.xml that states one of them.

    root: of the source; file: the description, below it.
    """
    for folder in folders_above(root, root / file):
        text = _COMMENT.sub("", text_of(folder / "package.xml"))
        authors = [name for found in _AUTHOR.findall(text) if (name := _plain(found))]
        said = _DESCRIPTION.search(text)
        about = {
            "author": _joined(list(dict.fromkeys(authors))),
            "description": _sentence(_plain(said[1])) if said else "",
        }
        if any(about.values()):
            return {key: value for key, value in about.items() if value}
    return {}


def _plain(text: str) -> str:
    """One line without markup; "" for what stands for nothing."""
    line = " ".join(html.unescape(re.sub(r"<[^>]*>", " ", text)).split())
    line = "".join(letter for letter in line if letter.isprintable())
    return "" if _TEMPLATE.search(line) else line


def _joined(names: list[str]) -> str:
    """All names where they fit, else the first and how many others there are."""
    line = ", ".join(names)
    if len(line) > LONGEST:
        line = f"{names[0][:LONGEST]} and {len(names) - 1} others" if names[1:] else line[:LONGEST]
    return line


def _sentence(text: str) -> str:
    """The first sentence where the whole is long; "" where that is long as well."""
    if len(text) > LONGEST:
        text = text.partition(". ")[0]
    return text if len(text) <= LONGEST else ""
