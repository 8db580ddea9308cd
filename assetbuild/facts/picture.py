"""What a picture shows, whatever its file says besides."""

from __future__ import annotations

import hashlib
from pathlib import Path


def pixel_digest(file: Path) -> str:
    """Digest of the size and the pixels of a picture: RGB where it is opaque, else RGBA."""
    from PIL import Image

    with Image.open(file) as picture:
        plain = picture.mode == "RGB" and "transparency" not in picture.info
        pixels = picture if plain else picture.convert("RGBA")
        if not plain and pixels.getchannel("A").getextrema() == (255, 255):
            pixels = pixels.convert("RGB")
        held = hashlib.sha256(repr((pixels.size, pixels.mode)).encode() + pixels.tobytes())
    return held.hexdigest()[:16]
