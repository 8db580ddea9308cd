"""One picture of all robots of the library, from bundles that lie there already.

    assetbuild build recipes/*.yaml
    python -m tests.benchmarks.gallery build/* -o docs/images/library.png

One file of 256 colours: a picture for each robot would make the repository heavy.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps

from assetbuild.looks.annotate import png, sheet
from assetbuild.looks.stage import HERO
from assetbuild.simulators.studio import BACKGROUND, Pixels

WIDTH, HEIGHT = 300, 240
"""Pixels of a robot."""


def main(bundles: list[Path], out: Path) -> None:
    """Write the sheet; folders without a picture are left out."""
    heroes = {b.name: b / "report/images" / HERO for b in sorted(bundles)}
    found = {name: hero for name, hero in heroes.items() if hero.exists()}
    out.write_bytes(png(sheet([tile(hero) for hero in found.values()], list(found))))


def tile(hero: Path) -> Pixels:
    """The picture in the middle of a tile."""
    image = Image.open(hero).convert("RGB")
    return np.asarray(ImageOps.pad(image, (WIDTH, HEIGHT), color=(BACKGROUND,) * 3))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bundles", nargs="+", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    given = parser.parse_args()
    main(given.bundles, given.out)
