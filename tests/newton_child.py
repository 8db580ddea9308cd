"""What Newton's program reads of a model: its file names `_moving` as its own process finds it."""

from __future__ import annotations

import sys

from assetbuild.simulators import _moving

sys.modules["_moving"] = _moving

from assetbuild.simulators.newton._child import KINDS, plain, readings  # noqa: E402

__all__ = ["KINDS", "plain", "readings"]
