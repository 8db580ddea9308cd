"""Which other files a mesh file names: material libraries, pictures, buffers."""

from __future__ import annotations

import html
import json
import posixpath
import re
from collections.abc import Iterator
from typing import Literal
from urllib.parse import unquote

Naming = Literal["dae", "obj", "mtl", "gltf"]
"""Formats that name other files; STL, PLY and GLB hold all that they show."""

_ELEMENT = re.compile(rb"<(/?)(?:\w{1,32}:)?(image|init_from|ref)\b([^<>]{0,1000})>([^<]{0,4096})")
"""(closing, name, attributes, text) of what matters in COLLADA. Bounded, so that no file, however
broken, takes more than a pass."""
_MTLLIB = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", re.MULTILINE)
_MAP_KD = re.compile(rb"^[ \t]*map_Kd[ \t]+([^\r\n]+)", re.MULTILINE)
_ELSEWHERE = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:|/")
"""A scheme, a drive letter, or an absolute path."""
_OPTION = re.compile(
    r"\s*-(?:(?:mm|s|o|t)(?:\s+[-+.\deE]+(?=\s)){0,3}"
    r"|(?:blendu|blendv|cc|clamp|boost)\s+\S+)\s+"
)
"""One option of an MTL's map, before the name of its picture. Python 3.11.2 repeats groups
possessively (`++`) as if each came once, so options are matched one by one."""


def format_of(path: str) -> str:
    """The format of a file by its name alone: `obj`."""
    return posixpath.splitext(path)[1].lower().lstrip(".")


def companions_of(data: bytes, format: Naming) -> tuple[str, ...]:
    """Paths from the folder of the file, `/` between parts, sorted, each once.

    What leads to another machine, an absolute path or a `data:` address is not among them.
    """
    names = (relative_name(name) for name in _stated(data, format))
    return tuple(sorted({name for name in names if name is not None}))


def relative_name(stated: str) -> str | None:
    """The name in one spelling, `./a\\b.png` -> `a/b.png`; None when it cannot be followed."""
    name = stated.strip().replace("\\", "/")
    if not name or _ELSEWHERE.match(name) or not _is_possible(name):
        return None
    normal = posixpath.normpath(name)
    return None if normal in (".", "..") or name.endswith("/") else normal


def _is_possible(name: str) -> bool:
    """Could a disk hold a file of this name? Others raise odd errors when they are looked for."""
    try:
        parts = [part.encode("utf-8") for part in name.split("/")]
    except UnicodeEncodeError:
        return False
    return "\0" not in name and len(name) < 1000 and max(map(len, parts)) <= 255


def picture_of_map(words: str) -> str:
    """The file behind `map_Kd`, whose options come before it; names may hold spaces.

    >>> picture_of_map("-s 2 2 1 -o 0.5 e.png")
    'e.png'
    """
    start = 0
    while option := _OPTION.match(words, start):
        start = option.end()
    return words[start:].strip()


def _stated(data: bytes, format: Naming) -> Iterator[str]:
    if format == "obj":
        yield from (_text(name) for name in _MTLLIB.findall(data))
    elif format == "mtl":
        yield from (picture_of_map(_text(name)) for name in _MAP_KD.findall(data))
    elif format == "dae":
        yield from _of_dae(data)
    else:
        yield from _of_gltf(data)


def _of_dae(data: bytes) -> Iterator[str]:
    """`init_from` (1.4) or `init_from/ref` (1.5) of each image; elsewhere it names no file."""
    inside = False
    for closing, name, attributes, text in _ELEMENT.findall(data):
        if name == b"image":
            inside = not closing and not attributes.endswith(b"/")
        elif inside and not closing and text.strip():
            yield unquote(html.unescape(_text(text)))


def _of_gltf(data: bytes) -> Iterator[str]:
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return  # the reader says what is wrong
    for kind in ("buffers", "images"):
        entries = document.get(kind) if isinstance(document, dict) else None
        for entry in entries if isinstance(entries, list) else ():
            uri = entry.get("uri") if isinstance(entry, dict) else None
            if isinstance(uri, str):
                yield unquote(uri)


def _text(name: bytes) -> str:
    return name.decode("utf-8", "replace").strip()
