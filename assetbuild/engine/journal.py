"""The journal: what each step of a build was made from when it was last seen, why it ran, its log.

One small file per build in the store; without it only `explain` knows less.
"""

from __future__ import annotations

import json
import os
import re
import time
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from assetbuild.engine.actions import Parts
from assetbuild.engine.digest import canonical_json, digest_bytes, replace_file

JOURNAL_FORMAT = 4
TORN = (ValueError, LookupError, TypeError, AttributeError, RecursionError, zlib.error)
"""What a file that is torn or foreign can cause."""


@dataclass(frozen=True)
class Noted:
    """What is known of one step.

    parts: of its key, when it was last built or found in the store; None = never here.
    at: when it last ran (UTC, ISO 8601), "" = never here; why: the fields of each `Change`.
    seconds: what it took then, of the processor, or a download by the clock.
    """

    parts: Parts | None = None
    at: str = ""
    why: Sequence[Mapping[str, Any]] = ()  # Any: JSON
    seconds: float | None = None


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
                return {label: Noted(**noted) for label, noted in raw["steps"].items()}
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

    def ran(
        self, label: str, parts: Parts, why: Sequence[Mapping[str, object]], seconds: float
    ) -> None:
        """The node ran, for these reasons, and took so long."""
        at = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        self._note(label, Noted(parts, at, why, seconds))

    def save(self) -> None:
        """Replace each file at once; OSError passes."""
        for part in sorted(self._changed):
            build = self._builds[part]
            steps = {label: vars(noted) for label, noted in self._steps[part].items()}
            entry = {"format": JOURNAL_FORMAT, "build": build, "steps": steps}
            # Steps have most of their code and libraries in common.
            replace_file(self._file(build), zlib.compress(canonical_json(entry), 1))
        self._changed.clear()
