"""Plants mutations one by one in copies of a bundle and collects what the judges say."""

from __future__ import annotations

import random
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tests.mutations.bundle import form_of, mutations, planted
from tests.mutations.change import Mutation
from tests.mutations.judge import Judge, Verdict
from tests.mutations.meaning import Meaning, differ, meaning

Fate = Literal["refused", "same", "tried"]
"""refused: the format's own library does not take the file. same: the change means nothing."""


@dataclass(frozen=True)
class Result:
    """What became of one mutation."""

    mutation: Mutation
    fate: Fate
    verdict: Verdict | None = None


class Bench:
    """A copy of a bundle, what its files mean, and its judge."""

    def __init__(self, bundle: Path, folder: Path) -> None:
        """bundle: untouched; folder: where the copy goes."""
        self.bundle = Path(shutil.copytree(bundle, folder / "bundle"))
        self.judge = Judge(self.bundle, bundle)
        self.meanings: dict[str, Meaning] = {}

    def before(self, file: str) -> Meaning:
        """What a file of the untouched bundle means; the same stage for all layers."""
        key = "usd" if form_of(file) == "usd" and not file.endswith(".png") else file
        if key not in self.meanings:
            self.meanings[key] = meaning(self.bundle, file)
        return self.meanings[key]

    def try_one(self, mutation: Mutation) -> Result:
        """Plants one mutation, judges, and takes it out again."""
        before = self.before(mutation.file)
        try:
            with planted(self.bundle, mutation):
                after = meaning(self.bundle, mutation.file)
                if after is None:
                    return Result(mutation, "refused")
                if not differ(before, after):
                    return Result(mutation, "same")
                return Result(mutation, "tried", self.judge.ask(mutation.file))
        except PlantError:
            return Result(mutation, "refused")


PlantError = (ValueError, RuntimeError, TypeError)
"""A library that does not write such a value."""


def sample(bundle: Path, forms: Sequence[str], seed: int, count: int) -> list[Mutation]:
    """So many mutations of each format, drawn evenly from all."""
    random_ = random.Random(seed)
    drawn: list[Mutation] = []
    for form in forms:
        found = mutations(bundle, (form,), seed)
        random_.shuffle(found)
        drawn += found[:count]
    return drawn


def try_all(bundle: Path, chosen: Sequence[Mutation]) -> Iterator[Result]:
    """Results in the order of the mutations."""
    with tempfile.TemporaryDirectory(prefix="mutations-") as name:
        yield from map(Bench(bundle, Path(name)).try_one, chosen)
