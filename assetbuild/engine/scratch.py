"""Light steps run on the spot, for a file that no recipe names yet: no store, no child process."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding


@dataclass(frozen=True)
class Scratch:
    """A folder in which steps run one after another; each reads what those before it wrote."""

    folder: Path

    def put(self, name: str, data: bytes) -> None:
        """Write an input."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)

    def link(self, name: str, file: Path) -> None:
        """Make a file of the user's an input, below a folder of inputs; twice is once."""
        link = self.folder / name
        if not link.exists():
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(file)

    def read(self, name: str) -> bytes:
        """An output."""
        return (self.folder / name).read_bytes()

    def run(self, step: Step) -> tuple[Finding, ...]:
        """What the step says; raises what it raises."""
        return tuple(step.run(Files(inputs=self.folder, outputs=self.folder)))


@contextmanager
def scratch() -> Iterator[Scratch]:
    """An empty folder, which is gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="assetbuild-") as folder:
        yield Scratch(Path(folder))
