"""The old name of `assetbuild.recipe_types`, for plug-ins of others; gone in the next version."""

from __future__ import annotations

from assetbuild import recipe_types
from assetbuild.findings import moved

__getattr__ = moved("assetbuild.quantities", recipe_types)
