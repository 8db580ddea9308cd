"""Where the store lives when nobody says. Standard library only: the null build asks too."""

# ruff: noqa: PTH - pathlib is not loaded on the way of the null build
from __future__ import annotations

import os
import sys


def default_store() -> str:
    """`$ASSETBUILD_CACHE`, else the user's cache folder as the platform names it."""
    chosen = os.environ.get("ASSETBUILD_CACHE")
    if chosen:
        return os.path.abspath(chosen)
    home = os.path.expanduser("~")
    if sys.platform == "darwin":
        return f"{home}/Library/Caches/assetbuild"
    return f"{os.environ.get('XDG_CACHE_HOME') or home + '/.cache'}/assetbuild"
