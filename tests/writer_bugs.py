"""Bugs planted in the text of a writer's own functions."""

from __future__ import annotations

import inspect
import sys
from types import ModuleType

import pytest


def plant(patch: pytest.MonkeyPatch, owner: type | ModuleType, name: str, old: str, new: str):
    """Replaces `old` in the source of a function of a module or class until the test ends."""
    text = inspect.getsource(inspect.getattr_static(owner, name))
    assert old in text, text
    text = f"if True:\n{text}" if isinstance(owner, type) else text  # a method is indented
    module = sys.modules[owner.__module__] if isinstance(owner, type) else owner
    made: dict[str, object] = {}
    exec(text.replace(old, new), vars(module), made)  # noqa: S102 - our own source
    patch.setattr(owner, name, made[name])
