"""`assetbuild lock`: moving sources to version and sha256."""

from __future__ import annotations

import argparse
import sys

from assetbuild.lock import Pin, lock_path
from assetbuild.pipeline.opening import moving_sources, write_pin
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.recipe.loader import shown_path


def run(arguments: argparse.Namespace) -> int:
    """Write the locks; prints each lock file."""
    for recipe in arguments.recipes:
        loaded = load_recipe(recipe)
        variants = [load_recipe(recipe, name) for name in loaded.recipe.variants]
        if not moving_sources(loaded, *variants):
            kind = "a folder" if loaded.recipe.source.path else "pinned in the recipe"
            print(f"{loaded.file}: the source is {kind}; there is nothing to pin")
            continue
        lock = write_pin(loaded, lambda text: print(text, file=sys.stderr), variants)
        for pin in lock.pins:
            what = pin.file if isinstance(pin, Pin) else pin.commit
            print(f"{shown_path(lock_path(loaded.path))}: {what}, {pin.size / 1e6:.1f} MB")
    return 0
