"""Recipes on a command line: `recipes/*.yaml` names their locks as well."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any


class Recipes(argparse.Action):
    """Each recipe once; a lock stands for its recipe."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,  # Any: as argparse has it
        option_string: str | None = None,
    ) -> None:
        """Store them."""
        setattr(namespace, self.dest, recipes_of([Path(value) for value in values or ()]))


def recipes_of(named: Sequence[Path]) -> list[Path]:
    """`a.yaml` for `a.yaml` and `a.lock.yaml`, in the order of the command line."""
    return list(dict.fromkeys(p.with_name(p.name.replace(".lock.", ".")) for p in named))
