"""The checks of a recipe: those that run in any build, and those that it asks for by name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

from assetbuild.facts.reader import Reader
from assetbuild.grouping import grouped
from assetbuild.plugin_types import Check
from assetbuild.plugins import load_plugin, own_names
from assetbuild.recipe.models import Recipe

USUAL = "mujoco"
"""The engine that runs where a recipe names none."""


@dataclass(frozen=True)
class Asked:
    """One request. key: of the recipe; checks: at least one of them must run.

    lack: why none can, where the recipe itself is the reason.
    """

    key: str
    checks: tuple[str, ...]
    lack: str


def asked(recipe: Recipe) -> tuple[Asked, ...]:
    """Stated sections of `validate`, entries of its lists, and simulators besides MuJoCo."""
    checks = dict(checks_of(recipe))
    return tuple(
        Asked(key, names, _lack([checks[name] for name in names], recipe))
        for key, names in _requests(checks, recipe)
    )


def checks_of(recipe: Recipe) -> Iterator[tuple[str, type[Check]]]:
    """(name, check) of assetbuild's own checks and of the foreign ones that the recipe names."""
    for name in own_names(Check):
        yield name, load_plugin(Check, name)
    for name in recipe.foreign_checks:
        with suppress(KeyError):
            if recipe.value(f"validate.{name}") is None:
                continue  # `validate: {wind: null}`
        yield name, load_plugin(Check, name)


def readers_of(recipe: Recipe) -> Iterator[tuple[str, type[Reader]]]:
    """(name, reader) of assetbuild's own readers and of those of the foreign targets."""
    for name in sorted((*own_names(Reader), *recipe.foreign_readers)):
        yield name, load_plugin(Reader, name)


def _requests(
    checks: dict[str, type[Check]], recipe: Recipe
) -> Iterator[tuple[str, tuple[str, ...]]]:
    for word in sorted(recipe.stated("validate")):
        key = f"validate.{word}"
        names = tuple(name for name, check in checks.items() if _is_about(check, key))
        if names and recipe.value(key) is not None:
            yield key, names
    listed = ((check.listed_in, check.listed_as(), n) for n, check in checks.items())
    by_word = grouped((each for each in listed if each[0]), lambda each: each[:2])
    for (listed_in, word), same in sorted(by_word.items()):
        if word in recipe.value(listed_in):
            yield listed_in, tuple(name for _, _, name in same)
    for engine in recipe.value("validate.simulators"):
        if engine != USUAL:
            names = tuple(name for name, check in checks.items() if engine in check.engines)
            yield "validate.simulators", names


def _is_about(check: type[Check], key: str) -> bool:
    """Whether a section is a check's; what a list names runs by that list, not by its limits."""
    return check.section == key or (key in check.sections and not check.listed_in)


def _lack(checks: Sequence[type[Check]], recipe: Recipe) -> str:
    """What the recipe withholds from all of these checks; "" = nothing."""
    have = {*recipe.targets, "source", "source_mjcf"}
    simulators = recipe.value("validate.simulators")
    wanted = [check for check in checks if set(check.engines) <= set(simulators)]
    if all(set(check.needs) - have for check in wanted or checks):
        missing = sorted({need for check in wanted or checks for need in set(check.needs) - have})
        return f"`targets` lacks {', '.join(f'`{name}`' for name in missing)}"
    if not wanted:
        return f"`validate.simulators` names {', '.join(f'`{name}`' for name in simulators)} alone"
    return ""
