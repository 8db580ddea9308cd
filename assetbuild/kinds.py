"""The old name of `assetbuild.plugin_types`, for plug-ins of others; gone in the next version."""

from __future__ import annotations

import warnings

from assetbuild import plugin_types


def __getattr__(name: str) -> object:
    warnings.warn(
        f"import `{name}` from `assetbuild.plugin_types`: `assetbuild.kinds` is its old name",
        FutureWarning,
        stacklevel=2,
    )
    return getattr(plugin_types, name)
