"""What `assetbuild smoke` does before and after a build: environments, verdicts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

from assetbuild.engine.world import World
from assetbuild.errors import MachineError
from assetbuild.kinds import Check
from assetbuild.plugins import load_plugin, plugin_names
from assetbuild.recipe.models import Recipe
from assetbuild.report.document import Report
from assetbuild.report.verdict import TRAINER_CHECKS
from assetbuild.simulators.consumers import ConsumerCheck


def check_of(consumer: str) -> type[ConsumerCheck]:
    """The check that asks this consumer."""
    check = load_plugin(Check, check_name(consumer))
    assert issubclass(check, ConsumerCheck)  # noqa: S101 # all of that name are
    return check


def check_name(consumer: str) -> str:
    """Of its check: one that trains nothing is called as it is."""
    name = f"{TRAINER_CHECKS}{consumer}"
    return name if name in plugin_names(Check) else consumer


def environments_to_make(consumers: Sequence[str]) -> list[str]:
    """For each environment that is missing: what is downloaded, and where it goes."""
    homes = [(consumer, check_of(consumer).home) for consumer in consumers]
    return [
        f"{name} needs an environment of its own, made once: {home.size or 'size unknown'}, "
        f"in {home.folder}"
        for name, home in homes
        if home.requirements and home.python(World()) is None
    ]


def make_environments(consumers: Sequence[str], say: Callable[[str], None]) -> None:
    """Make those that pip can make. MachineError where one cannot be had."""
    for consumer in consumers:
        check = check_of(consumer)
        if check.home.requirements:
            check.home.make(say)
        elif check.home.python(World()) is None:
            raise MachineError(f"{consumer} is not installed here", hint=check.absent())


def asking(recipe: Recipe, consumers: Sequence[str]) -> dict[str, object]:
    """The sections of a recipe that asks these consumers, with the targets that they read."""
    smoke = tuple(dict.fromkeys((*recipe.validate_.smoke, *consumers)))
    needs = [need for consumer in smoke for need in check_of(consumer).needs]
    targets = tuple(dict.fromkeys((*recipe.targets, *needs)))
    asked = recipe.validate_.model_copy(update={"smoke": smoke})
    return {"validate_": asked, "targets": targets}


def lacks(reports: Iterable[Report], consumers: Sequence[str]) -> Iterator[str]:
    """Consumers that were asked for and did not run, with the reason."""
    for report in reports:
        for consumer in consumers:
            result = report.checks.get(check_name(consumer))
            if result is None or result.status == "skip":
                why = result.note if result else "its check did not run"
                yield f"{report.robot}: {consumer} was not asked: {why}"
