"""Mutations of mesh and picture files: a vertex, a corner of a texture, a face, a pixel."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

from PIL import Image

from tests.mutations.change import Mutation, text_changes

DRAWN = 3
"""So many lines of each keyword of a mesh, and pixels of a picture, are drawn."""


def walk_mesh(path: Path, file: str, random_: random.Random) -> Iterator[Mutation]:
    """Mutations of a Wavefront mesh or its materials: of some lines of each keyword."""
    lines = path.read_text(encoding="utf-8").splitlines()
    of: dict[str, list[int]] = {}
    for number, line in enumerate(lines):
        if line.strip() and not line.startswith("#"):
            of.setdefault(line.split(maxsplit=1)[0], []).append(number)
    for word, numbers in of.items():
        for number in random_.sample(numbers, min(DRAWN, len(numbers))):
            where, line = f"line {number + 1}", lines[number]
            label = f"{path.suffix[1:]}:{word}"
            for what, after in _lines(line, random_):
                yield Mutation(file, where, label, what, line, after, ("set", number, after))


def _lines(line: str, random_: random.Random) -> Iterator[tuple[str, str]]:
    """Other lines of the same keyword: none, turned, with other numbers or another text."""
    word, *rest = line.split()
    yield "deleted", ""
    if word == "f":
        yield "turned over", " ".join((word, rest[1], rest[0], *rest[2:]))
        return
    for what, new in text_changes(" ".join(rest), [], random_):
        yield what, f"{word} {new}"


def apply_mesh(path: Path, key: tuple[object, ...]) -> None:
    """Replaces the line of a mutation's key."""
    lines = path.read_text(encoding="utf-8").splitlines()
    _, number, after = key
    lines[int(str(number))] = str(after)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def walk_picture(path: Path, file: str, random_: random.Random) -> Iterator[Mutation]:
    """Mutations of a picture: single pixels a little and a lot."""
    with Image.open(path) as picture:
        width, height = picture.size
        for _ in range(DRAWN):
            x, y = random_.randrange(width), random_.randrange(height)
            old = picture.getpixel((x, y))
            first = old[0] if isinstance(old, tuple) else int(old or 0)
            for what, new in (
                ("by 3", first + 3 if first < 250 else first - 3),
                ("inverted", 255 - first),
            ):
                key = ("pixel", x, y, new)
                yield Mutation(file, f"pixel {x}, {y}", "pixel", what, str(first), str(new), key)


def apply_picture(path: Path, key: tuple[object, ...]) -> None:
    """Changes the first channel of the pixel of a mutation's key."""
    _, x, y, new = (key[0], *(int(str(part)) for part in key[1:]))
    with Image.open(path) as opened:
        picture = opened.copy()
    old = picture.getpixel((x, y))
    picture.putpixel((x, y), (new, *old[1:]) if isinstance(old, tuple) else new)
    picture.save(path)
