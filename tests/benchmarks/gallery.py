"""One picture of all robots of the library, from bundles that lie there already.

    assetbuild build recipes/*.yaml
    python -m tests.benchmarks.gallery build/* -o docs/images/library.png

One file of 256 colours: a picture for each robot would make the repository heavy.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont, ImageOps

from assetbuild.rendering.render import HERO
from assetbuild.rendering.studio import BACKGROUND

WIDTH, HEIGHT = 300, 240
"""Pixels of a robot."""
BAND, COLUMNS = 34, 4
"""Pixels of the line for its name; robots in a row."""
PAPER, INK = (BACKGROUND,) * 3, (28, 32, 38)


def main(bundles: list[Path], out: Path) -> None:
    """Write the sheet; folders without a picture are left out."""
    heroes = {b.name: b / "report/images" / HERO for b in sorted(bundles)}
    found = {name: hero for name, hero in heroes.items() if hero.exists()}
    rows = -(-len(found) // COLUMNS)
    page = Image.new("RGB", (COLUMNS * WIDTH, rows * (HEIGHT + BAND)), PAPER)
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(20)
    for number, (name, hero) in enumerate(found.items()):
        x, y = number % COLUMNS * WIDTH, number // COLUMNS * (HEIGHT + BAND)
        tile = ImageOps.pad(Image.open(hero).convert("RGB"), (WIDTH, HEIGHT), color=PAPER)
        page.paste(tile, (x, y + BAND))
        draw.text((x + 10, y + BAND // 2), name, fill=INK, font=font, anchor="lm")
    page.quantize(256, dither=Image.Dither.NONE).save(out, "PNG")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bundles", nargs="+", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    given = parser.parse_args()
    main(given.bundles, given.out)
