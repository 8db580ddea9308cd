"""Pictures: their pixels, however they are packed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from assetbuild.facts.again.row import NotParsedError, Row


def picture_rows(again: Path, there: Path) -> list[Row]:
    """Size and kind of two pictures, and the first pixel that differs."""
    (ours, mode), (theirs, other_mode) = _pixels(again), _pixels(there)
    name = there.name
    if mode != other_mode:
        return [Row("picture", name, "mode", mode, other_mode)]
    if ours.shape != theirs.shape:
        return [Row("picture", name, "size", _numbers(ours.shape), _numbers(theirs.shape))]
    different = np.argwhere(np.any(ours != theirs, axis=2))
    if not len(different):
        return []
    y, x = map(int, different[0])
    attribute = f"pixel {x},{y}"
    return [Row("picture", name, attribute, _numbers(ours[y, x]), _numbers(theirs[y, x]))]


def _pixels(path: Path) -> tuple[Any, str]:  # Any: (height, width, channels) array
    from PIL import Image

    try:
        with Image.open(path) as picture:
            pixels = np.array(picture.convert("RGBA") if picture.mode == "P" else picture)
            return np.atleast_3d(pixels), picture.mode
    except (OSError, ValueError, SyntaxError) as error:
        raise NotParsedError(f"not readable as a picture: {error}") from None


def _numbers(values: Any) -> tuple[float, ...]:  # Any: an array or a shape
    return tuple(float(value) for value in values)
