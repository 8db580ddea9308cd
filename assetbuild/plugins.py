"""Where plug-ins are found: files of this package, and entry points of other distributions.

A kind of plug-in is a step class with a `group`: `targets` stands for the files of
`assetbuild/targets/` and for the entry points of the group `assetbuild.targets`, each of which
names a module, or a class in one. A plug-in's name is its file's or its entry point's; where a
file of ours holds several, the table `IN_FILE` of its folder says which file has which name.

A plug-in of another distribution is imported where a recipe names it, and nowhere else: an
installed package changes nothing for robots that do not ask for it.
"""

from __future__ import annotations

import functools
import importlib
import pkgutil
import warnings
from collections.abc import Iterator, Mapping
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import TypeVar

from assetbuild.engine.step import Step
from assetbuild.errors import MachineError

P = TypeVar("P", bound=Step)


class PluginWarning(UserWarning):
    """A plug-in of another distribution that is left out, and why."""


def plugin_names(kind: type[Step]) -> tuple[str, ...]:
    """Names of the plug-ins of a kind; imports none of them."""
    return tuple(sorted((*_own(_group(kind)), *_foreign(_group(kind)))))


def own_names(kind: type[Step]) -> tuple[str, ...]:
    """Names of those that assetbuild itself brings."""
    return _own(_group(kind))


def foreign_names(kind: type[Step]) -> tuple[str, ...]:
    """Names of those that other distributions bring."""
    return tuple(sorted(_foreign(_group(kind))))


def usable_plugins(kind: type[P]) -> Iterator[tuple[str, type[P]]]:
    """(name, plug-in) of all that can be loaded; a PluginWarning names each that cannot."""
    for name in plugin_names(kind):
        try:
            yield name, load_plugin(kind, name)
        except MachineError as broken:
            warnings.warn(broken.message, PluginWarning, stacklevel=2)


def load_plugin(kind: type[P], name: str) -> type[P]:
    """The plug-in of a kind with this name.

    KeyError when there is none; MachineError, with its distribution, for one that cannot be loaded.
    """
    group = _group(kind)
    if name in _own(group):
        file = _files(group).get(name, name)
        module = importlib.import_module(f"assetbuild.{group}.{file}")
        return _only(kind, module, module.__name__, name)
    point, *others = _foreign(group)[name]
    if others:
        whose = " and of ".join(map(_distribution, (point, *others)))
        message = f"two plug-ins are called `{name}` ({group}): of {whose}"
        raise MachineError(message, hint="uninstall one of them")
    whose = f"plug-in `{name}` ({group}) of {_distribution(point)}"
    try:
        loaded = point.load()
    except (Exception, SystemExit) as problem:  # whatever a foreign module does on import
        message = f"{whose} cannot be loaded: {type(problem).__name__}: {problem}"
        raise MachineError(message, hint="repair or uninstall it") from problem
    plugin = _only(kind, loaded, whose) if isinstance(loaded, ModuleType) else loaded
    if not (isinstance(plugin, type) and issubclass(plugin, kind)):
        raise MachineError(f"{whose} is no {kind.__name__}", hint="repair or uninstall it")
    return plugin


def foreign_modules() -> tuple[str, ...]:
    """Top-level modules of other distributions that hold plug-ins; none of them is imported."""
    modules = (point.module for point in _points() if point.group.startswith("assetbuild."))
    return tuple(sorted({module.partition(".")[0] for module in modules}))


def _group(kind: type[Step]) -> str:
    return str(getattr(kind, "group"))  # noqa: B009 # a class constant of the kinds alone


@functools.cache
def _own(group: str) -> tuple[str, ...]:
    path = importlib.import_module(f"assetbuild.{group}").__path__
    names = [m.name for m in pkgutil.iter_modules(path) if not m.name.startswith("_")]
    return tuple(sorted((*names, *_files(group))))


def _files(group: str) -> Mapping[str, str]:
    """Plug-in -> the file that holds it beside others."""
    files: Mapping[str, str] = getattr(
        importlib.import_module(f"assetbuild.{group}"), "IN_FILE", {}
    )
    return files


@functools.cache
def _foreign(group: str) -> Mapping[str, tuple[EntryPoint, ...]]:
    """Entry points of other distributions, by name; a name of assetbuild's own is left out."""
    points: dict[str, tuple[EntryPoint, ...]] = {}
    for point in _points():
        if point.group != f"assetbuild.{group}":
            continue
        if point.name in _own(group):
            message = (
                f"plug-in `{point.name}` ({group}) of {_distribution(point)} is not used: "
                "assetbuild itself has one of this name"
            )
            warnings.warn(message, PluginWarning, stacklevel=2)
        else:
            points[point.name] = (*points.get(point.name, ()), point)
    return points


@functools.cache
def _points() -> tuple[EntryPoint, ...]:
    """The entry points of all distributions: reading them takes most of the time."""
    points = entry_points()
    return tuple(point for group in points.groups for point in points.select(group=group))


def _distribution(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist else "an unknown distribution"


def _only(kind: type[P], module: ModuleType, whose: str, name: str = "") -> type[P]:
    """The one subclass of `kind` that a module defines. name: of a plug-in among several."""
    classes = [
        value
        for value in vars(module).values()
        if isinstance(value, type) and value.__module__ == module.__name__
    ]
    subclasses = [value for value in classes if issubclass(value, kind)]
    if name:
        subclasses = [value for value in subclasses if value.step_name() == name]
    if len(subclasses) != 1:
        raise MachineError(
            f"{whose} must define exactly one {kind.__name__}, it defines {len(subclasses)}"
        )
    return subclasses[0]
