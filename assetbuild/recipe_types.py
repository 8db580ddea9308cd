"""What the sections of a recipe are made of: base model, numbers with units, names, patterns."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Iterable
from functools import partial
from typing import Annotated, Any, Optional, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    WithJsonSchema,
    create_model,
)
from pydantic.fields import FieldInfo

_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_A_LENGTH, _A_SHARE = "a length such as `5 mm` or `0.005` (m)", "a share such as `2 %` or `0.02`"
_QUANTITY = re.compile(r"\s*([0-9.eE+-]+)\s*([a-zA-Z%]+)\s*")


class Model(BaseModel):
    """Base of all recipe models: frozen, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


M = TypeVar("M", bound=Model)


def unstated(model: type[M]) -> type[M]:
    """The same keys, all optional: None = not stated. For a patch on a model with defaults."""
    keys: dict[str, Any] = {  # Any: what create_model takes
        name: _optional(field) for name, field in model.model_fields.items()
    }
    return create_model(
        model.__name__, __base__=model, __module__=model.__module__, __doc__=model.__doc__, **keys
    )


def stated(model: Model) -> dict[str, Any]:  # Any: values of any key
    """Key -> value of what an `unstated` model says."""
    return {key: value for key, value in model if value is not None}


def _optional(field: FieldInfo) -> tuple[Any, FieldInfo]:  # Any: a type made just now
    """(type, field) of the same key where None is the default, which no constraint looks at."""
    kind: Any = field.annotation  # Any: as above
    for constraint in field.metadata:
        kind = Annotated[kind, constraint]
    optional = copy.copy(field)
    optional.default, optional.default_factory, optional.metadata = None, None, []
    return Optional[kind], optional  # noqa: UP045 # as above


MOST = 1e30
"""Squares and products of the recipe's numbers must be numbers."""


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError("must be finite")
    if abs(value) > MOST:
        raise ValueError(f"must be at most {MOST:g} in size: check its power of ten")
    return value


def _within_a_turn(value: float) -> float:
    if not abs(value) < 6.2832:
        in_rad = f"{value:g} degrees are {math.radians(value):.4g}"
        raise ValueError(f"must be an angle in radians, at most one turn: {in_rad}")
    return value


def _quantity(value: object, *, units: dict[str, float], expected: str) -> object:
    """`5 mm` in metres, `2 %` as 0.02; a plain number is in metres, or a share, already."""
    if not isinstance(value, str):
        return value
    match = _QUANTITY.fullmatch(value)
    try:
        if match is None:
            raise ValueError
        # Divided where that is exact: `5 mm` is the same number as 0.005.
        number, factor = float(match[1]), units[match[2]]
        return number / round(1.0 / factor)
    except (ValueError, KeyError):
        raise ValueError(f"expected {expected}, found `{value[:40]}`") from None


def _as_written(unit: str) -> WithJsonSchema:
    pattern = rf"^\s*[0-9.eE+-]+\s*({unit})\s*$"
    return WithJsonSchema(
        {"anyOf": [{"type": "number", "minimum": 0}, {"type": "string", "pattern": pattern}]}
    )


Real = Annotated[float, AfterValidator(_finite)]
Positive = Annotated[float, Field(gt=0), AfterValidator(_finite)]
NonNegative = Annotated[float, Field(ge=0), AfterValidator(_finite)]
Turn = Annotated[float, AfterValidator(_within_a_turn)]
Turns = tuple[Turn, Turn, Turn]
"""Roll, pitch and yaw, rad: more than one turn is meant in degrees."""
Length = Annotated[
    float,
    Field(ge=0),
    AfterValidator(_finite),
    BeforeValidator(partial(_quantity, units=_LENGTHS, expected=_A_LENGTH)),
    _as_written("um|mm|cm|m"),
]
"""Metres: `5 mm`, `0.5 cm`, `0.005 m`, or a number in metres."""
Share = Annotated[
    float,
    Field(ge=0),
    AfterValidator(_finite),
    BeforeValidator(partial(_quantity, units={"%": 1e-2}, expected=_A_SHARE)),
    _as_written("%"),
]
"""A share: `2 %`, or 0.02."""


_LISTED = re.compile(r"([^\\.^$*+?{}\[\]()]|\\[^A-Za-z0-9])*")
"""Names side by side: no length of it takes long to match."""


def listed(names: Iterable[str]) -> str:
    """A pattern for these names and no others."""
    return "|".join(map(re.escape, names))


def _pattern(text: str) -> str:
    if len(text) > 500 and not _LISTED.fullmatch(text):
        raise ValueError("a pattern may have at most 500 characters")
    try:
        re.compile(text)
    except (re.error, OverflowError, RecursionError) as error:
        raise ValueError(f"not a regular expression: {error}") from error
    return text


Pattern = Annotated[str, AfterValidator(_pattern)]
"""A regular expression that must match a whole name of the source."""
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,63}$")]
