"""Actions: steps whose inputs are known by digest; and what each of them made, by its key.

The key of a step holds everything that decides its outputs, and nothing else.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Protocol

from assetbuild.engine.code import PYTHON, Code
from assetbuild.engine.cpu import cpu_class, cpu_model, platform_tag
from assetbuild.engine.digest import canonical_json, digest_bytes
from assetbuild.engine.step import Step
from assetbuild.engine.store import LostObjectError, Store
from assetbuild.findings import Finding, finding_from_json

Parts = dict[str, Any]  # Any: JSON
"""The parts of one key as plain JSON data; `explain` compares two of them."""

KEY_FORMAT = 2
"""Raised when the engine, which runs the steps, makes other outputs of the same parts."""


def key_parts(step: Step, inputs: Mapping[str, str], code: Code) -> Parts:
    """What decides the outputs of a step; `inputs`: name -> digest."""
    fields, step_code = step.model_dump(mode="json"), code.of(type(step))
    return {
        "format": KEY_FORMAT,
        "step": f"{type(step).__module__}:{type(step).__qualname__}",
        "code": step_code.modules,
        "libraries": step_code.libraries,
        "python": PYTHON,
        "fields": fields,
        # A step may go through a mapping in its order, so the order is part of the key.
        "order": digest_bytes(json.dumps(fields).encode())[:16],
        "inputs": dict(sorted(inputs.items())),
        "outputs": list(step.outputs),
        "platform": f"{platform_tag()} {cpu_model()}" if step.cpu_bound else platform_tag(),
        "kernels": cpu_class().environment,
    }


@dataclass(frozen=True)
class Action:
    """A step on inputs with known digests: all that running it takes.

    parts: of its key; the inputs are among them.
    """

    label: str
    step: Step
    parts: Parts

    @cached_property
    def key(self) -> str:
        """SHA-256 of the parts' canonical JSON."""
        return digest_bytes(canonical_json(self.parts))

    @property
    def inputs(self) -> Mapping[str, str]:
        """Name -> digest."""
        inputs: Mapping[str, str] = self.parts["inputs"]
        return inputs


@dataclass(frozen=True)
class Made:
    """What a step with a known key made, when it last ran.

    outputs: name -> digest. seconds: wall clock; cpu_seconds: of its child process, else 0.
    attempts: processes that it took just now; 1 where an earlier run made it.
    """

    outputs: Mapping[str, str]
    findings: tuple[Finding, ...] = ()
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    child: bool = False
    attempts: int = 1

    def to_json(self) -> dict[str, object]:
        """The action entry."""
        return asdict(self)


class SharedCache(Protocol):
    """A cache shared with other machines; whatever goes wrong there is a miss."""

    def get(self, key: str, store: Store, *, again: bool = False) -> Made | None:
        """What a step with this key made elsewhere, all its objects now in the store."""
        ...

    def put(self, key: str, made: Made, store: Store) -> bool:
        """Send what a step with this key made. Is it there?"""
        ...


class Actions:
    """What is known by key, in this store and in the shared cache. Threads may share it."""

    def __init__(self, store: Store, shared: SharedCache | None = None) -> None:
        self._store = store
        self._shared = shared
        self._known: dict[str, Made] = {}

    def known(self, key: str) -> Made | None:
        """What a step with this key made, if all of it is still in the store."""
        if key not in self._known:
            made = self._stored(key)
            if made is not None:
                self._store.touch_action(key)
            elif (made := self._fetched(key)) is not None:
                self._store.put_action(key, made.to_json())
            else:
                return None
            self._known[key] = made
        return self._known[key]

    def made_elsewhere(self, key: str) -> Made | None:
        """What a worker on another machine made just now, from this store or the shared cache."""
        return self._stored(key) or self._fetched(key, again=True)

    def learn(self, key: str, made: Made) -> None:
        """Remember what a step made, in the store, here and in the shared cache."""
        self._store.put_action(key, made.to_json())
        self._known[key] = made
        if self._shared is not None:
            self._shared.put(key, made, self._store)

    def forget(self) -> None:
        """An object was lost: look again which results are whole."""
        self._known.clear()

    def _stored(self, key: str) -> Made | None:
        return self._whole(made_from_json(self._store.action(key)))

    def _fetched(self, key: str, *, again: bool = False) -> Made | None:
        return self._whole(
            self._shared.get(key, self._store, again=again) if self._shared else None
        )

    def _whole(self, made: Made | None) -> Made | None:
        """The same, if all its outputs are in the store."""
        return None if made is None or missing_output(self._store, made) else made


def made_from_json(raw: Mapping[str, object] | None) -> Made | None:
    """Inverse of `Made.to_json`; None on foreign data, or on none."""
    if raw is None:
        return None
    try:
        outputs, findings = raw["outputs"], raw["findings"]
        if not isinstance(outputs, dict) or not isinstance(findings, list):
            return None
        return Made(
            outputs={str(k): str(v) for k, v in outputs.items()},
            findings=tuple(finding_from_json(f) for f in findings),
            seconds=float(str(raw["seconds"])),
            cpu_seconds=float(str(raw["cpu_seconds"])),
            child=bool(raw["child"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError):
        return None


def missing_output(store: Store, made: Made) -> str:
    """The first output that is no longer whole in the store, or nothing."""
    for name, digest in sorted(made.outputs.items()):
        try:
            objects = store.sizes({name: digest})
        except LostObjectError:
            return name
        if not all(map(store.has, objects)):
            return name
    return ""
