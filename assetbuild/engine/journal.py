"""The journal: what each step of a build was made from when it was last seen, why it ran, its log.

One small file per build in the store; without it only `explain` knows less.
"""

from __future__ import annotations

import json
import os
import re
import time
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from pydantic import FiniteFloat, TypeAdapter

from assetbuild.engine.actions import Parts
from assetbuild.engine.digest import canonical_json, digest_bytes, replace_file

JOURNAL_FORMAT = 4
SHOWN_CHARACTERS = 60
"""Longer values are cut in a sentence."""
TORN = (ValueError, LookupError, TypeError, AttributeError, RecursionError, zlib.error)
"""What a file that is torn or foreign can cause."""


@dataclass(frozen=True)
class Change:
    """One reason to run.

    part: `first`, `step`, `code`, `library`, `kernel` (a variable that pins CPU kernels), `python`,
        `field`, `input`, `outputs`, `platform`, `format`, `order` (of the entries in the fields),
        `lost` (an output is missing or corrupt) or `forgotten` (the store has no result).
    name: of the module, library, variable, field, input or output. old, new: JSON data; None =
        absent.
    """

    part: str
    name: str = ""
    old: object = None
    new: object = None

    def __str__(self) -> str:
        match self.part:
            case "first":
                return "first build"
            case "lost":
                return f"output {self.name} is missing or corrupt in the store"
            case "order":
                return "the order of the entries in its fields"
            case "forgotten":
                return "the store does not hold its result"
        name = f"{self.part} {self.name}" if self.name else self.part
        if self.part in ("code", "input"):
            if self.old is None:
                return f"{name} is new"
            if self.new is None:
                return f"{name} is gone"
            digests = f" ({str(self.old)[:8]} -> {str(self.new)[:8]})"
            return f"{name} changed{digests if self.part == 'input' else ''}"
        return f"{name}: {_value_text(self.old)} -> {_value_text(self.new)}"

    def to_json(self) -> dict[str, object]:
        """Plain data: part, name, old, new, text."""
        return {**asdict(self), "text": str(self)}


def _value_text(value: object) -> str:
    if value is None:
        return "nothing"
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= SHOWN_CHARACTERS else text[: SHOWN_CHARACTERS - 3] + "..."


@dataclass(frozen=True)
class Noted:
    """What is known of one step.

    parts: of its key, when it was last built or found in the store; None = never here.
    at: when it last ran (UTC, ISO 8601), "" = never here; why: its reasons then.
    seconds: what it took then, of the processor, or a download by the clock.
    """

    parts: Parts | None = None
    at: str = ""
    why: tuple[Change, ...] = ()
    seconds: FiniteFloat | None = None


class Journal:
    """What is noted of steps, by label, in builds with this name. Unreadable counts as empty.

    builds: name of a part -> name of its build, for several builds that run as one graph: then
    `go1:calf` is `calf` of the part `go1`. A build of its own is the part with the empty name.
    """

    def __init__(self, store_root: Path, builds: Mapping[str, str]) -> None:
        self.name = "\n".join(builds.values())
        self._folder = store_root / "journal"
        self._logs = store_root / "logs" / digest_bytes(os.fsencode(self.name))[:12]
        self._builds = builds
        self._steps = {part: self._read(build) for part, build in builds.items()}
        self._changed: set[str] = set()

    def _file(self, build: str) -> Path:
        return self._folder / f"{digest_bytes(os.fsencode(build))[:32]}.zlib"

    def _read(self, build: str) -> dict[str, Noted]:
        try:
            raw = json.loads(zlib.decompress(self._file(build).read_bytes()))
            if raw["format"] == JOURNAL_FORMAT and raw["build"] == build:
                return TypeAdapter(dict[str, Noted]).validate_python(raw["steps"])
        except (OSError, *TORN):
            pass
        return {}

    def _place(self, label: str) -> tuple[str, str]:
        """The part that a node belongs to, and its label there."""
        part, _, part_label = label.partition(":")
        return (part, part_label) if part in self._builds else ("", label)

    def noted(self, label: str) -> Noted:
        """What is known of a node."""
        part, part_label = self._place(label)
        return self._steps[part].get(part_label, Noted())

    def _note(self, label: str, noted: Noted) -> None:
        part, part_label = self._place(label)
        self._steps[part][part_label] = noted
        self._changed.add(part)

    def log_path(self, label: str) -> Path:
        """Where the log of a node of this build lies, if its last run left one."""
        name = re.sub(r"[^\w.-]+", "_", label, flags=re.ASCII)[:80]
        return self._logs / f"{name}-{digest_bytes(label.encode())[:6]}.log"

    def saw(self, label: str, parts: Parts) -> None:
        """The node was found in the store."""
        noted = self.noted(label)
        if noted.parts != parts:
            self._note(label, replace(noted, parts=parts))

    def ran(self, label: str, parts: Parts, why: tuple[Change, ...], seconds: float) -> None:
        """The node ran, for these reasons, and took so long."""
        at = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        self._note(label, Noted(parts, at, why, seconds))

    def save(self) -> None:
        """Replace each file at once; OSError passes."""
        for part in sorted(self._changed):
            build = self._builds[part]
            noted = self._steps[part].items()
            steps = {label: {**vars(n), "why": list(map(vars, n.why))} for label, n in noted}
            entry = {"format": JOURNAL_FORMAT, "build": build, "steps": steps}
            # Steps have most of their code and libraries in common.
            replace_file(self._file(build), zlib.compress(canonical_json(entry), 1))
        self._changed.clear()
