"""The old name of `assetbuild.recipe_types`, for plug-ins of others; gone in the next version."""

from __future__ import annotations

import warnings

from assetbuild import recipe_types


def __getattr__(name: str) -> object:
    warnings.warn(
        f"import `{name}` from `assetbuild.recipe_types`: `assetbuild.quantities` is its old name",
        FutureWarning,
        stacklevel=2,
    )
    return getattr(recipe_types, name)
