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
from pathlib import Path
from typing import Any

from assetbuild.engine.actions import Parts
from assetbuild.engine.digest import canonical_json, digest_bytes, replace_file

JOURNAL_FORMAT = 3
TORN = (ValueError, LookupError, TypeError, AttributeError, RecursionError, zlib.error)
"""What a file that is torn or foreign can cause."""
Steps = dict[str, dict[str, Any]]  # Any: JSON
"""What is noted of each step, by its label."""


class Journal:
    """Key parts by label, of the last build with this name. Unreadable counts as empty.

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

    def _read(self, build: str) -> Steps:
        try:
            raw = json.loads(zlib.decompress(self._file(build).read_bytes()))
            if raw["format"] == JOURNAL_FORMAT and raw["build"] == build:
                return {label: dict(noted) for label, noted in raw["steps"].items()}
        except (OSError, *TORN):
            pass
        return {}

    def _place(self, label: str) -> tuple[str, str]:
        """The part that a node belongs to, and its label there."""
        if "" in self._builds:
            return "", label
        part, _, part_label = label.partition(":")
        return part, part_label

    def _noted(self, label: str) -> dict[str, Any]:  # Any: JSON
        part, part_label = self._place(label)
        return self._steps[part].get(part_label, {})

    def _note(self, label: str, entry: dict[str, Any]) -> None:  # Any: JSON
        part, part_label = self._place(label)
        self._steps[part][part_label] = entry
        self._changed.add(part)

    def log_path(self, label: str) -> Path:
        """Where the log of a node of this build lies, if its last run left one."""
        name = re.sub(r"[^\w.-]+", "_", label, flags=re.ASCII)[:80]
        return self._logs / f"{name}-{digest_bytes(label.encode())[:6]}.log"

    def parts(self, label: str) -> Parts | None:
        """The key parts of the node when it was last built or found in the store."""
        parts = self._noted(label).get("parts")
        return parts if isinstance(parts, dict) else None

    def last_run(self, label: str) -> tuple[str, list[Mapping[str, object]]] | None:
        """When the node last ran (UTC, ISO 8601) and why, as changes in JSON form."""
        ran = self._noted(label).get("ran")
        if not isinstance(ran, dict) or not isinstance(ran.get("why"), list):
            return None
        return str(ran.get("at", "")), ran["why"]

    def last_seconds(self, label: str) -> float | None:
        """What the node took when it last ran: of the processor, or a download by the clock."""
        ran = self._noted(label).get("ran")
        seconds = ran.get("seconds") if isinstance(ran, dict) else None
        return float(seconds) if isinstance(seconds, int | float) else None

    def saw(self, label: str, parts: Parts) -> None:
        """The node was found in the store."""
        noted = self._noted(label)
        if noted.get("parts") != parts:
            self._note(label, {**noted, "parts": parts})

    def ran(
        self, label: str, parts: Parts, why: Sequence[Mapping[str, object]], seconds: float
    ) -> None:
        """The node ran, for these reasons, and took so long."""
        at = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        self._note(label, {"parts": parts, "ran": {"at": at, "why": list(why), "seconds": seconds}})

    def save(self) -> None:
        """Replace each file at once; OSError passes."""
        for part in sorted(self._changed):
            build = self._builds[part]
            entry = {"format": JOURNAL_FORMAT, "build": build, "steps": self._steps[part]}
            # Steps have most of their code and libraries in common.
            replace_file(self._file(build), zlib.compress(canonical_json(entry), 1))
        self._changed.clear()
