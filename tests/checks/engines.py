"""Tests that another engine runs, where it is installed."""

from __future__ import annotations

from importlib.util import find_spec

import pytest

from assetbuild.engine.world import World
from assetbuild.simulators.newton import HOME

needs_physx = pytest.mark.skipif(find_spec("ovphysx") is None, reason="needs the extra `physx`")
needs_newton = pytest.mark.skipif(
    HOME.python(World()) is None, reason="needs `assetbuild smoke RECIPE --consumer newton` once"
)
