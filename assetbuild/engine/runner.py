"""What runs actions, on this machine or on others."""

from __future__ import annotations

from abc import abstractmethod
from typing import Protocol, Self

from assetbuild.engine.actions import Action, Made
from assetbuild.engine.step import Step

ATTEMPTS = 2
"""How often a step is run whose process is killed by something else than our limits."""


class Runner(Protocol):
    """Runs actions from many threads; a context manager that ends what still runs."""

    @property
    @abstractmethod
    def places(self) -> int:
        """Steps that may run at once."""

    @property
    @abstractmethod
    def memory_mb(self) -> int:
        """Memory that steps in child processes may still take together."""

    @property
    @abstractmethod
    def closed(self) -> bool:
        """Is nothing started any more?"""

    @abstractmethod
    def run(self, action: Action) -> Made:
        """Run a step; its outputs are in the store afterwards. AssetBuildError.

        LostObjectError when the store lost one of its inputs.
        """

    @abstractmethod
    def prepare(self, step: Step) -> None:
        """Such a step comes next: what it needs to start may be made ready meanwhile."""

    @abstractmethod
    def close(self) -> None:
        """Kill all that runs; nothing is started any more."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
