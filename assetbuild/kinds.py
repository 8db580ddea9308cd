"""The old name of `assetbuild.plugin_types`, for plug-ins of others; gone in the next version."""

from __future__ import annotations

from assetbuild import plugin_types
from assetbuild.findings import moved

__getattr__ = moved("assetbuild.kinds", plugin_types)
