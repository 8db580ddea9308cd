"""Frozen values of `robot.model` to canonical JSON bytes and back: dataclasses, pydantic models.

Canonical: sorted keys, no spaces, floats by shortest round-trip `repr`, unions tagged with the
class name. Equal values give equal bytes; decoding gives equal values.
"""

from __future__ import annotations

import functools
import json
import types
from collections.abc import Callable
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
    kind: Any = cls  # Any: mypy holds a type to be unhashable
    try:
        return reader_of(kind)(json.loads(data))  # type: ignore[no-any-return] # checked by the reader
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


Read = Callable[[Any], Any]  # Any: plain JSON to a value, by type hints that mypy cannot describe


@functools.cache
def reader_of(kind: Any) -> Read:  # Any: as above
    """What turns plain JSON into a value of a type; it raises TypeError or KeyError."""
    origin, args = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return _union_reader(args)
    if origin is tuple:
        return _tuple_reader(args)
    if origin is Literal:
        return functools.partial(_one_of, args)
    return _model_reader(kind) if _names(kind) else functools.partial(_plain_value, kind)


def _one_of(known: tuple[object, ...], raw: object) -> object:
    if raw not in known:
        raise TypeError(f"{raw!r} is not one of {known}")
    return raw


def _plain_value(kind: type, raw: Any) -> object:  # Any: as above
    if kind is float and isinstance(raw, int | float) and not isinstance(raw, bool):
        return float(raw)
    if not isinstance(raw, kind):
        raise TypeError(f"expected {kind.__name__}, found {raw!r}")
    return raw


def _tuple_reader(items: tuple[Any, ...]) -> Read:  # Any: as above
    if len(items) == 2 and items[1] is Ellipsis:
        every = reader_of(items[0])
        return lambda raw: tuple(map(every, raw))
    readers = tuple(reader_of(item) for item in items)

    def read(raw: Any) -> Any:  # Any: as above
        if len(readers) != len(raw):
            raise TypeError(f"expected {len(readers)} values, found {len(raw)}")
        return tuple(one(value) for one, value in zip(readers, raw, strict=True))

    return read


def _model_reader(kind: Any) -> Read:  # Any: as above
    names, hints = _names(kind), get_type_hints(kind)
    readers = [(name, reader_of(hints[name])) for name in names]
    is_plain = is_dataclass(kind)
    # A source may say what a recipe may not: the bounds of a model are the recipe's.
    make: Any = kind if is_plain else kind.model_construct  # Any: of any class

    def read(raw: Any) -> Any:  # Any: as above
        if raw["type"] != kind.__name__:
            raise TypeError(f"expected {kind.__name__}, found {raw['type']}")
        # A bundle of an earlier version lacks the fields that came later; they have defaults.
        return make(**{n: one(raw[n]) for n, one in readers if n in raw or not is_plain})

    return read


def _union_reader(kinds: tuple[Any, ...]) -> Read:  # Any: as above
    options = [kind for kind in kinds if kind is not type(None)]
    named = {kind.__name__: reader_of(kind) for kind in options}

    def read(raw: Any) -> Any:  # Any: as above
        if raw is None and len(options) < len(kinds):
            return None
        return named[raw["type"] if len(options) > 1 else options[0].__name__](raw)

    return read


@functools.cache
def _names(kind: Any) -> tuple[str, ...]:
    """The fields of a dataclass or model; none of anything else."""
    if is_dataclass(kind):
        return tuple(field.name for field in fields(kind))
    return tuple(kind.model_fields) if issubclass(kind, BaseModel) else ()
