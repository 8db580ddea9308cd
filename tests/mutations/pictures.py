"""Mutations of picture files: single pixels, a little and a lot."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

from PIL import Image

from tests.mutations.change import Mutation

DRAWN = 3
"""So many pixels of a picture are drawn."""


def walk(path: Path, file: str, random_: random.Random) -> Iterator[Mutation]:
    """Mutations of the first channel."""
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
                where, key = f"pixel {x}, {y}", (x, y, new)
                yield Mutation(file, where, what, str(first), str(new), key)


def apply(path: Path, key: tuple[object, ...]) -> None:
    """Changes the first channel of the pixel of a mutation's key."""
    x, y, new = (int(str(part)) for part in key)
    with Image.open(path) as opened:
        picture = opened.copy()
    old = picture.getpixel((x, y))
    picture.putpixel((x, y), (new, *old[1:]) if isinstance(old, tuple) else new)
    picture.save(path)
