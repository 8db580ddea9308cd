"""Pictures to PNG: the same bytes for the same pixels, and no picture that eats the memory."""

from __future__ import annotations

import hashlib
import io
import re
import warnings
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from assetbuild.errors import StepError, one_line
from assetbuild.lfs import refuse_pointer

if TYPE_CHECKING:
    from PIL import Image

FORMATS = ("PNG", "JPEG", "TGA", "BMP", "TIFF", "WEBP", "GIF", "DDS")
"""What textures of robots come in. Not EPS and the like, whose readers start other programs."""
PIXELS = 1 << 26
"""8192 x 8192: what graphics cards take, and 256 MB while it is decoded."""


def png_of(data: bytes, name: str) -> bytes:
    """A picture of any of `FORMATS` as PNG, 8 bits a channel, RGB, or RGBA where it has holes.

    No metadata, profile or date survives. Raises ValueError for what is no picture, SourceError
    for a git-LFS pointer, and StepError for one of more than `PIXELS`, before one is decoded.
    """
    from PIL import Image

    refuse_pointer(data, name)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # told below, by us
            image: Image.Image = Image.open(io.BytesIO(data), formats=FORMATS)
    except Image.DecompressionBombError as error:
        raise _too_large(name, one_line(error, 120)) from error
    except Exception as error:  # pillow's readers raise many kinds on broken files
        raise ValueError(f"{type(error).__name__}: {one_line(error, 120)}") from error
    return encoded(image, name)


def picture_name(stated: str, png: bytes) -> str:
    """What a bundle calls a picture: by the name that the source states and by its content."""
    stem = re.sub(r"[^A-Za-z0-9_]+", "_", PurePosixPath(stated).stem)
    return f"{stem}-{hashlib.sha256(png).hexdigest()[:8]}.png"


def mean_colour(png: bytes) -> tuple[float, float, float]:
    """The mean of the pixels of a picture, red, green and blue from 0 to 1."""
    from PIL import Image

    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"), dtype=np.float64)
    r, g, b = (round(float(v) / 255.0, 6) for v in pixels.reshape(-1, 3).mean(axis=0))
    return r, g, b


def has_holes(png: bytes) -> bool:
    """Does a PNG of ours have transparent parts? Colour type 6 of its header says so."""
    return png[25] == 6


def encoded(image: Image.Image, name: str) -> bytes:
    """An opened picture as PNG. Raises as `png_of`."""
    from PIL import Image

    width, height = image.size
    if width * height > PIXELS:
        raise _too_large(name, f"{width} x {height} pixels")
    try:
        pixels = _pixels(image)
    except Exception as error:  # as above: a picture that is cut off is found only here
        raise ValueError(f"{type(error).__name__}: {one_line(error, 120)}") from error
    # From the bare pixels, because `save` copies what else the source file held.
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, format="PNG", compress_level=6)
    return out.getvalue()


def _pixels(image: Image.Image) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """(height, width, 3 or 4) 0..255, row 0 on top."""
    if image.mode.startswith("I"):  # 16 bits of grey, which `convert` would cut, not scale
        grey = np.asarray(image).astype(np.float64) / 257.0
        return np.repeat(np.clip(np.round(grey), 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)
    holes = "A" in image.mode or "transparency" in image.info
    pixels = np.asarray(image.convert("RGBA" if holes else "RGB"), dtype=np.uint8)
    if holes and bool((pixels[:, :, 3] == 255).all()):
        pixels = pixels[:, :, :3]
    return np.ascontiguousarray(pixels)


def _too_large(name: str, what: str) -> StepError:
    return StepError(
        f"the picture `{name}` is too large: {what}",
        hint=f"at most {PIXELS} pixels are read, 8192 x 8192: scale it down in the source",
    )
