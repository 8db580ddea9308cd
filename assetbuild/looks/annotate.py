"""Text on pictures: the names of what arrows show, and sheets of small pictures."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np

from assetbuild.robot.pose import Array
from assetbuild.simulators.studio import Pixels

INK, LINE, PAPER = (28, 32, 38), (110, 118, 128), (240, 240, 240)
SMALL = 256
"""Pixels along a side of the thumbnail."""
CAPTION = 36
"""Characters above a tile."""
PALETTE_STEP = 3
"""The colours of a picture are chosen from one that is so many times smaller."""
COLUMNS = 4
"""Tiles in a row of a sheet."""


def named(pixels: Pixels, places: Array, names: Sequence[str]) -> Pixels:
    """The picture with names in two columns at its sides, each with a line to its place.

    places: (n, 2), 0..1 from the upper left corner. Places in the left half are named on the left.
    """
    from PIL import Image, ImageDraw, ImageFont

    page = Image.fromarray(pixels)
    draw = ImageDraw.Draw(page)
    width, height = page.size
    spots = places * (width, height)
    order = np.argsort(spots[:, 0], kind="stable")
    halves = (order[: len(order) // 2], order[len(order) // 2 :])
    step = min(34.0, (height - 20.0) / max(max(map(len, halves)), 1))
    font = ImageFont.load_default(max(9, int(0.72 * step)))
    for half, at_right in zip(halves, (False, True), strict=True):
        half = half[np.argsort(spots[half, 1], kind="stable")]
        for number, top in zip(half, _spread(spots[half, 1], step, height), strict=True):
            text = shortened(names[number], CAPTION)
            long = draw.textlength(text, font=font)
            x = width - 12 - long if at_right else 12.0
            edge = x - 8 if at_right else x + long + 8
            draw.line([(edge, top), tuple(spots[number])], fill=LINE, width=2)
            draw.text((x, top), text, fill=INK, font=font, anchor="lm")
    return np.asarray(page)


def _spread(wanted: Array, step: float, height: int) -> list[float]:
    """Heights at least `step` apart, in order, as near to the wanted ones as one pass can."""
    tops: list[float] = []
    for index, y in enumerate(wanted):
        last = height - 10 - step * (len(wanted) - index - 0.5)
        lowest = tops[-1] + step if tops else 10 + step / 2
        tops.append(max(lowest, min(float(y), last)))
    return tops


def shortened(name: str, room: int) -> str:
    """At most `room` characters; of a long name both ends: `FR_` tells legs apart."""
    if len(name) <= room:
        return name
    head = (room - 3) // 2
    return f"{name[:head]}...{name[head + 3 - room :]}"


def caption(name: str, tail: str) -> str:
    """Name and tail as wide as a tile."""
    return shortened(name, CAPTION - len(tail)) + tail


def sheet(tiles: Sequence[Pixels], texts: Sequence[str]) -> Pixels:
    """Tiles in rows of four, each with its text above."""
    from PIL import Image, ImageDraw, ImageFont

    height, width = tiles[0].shape[:2]
    band = 34 if any(texts) else 0
    columns = min(COLUMNS, len(tiles))
    rows = -(-len(tiles) // columns)
    page = Image.new("RGB", (columns * width, rows * (height + band)), PAPER)
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(20)
    for number, (tile, text) in enumerate(zip(tiles, texts, strict=True)):
        x, y = number % columns * width, number // columns * (height + band)
        page.paste(Image.fromarray(tile), (x, y + band))
        if text:
            draw.text((x + 10, y + band // 2), text, fill=INK, font=font, anchor="lm")
    return np.asarray(page)


def png(pixels: Pixels, *, every_colour: bool = False) -> bytes:
    """A PNG of 256 colours, half of the size; soft shadows need every colour."""
    from PIL import Image

    image = Image.fromarray(pixels)
    if not every_colour:
        palette = image.reduce(PALETTE_STEP).quantize(256, method=Image.Quantize.MEDIANCUT)
        image = image.quantize(palette=palette, dither=Image.Dither.NONE)
    out = io.BytesIO()
    image.save(out, "PNG", compress_level=4)
    return out.getvalue()


def thumbnail(pixels: Pixels) -> bytes:
    """The picture on a square of 256 pixels, as PNG."""
    from PIL import Image, ImageOps

    small = ImageOps.pad(Image.fromarray(pixels), (SMALL, SMALL), color=PAPER)
    return png(np.asarray(small), every_colour=True)
