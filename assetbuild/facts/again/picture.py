"""Pictures: their pixels, however they are packed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from assetbuild.facts.again.row import NotParsedError
from assetbuild.facts.again.tree import Node


def picture_tree(path: Path) -> Node:
    """Kind, size and pixels."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            pixels = np.array(picture.convert("RGBA") if picture.mode == "P" else picture)
            said = {"mode": picture.mode, "size": picture.size, "pixels": pixels}
    except (OSError, ValueError, SyntaxError) as error:
        raise NotParsedError(f"not readable as a picture: {error}") from None
    parts = {name: Node(value) for name, value in said.items()}
    return Node(None, parts, 0, ("picture", path.name))
