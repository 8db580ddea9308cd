"""The key of a step: everything that decides its outputs, and nothing else."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from assetbuild.engine.code import PYTHON, Code
from assetbuild.engine.cpu import cpu_class, cpu_model, platform_tag
from assetbuild.engine.digest import canonical_json, digest_bytes
from assetbuild.engine.step import Step

Parts = dict[str, Any]  # Any: JSON
"""The parts of one key as plain JSON data; `explain` compares two of them."""

KEY_FORMAT = 2
"""Raised when the engine, which runs the steps, makes other outputs of the same parts."""


def key_parts(step: Step, inputs: Mapping[str, str], code: Code) -> Parts:
    """What decides the outputs of a step; `inputs`: name -> digest."""
    fields, own = step.model_dump(mode="json"), code.of(type(step))
    return {
        "format": KEY_FORMAT,
        "step": f"{type(step).__module__}:{type(step).__qualname__}",
        "code": own.modules,
        "libraries": own.libraries,
        "python": PYTHON,
        "fields": fields,
        # A step may go through a mapping in its order, so the order is part of the key.
        "order": digest_bytes(json.dumps(fields).encode())[:16],
        "inputs": dict(sorted(inputs.items())),
        "outputs": list(step.outputs),
        "platform": f"{platform_tag()} {cpu_model()}" if step.cpu_bound else platform_tag(),
        "kernels": cpu_class().environment,
    }


def key_of(parts: Parts) -> str:
    """SHA-256 of the parts' canonical JSON."""
    return digest_bytes(canonical_json(parts))
