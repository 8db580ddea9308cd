"""The key of a step: everything that decides its outputs, and nothing else."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from typing import Any

from assetbuild.engine.cpu import cpu_model, platform_tag
from assetbuild.engine.digest import canonical_json, digest_bytes
from assetbuild.engine.step import Step

Parts = dict[str, Any]  # Any: JSON
"""The parts of one key as plain JSON data; `explain` compares two of them."""

KEY_FORMAT = 1
"""Raised when the engine itself makes other outputs of the same parts."""


def key_parts(step: Step, inputs: Mapping[str, str]) -> Parts:
    """What decides the outputs of a step; `inputs`: name -> digest."""
    fields = step.model_dump(mode="json")
    return {
        "format": KEY_FORMAT,
        "step": f"{type(step).__module__}:{type(step).__qualname__}",
        "version": step.version,
        "tools": {name: tool_version(name) for name in sorted(step.tools)},
        "fields": fields,
        # A step may go through a mapping in its order, so the order is part of the key.
        "order": digest_bytes(json.dumps(fields).encode())[:16],
        "inputs": dict(sorted(inputs.items())),
        "outputs": list(step.outputs),
        "platform": f"{platform_tag()} {cpu_model()}" if step.cpu_bound else platform_tag(),
    }


def key_of(parts: Parts) -> str:
    """SHA-256 of the parts' canonical JSON."""
    return digest_bytes(canonical_json(parts))


@functools.cache
def tool_version(distribution: str) -> str:
    """The installed version of a distribution, or `not installed`."""
    from importlib import metadata

    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"
