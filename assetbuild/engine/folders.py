"""Where the store lives when nobody says. The null build asks too, so Linux imports nothing."""

# pathlib is not loaded on the way of the null build:
# ruff: noqa: PTH100, PTH111
from __future__ import annotations

import os
import sys


def cache_root() -> str:
    """The store's folder: `$ASSETBUILD_CACHE`, else `assetbuild` in the user's cache folder."""
    named = os.environ.get("ASSETBUILD_CACHE")
    if named:
        return os.path.abspath(named)
    if sys.platform == "linux":
        base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
        return f"{base}/assetbuild"
    import platformdirs

    return platformdirs.user_cache_dir("assetbuild", appauthor=False)
