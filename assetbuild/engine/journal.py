"""The journal: what each step of a build was made from when it was last seen, and why it ran.

One small file per build in the store; without it only `explain` knows less.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from assetbuild.engine.digest import canonical_json, digest_bytes, replace_file
from assetbuild.engine.keys import Parts

JOURNAL_FORMAT = 1


class Journal:
    """Key parts by label, of the last build with this name. Unreadable counts as empty."""

    def __init__(self, store_root: Path, build: str) -> None:
        self.path = store_root / "journal" / f"{digest_bytes(os.fsencode(build))[:32]}.json"
        self.build = build
        self._steps: dict[str, dict[str, Any]] = {}  # Any: JSON
        self._changed = False
        try:
            raw = json.loads(self.path.read_bytes())
            if raw["format"] == JOURNAL_FORMAT and raw["build"] == build:
                self._steps = {str(k): dict(v) for k, v in raw["steps"].items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            self._steps = {}

    def parts(self, label: str) -> Parts | None:
        """The key parts of the node when it was last built or found in the store."""
        parts = self._steps.get(label, {}).get("parts")
        return parts if isinstance(parts, dict) else None

    def last_run(self, label: str) -> tuple[str, list[Mapping[str, object]]] | None:
        """When the node last ran (UTC, ISO 8601) and why, as changes in JSON form."""
        ran = self._steps.get(label, {}).get("ran")
        if not isinstance(ran, dict) or not isinstance(ran.get("why"), list):
            return None
        return str(ran.get("at", "")), ran["why"]

    def saw(self, label: str, parts: Parts) -> None:
        """The node was found in the store."""
        entry = self._steps.setdefault(label, {})
        if entry.get("parts") != parts:
            entry["parts"] = parts
            self._changed = True

    def ran(self, label: str, parts: Parts, why: Sequence[Mapping[str, object]]) -> None:
        """The node ran, for these reasons."""
        at = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        self._steps[label] = {"parts": parts, "ran": {"at": at, "why": list(why)}}
        self._changed = True

    def save(self) -> None:
        """Replace the file at once; OSError passes."""
        if self._changed:
            entry = {"format": JOURNAL_FORMAT, "build": self.build, "steps": self._steps}
            replace_file(self.path, canonical_json(entry))
            self._changed = False


class JoinedJournal(Journal):
    """The journals of several builds that run as one graph: `go1:calf` is `calf` of `go1`."""

    def __init__(self, store_root: Path, builds: Mapping[str, str]) -> None:
        super().__init__(store_root, "\n".join(builds.values()))
        self._journals = {name: Journal(store_root, build) for name, build in builds.items()}

    def _of(self, label: str) -> tuple[Journal, str]:
        name, _, own = label.partition(":")
        return self._journals[name], own

    def parts(self, label: str) -> Parts | None:
        """See `Journal`."""
        journal, own = self._of(label)
        return journal.parts(own)

    def last_run(self, label: str) -> tuple[str, list[Mapping[str, object]]] | None:
        """See `Journal`."""
        journal, own = self._of(label)
        return journal.last_run(own)

    def saw(self, label: str, parts: Parts) -> None:
        """See `Journal`."""
        journal, own = self._of(label)
        journal.saw(own, parts)

    def ran(self, label: str, parts: Parts, why: Sequence[Mapping[str, object]]) -> None:
        """See `Journal`."""
        journal, own = self._of(label)
        journal.ran(own, parts, why)

    def save(self) -> None:
        """See `Journal`."""
        for journal in self._journals.values():
            journal.save()
