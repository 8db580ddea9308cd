"""A picture as a digest of what it shows."""

from __future__ import annotations

import hashlib
from io import BytesIO
from pathlib import Path

from assetbuild.facts.known_files import KnownFiles


def pixel_digest(file: Path, known: KnownFiles | None = None) -> str:
    """Digest of the size and the RGBA pixels of a picture, whatever its file says besides.

    "" where it is missing or no picture, which the targets report. known: the robot's own.
    """
    try:
        data = file.read_bytes()
    except FileNotFoundError:
        return ""
    same = known.picture(data) if known is not None else None
    return same or pixels_of(data)


def pixels_of(data: bytes) -> str:
    """The same of the bytes of a picture."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(BytesIO(data)) as picture:
            pixels = picture.convert("RGBA")
    except UnidentifiedImageError:
        return ""
    return hashlib.sha256(repr(pixels.size).encode() + pixels.tobytes()).hexdigest()[:16]
