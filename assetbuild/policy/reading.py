"""Files of policies as plain data: YAML that other programs dumped, with whatever tags."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from assetbuild.errors import UsageError, Where
from assetbuild.facts import plain_yaml

LARGEST_BYTES = 4 << 20


def read_yaml(path: Path) -> dict[str, Any]:  # Any: plain data, here and below
    """The mapping in a file, without tags of Python's objects: nothing is made of them.

    UsageError with the line where it is no YAML.
    """
    import yaml

    class Loader(yaml.SafeLoader):
        pass

    def untagged(loader: Loader, _: str, node: Any) -> Any:
        if isinstance(node, yaml.MappingNode):
            return loader.construct_mapping(node, deep=True)
        if isinstance(node, yaml.SequenceNode):
            return loader.construct_sequence(node, deep=True)
        return node.value

    Loader.add_multi_constructor("", untagged)
    if path.is_file() and path.stat().st_size > LARGEST_BYTES:
        raise UsageError(f"`{path.name}` has more than {LARGEST_BYTES >> 20} MB")
    return plain_yaml.read_yaml(path, Loader)


class Said:
    """A mapping of a file, read by path; UsageError names the path of what is missing or wrong."""

    def __init__(self, file: Path, values: Any, path: str = "") -> None:
        self.file, self.path = file, path
        self.values: dict[str, Any] = values if isinstance(values, dict) else {}

    def at(self, key: str) -> Said:
        """The mapping below a key; empty where there is none."""
        return Said(self.file, self.values.get(key), self._to(key))

    def need(self, key: str) -> Any:
        """The value at a key."""
        if self.values.get(key) is None:
            raise self.wrong(key, "it is missing")
        return self.values[key]

    def number(self, key: str, default: float | None = None) -> float:
        """A number."""
        value = self.need(key) if default is None else self.values.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.wrong(key, f"expected a number, found {_quoted(value)}")
        return float(value)

    def numbers(self, key: str, count: int, default: float | None = None) -> tuple[float, ...]:
        """`count` numbers; one number stands for all of them."""
        value = self.need(key) if default is None else self.values.get(key)
        value = default if value is None else value
        if isinstance(value, int | float) and not isinstance(value, bool):
            return (float(value),) * count
        if not isinstance(value, list) or not all(isinstance(v, int | float) for v in value):
            raise self.wrong(key, f"expected {count} numbers, found {_quoted(value)}")
        if len(value) != count:
            raise self.wrong(key, f"expected {count} numbers, found {len(value)}")
        return tuple(map(float, value))

    def scale(self) -> tuple[float, ...]:
        """An observation's scale: one number, or one for each of its own."""
        value = self.values.get("scale")
        return self.numbers("scale", len(value) if isinstance(value, list) else 1, 1.0)

    def clip(self) -> tuple[float, float] | None:
        """An observation's (least, most); None where it is not clipped."""
        value = self.values.get("clip")
        if value is None:
            return None
        low, high = self.numbers("clip", 2) if isinstance(value, list) else (1.0, 0.0)
        if not low <= high:
            raise self.wrong("clip", f"expected the least and the most, found {_quoted(value)}")
        return low, high

    def wrong(self, key: str, what: str) -> UsageError:
        """The error about a key."""
        return UsageError(f"{self._to(key)}: {what}", where=Where(self.file.name))

    def _to(self, key: str) -> str:
        return ".".join(filter(None, (self.path, key)))


def places(mapping: Said, key: str, names: Sequence[str]) -> tuple[str, ...]:
    """The names at the places that a list states, each at most once; all where it is a slice."""
    value = mapping.values.get(key)
    if value is None or value in ([None] * 3, "slice(None, None, None)"):
        return tuple(names)
    if not isinstance(value, list) or not value:
        raise mapping.wrong(key, f"expected places of joints, found {_quoted(value)}")
    for place in value:
        if isinstance(place, bool) or not isinstance(place, int) or not 0 <= place < len(names):
            raise mapping.wrong(key, f"{_quoted(place)} is no place among {len(names)} joints")
    if len(set(value)) < len(value):
        raise mapping.wrong(key, "it names one place twice")
    return tuple(names[place] for place in value)


def numbers_of(mapping: Said) -> dict[str, float]:
    """What is stated as a plain number."""
    return {
        key: float(value)
        for key, value in mapping.values.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }


def _quoted(value: object) -> str:
    return f"`{str(value)[:60]}`"
