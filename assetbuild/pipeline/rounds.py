"""Plan and execute until no question is open: what a plan asks for decides what it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from assetbuild.engine.execute import Event, NodeResult, execute
from assetbuild.engine.graph import Planner
from assetbuild.engine.session import Session
from assetbuild.errors import AssetBuildError

T = TypeVar("T")
Results = dict[str, NodeResult]


@dataclass(frozen=True)
class Settled(Generic[T]):
    """The last plan, and what became of its steps; of a failed round what there was."""

    outline: T
    planner: Planner
    results: Results

    @property
    def errors(self) -> tuple[AssetBuildError, ...]:
        """Of the steps that failed, in the order of the graph."""
        return tuple(result.error for result in self.results.values() if result.error)


def settle(
    add: Callable[[Planner], T],
    session: Session,
    on_event: Callable[[Event], None],
    *,
    jobs: int | None = None,
    after: Callable[[Mapping[str, NodeResult]], None] = lambda results: None,
) -> Settled[T]:
    """Rounds until the plan has all answers, or a step failed.

    add: puts the steps into a planner, as far as the answers reach. after: sees each round.
    """
    while True:
        planner = Planner(session)
        outline = add(planner)
        results = execute(planner.graph(), session, jobs=jobs, on_event=on_event)
        after(results)
        settled = Settled(outline, planner, results)
        if settled.errors or not planner.questions:
            return settled
