"""A picture is its pixels, however they are stored."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from assetbuild.facts.picture import pixel_digest


def test_the_same_pixels_are_the_same_picture(tmp_path: Path):
    red = Image.new("RGB", (3, 2), (200, 10, 10))
    stored = {
        "plain.png": red, "opaque.png": red.convert("RGBA"), "palette.png": red.quantize(4),
        "other.bmp": red,
    }  # fmt: skip
    for name, picture in stored.items():
        picture.save(tmp_path / name)
    assert len({pixel_digest(tmp_path / name) for name in stored}) == 1


def test_colour_size_and_opacity_make_another(tmp_path: Path):
    pictures = [
        Image.new("RGB", (3, 2), (200, 10, 10)),
        Image.new("RGB", (2, 3), (200, 10, 10)),
        Image.new("RGB", (3, 2), (201, 10, 10)),
        Image.new("RGBA", (3, 2), (200, 10, 10, 254)),
    ]
    for number, picture in enumerate(pictures):
        picture.save(tmp_path / f"{number}.png")
    clear = pictures[0].copy()
    clear.save(tmp_path / "4.png", transparency=(200, 10, 10))
    assert len({pixel_digest(tmp_path / f"{number}.png") for number in range(5)}) == 5
