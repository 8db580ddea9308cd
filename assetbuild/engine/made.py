"""What a step made, as the store remembers it under the step's key."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from assetbuild.engine.store import LostObjectError, Store
from assetbuild.findings import Finding, finding_from_json


@dataclass(frozen=True)
class Made:
    """What a step with a known key made, when it last ran.

    outputs: name -> digest. seconds: wall clock; cpu_seconds: of its child process, else 0.
    attempts: processes that it took just now; not kept.
    """

    outputs: Mapping[str, str]
    findings: tuple[Finding, ...] = ()
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    child: bool = False
    attempts: int = 1

    def to_json(self) -> dict[str, object]:
        """The action entry."""
        return {
            "outputs": dict(self.outputs),
            "findings": [f.to_json() for f in self.findings],
            "seconds": self.seconds,
            "cpu_seconds": self.cpu_seconds,
            "child": self.child,
        }


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
