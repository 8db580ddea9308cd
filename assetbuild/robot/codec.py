"""Frozen values of `robot.model` to canonical JSON bytes and back: dataclasses, pydantic models.

Canonical: sorted keys, no spaces, floats by shortest round-trip `repr`, unions tagged with the
class name. Equal values give equal bytes; decoding gives equal values.
"""

from __future__ import annotations

import functools
import json
import types
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel

T = TypeVar("T")


def encode(value: object) -> bytes:
    """Canonical JSON of a model value; raises ValueError for NaN and infinities."""
    text = json.dumps(_plain(value), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return text.encode("ascii") + b"\n"


def decode(cls: type[T], data: bytes) -> T:
    """The model value that `encode` wrote; raises ValueError on anything else."""
    try:
        return _typed(cls, json.loads(data))  # type: ignore[no-any-return] # checked by _typed
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(f"not a stored {cls.__name__}: {error}") from error


def decode_file(cls: type[T], file: Path) -> T:
    """The model value that stands in `file`."""
    return decode(cls, file.read_bytes())


def _plain(value: object) -> object:
    kind: Any = type(value)  # Any: mypy holds a type to be unhashable
    names = _names(kind)
    if names:
        plain = {name: _plain(getattr(value, name)) for name in names}
        return {"type": type(value).__name__, **plain}
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value


def _typed(kind: Any, raw: Any) -> Any:  # Any: walks type hints, which mypy cannot describe
    origin = get_origin(kind)
    if origin in (Union, types.UnionType):
        return _typed_union(kind, raw)
    if origin is tuple:
        items = get_args(kind)
        if len(items) == 2 and items[1] is Ellipsis:
            return tuple(_typed(items[0], item) for item in raw)
        if len(items) != len(raw):
            raise TypeError(f"expected {len(items)} values, found {len(raw)}")
        return tuple(_typed(item, value) for item, value in zip(items, raw, strict=True))
    if origin is Literal:
        if raw not in get_args(kind):
            raise TypeError(f"{raw!r} is not one of {get_args(kind)}")
        return raw
    names = _names(kind)
    if names:
        if raw["type"] != kind.__name__:
            raise TypeError(f"expected {kind.__name__}, found {raw['type']}")
        hints = _hints(kind)
        # A bundle of an earlier version lacks the fields that came later; they have defaults.
        there = [name for name in names if name in raw or not is_dataclass(kind)]
        values = {name: _typed(hints[name], raw[name]) for name in there}
        # A source may say what a recipe may not: the bounds of a model are the recipe's.
        make: Any = kind if is_dataclass(kind) else kind.model_construct  # Any: of any class
        return make(**values)
    if kind is float and isinstance(raw, int | float) and not isinstance(raw, bool):
        return float(raw)
    if not isinstance(raw, kind):
        raise TypeError(f"expected {kind.__name__}, found {raw!r}")
    return raw


@functools.cache
def _names(kind: Any) -> tuple[str, ...]:
    """The fields of a dataclass or model; none of anything else."""
    if is_dataclass(kind):
        return tuple(field.name for field in fields(kind))
    return tuple(kind.model_fields) if issubclass(kind, BaseModel) else ()


@functools.cache
def _hints(kind: type) -> dict[str, Any]:  # Any: as above
    return get_type_hints(kind)


def _typed_union(kind: Any, raw: Any) -> Any:  # Any: as above
    if raw is None and type(None) in get_args(kind):
        return None
    options = [option for option in get_args(kind) if option is not type(None)]
    if isinstance(raw, dict) and len(options) > 1:
        options = [option for option in options if option.__name__ == raw["type"]]
    if len(options) != 1:
        raise TypeError(f"no single type for {raw!r}")
    return _typed(options[0], raw)
