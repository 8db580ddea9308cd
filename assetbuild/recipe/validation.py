"""A tree of YAML nodes against a pydantic model; what is wrong becomes one readable error."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from assetbuild.errors import AssetBuildError, Gather, Where, did_you_mean
from assetbuild.recipe.schema import allowed_values, known_keys, meaning
from assetbuild.recipe.yaml_tree import Node, described, plain
from assetbuild.robot.actuator_table import RowError

M = TypeVar("M", bound=BaseModel)
Key = tuple[str | int, ...]

_SENTENCES = {
    "float_type": "expected a number, found {found}",
    "float_parsing": "expected a number, found {found}",
    "int_type": "expected a whole number, found {found}",
    "int_from_float": "expected a whole number, found {found}",
    "int_parsing": "expected a whole number, found {found}",
    "string_type": "expected text, found {found}",
    "bool_type": "expected `true` or `false`, found {found}",
    "tuple_type": "expected a list, found {found}",
    "list_type": "expected a list, found {found}",
    "dict_type": "expected a map, found {found}",
    "model_type": "expected a map, found {found}",
    "model_attributes_type": "expected a map, found {found}",
    "greater_than": "must be greater than {gt:g}, found {found}",
    "greater_than_equal": "must be at least {ge:g}, found {found}",
    "less_than": "must be less than {lt:g}, found {found}",
    "less_than_equal": "must be at most {le:g}, found {found}",
    "too_short": "must have {min_length} or more items, found {actual_length}",
    "too_long": "must have {max_length} or fewer items, found {actual_length}",
    "string_too_short": "must have {min_length} or more characters, found {found}",
    "string_too_long": "must have {max_length} or fewer characters, found {found}",
    "string_pattern_mismatch": "{found} does not fit `{pattern}`",
}
"""Kind of an error of pydantic -> its sentence, with the limits of its context."""
_EXPLAINED = 200
"""So many errors get their sentence; a hostile recipe may have fifty thousand."""


class KeyedError(RowError):
    """An error about a key, from code that knows no lines; `placing` adds the place.

    reason: the message without the path of the key.
    """

    def __init__(self, key: Key, reason: str, hint: str = "") -> None:
        super().__init__(f"{key_text(key)}: {reason}", key=key, hint=hint)
        self.reason = reason


def validated(
    model: type[M],
    root: Node,
    error: type[AssetBuildError],
    whole: Callable[[], type[BaseModel]] | None = None,
) -> M:
    """The model behind the tree; raises `error` with every problem, the first in file order.

    whole: the model with all keys that there are, where `model` has only some of them; it
    explains what is wrong.
    """
    wrong = Gather(error)
    details: list[Any] = []  # Any: pydantic's ErrorDetails, whose ctx is open
    try:
        valid = model.model_validate(plain(root), strict=True)
    except ValidationError as problem:
        details = list(problem.errors(include_url=False, include_input=False))
    details.sort(key=lambda raw: _in_file_order(raw, root))
    known = whole() if whole and details else model  # importing every plug-in takes long
    problems = _distinct([_explained(raw, root, known) for raw in details[:_EXPLAINED]])
    for one in _telling(problems):
        message = f"{key_text(one.key)}: {one.message}" if one.key else one.message
        with wrong:
            raise error(message, where=one.where, hint=one.hint)
    wrong.stop(uncounted=len(details[_EXPLAINED:]))
    return valid


def _telling(problems: list[_Problem]) -> Iterator[_Problem]:
    """Drop a key that is missing because it is spelt wrong, and keys of a misspelt method."""
    spelt = {(p.key[:-1], p.hint) for p in problems if p.message == "unknown key"}
    methods = {p.key[:-1] for p in problems if p.key[-1:] == ("method",)}
    for one in problems:
        is_missing = one.message.startswith("missing key") and bool(one.reach)
        follows = one.message == "unknown key" and one.key[:-1] in methods
        is_spelt = is_missing and (one.key, f"did you mean `{one.reach[-1]}`?") in spelt
        if not (follows or is_spelt):
            yield one


def locate(root: Node, key: Key) -> Where:
    """Where a key stands (a list's item: where it begins); the nearest place above if absent."""
    return follow(root, key)[2]


def key_text(key: Key) -> str:
    """A key path as people write it: `actuators[2].kp`, `collision.links[".*_foot"].method`."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        elif part.replace("_", "").replace("-", "").isalnum():
            text += f".{part}" if text else part
        else:
            text += f'["{part[:80]}"]'
    return text


@dataclass(frozen=True)
class _Problem:
    """key: where it is shown; reach: how deep the checker got, one more for a missing key."""

    key: Key
    where: Where
    message: str
    hint: str
    reach: Key


def _found(raw: Any, root: Node) -> tuple[Key, Node, Where]:  # Any: as above
    """What an error of pydantic is about, and where that stands."""
    # The key `method` decides which form of a map is meant.
    chosen = ("method",) if raw["type"] == "union_tag_invalid" else ()
    key, node, where = follow(root, (*raw["loc"], *chosen), has_tags=True)
    whole = isinstance(node.value, dict | tuple) or node.value is None
    at_key = whole or raw["type"] == "extra_forbidden" or raw["loc"][-1:] == ("[key]",)
    return key, node, where if at_key else node.where


def _in_file_order(raw: Any, root: Node) -> tuple[int, int, Key]:  # Any: as above
    key, _, where = _found(raw, root)
    return where.line, where.column, tuple(map(str, key))


def _explained(raw: Any, root: Node, model: type[BaseModel]) -> _Problem:  # Any: as above
    key, node, where = _found(raw, root)
    reach = key
    if raw["type"] == "missing":
        name = raw["loc"][-1]
        reach = (*key, name)
        what = f"entry {name + 1}" if isinstance(name, int) else f"key `{name}`"
        message, hint = f"missing {what}", meaning(model, reach)
    elif raw["loc"][-1:] == ("[key]",):
        head = "" if raw["type"] == "value_error" else "not a valid name: "  # a whole sentence
        message, hint = head + _plain_message(raw), ""
    else:
        message, hint = _sentence(raw, raw["type"], key, node, model)
    return _Problem(key, where, message, hint, reach)


def follow(root: Node, path: Key, *, has_tags: bool = False) -> tuple[Key, Node, Where]:
    """The key as far as it is there, the node at its end, and where that stands.

    has_tags: between the keys of a path of pydantic stand the tags of unions.
    """
    key: list[str | int] = []
    node, where = root, root.where
    for part in path:
        value = node.value
        if isinstance(value, dict) and str(part) in value:
            where, node = value[str(part)].where, value[str(part)].node
        elif isinstance(value, tuple) and isinstance(part, int) and part < len(value):
            node = value[part]
            where = node.where
        elif has_tags:
            continue
        else:
            break
        key.append(part)
    return tuple(key), node, where


def _sentence(
    raw: Any, kind: str, key: Key, node: Node, model: type[BaseModel]
) -> tuple[str, str]:  # Any: as above
    actual = described(node)
    if kind == "extra_forbidden":
        choice = _choice(raw["loc"])
        known = known_keys(model, key[:-1], choice)
        hint = did_you_mean(_CALLED_HERE.get(str(key[-1]), str(key[-1])), known)
        if key[-1] == "stiffness" and "kd" in known:
            hint += " `damping` is the joint's own, the drive's is `kd`"
        return f"`{choice}` has no key `{key[-1]}`" if choice else "unknown key", hint
    if kind in ("literal_error", "union_tag_invalid"):
        values = allowed_values(model, key)
        *most, last = [f"`{value}`" for value in values] or ["another value"]
        expected = f"{', '.join(most)} or {last}" if most else last
        near = did_you_mean(node.text, values) if isinstance(node.value, str) else ""
        return f"expected {expected}, found {actual}", near if near.startswith("did") else ""
    hint = meaning(model, key) if key else ""
    if kind == "string_type" and isinstance(node.value, int | float):
        hint = f'put it in quotes: "{node.text[:60]}"'
    if kind in _SENTENCES:
        return _SENTENCES[kind].format(found=actual, **raw.get("ctx", {})), hint
    return _plain_message(raw), hint


_CALLED_HERE = {
    "stiffness": "kp", "kv": "kd", "frictionloss": "friction", "forcerange": "effort",
    "effort_limit": "effort", "velocity_limit": "velocity", "ctrlrange": "ctrl", "dt": "timestep",
}  # fmt: skip
"""A word of MuJoCo or Isaac Lab -> the key of a recipe that means it."""


def _choice(loc: tuple[str | int, ...]) -> str:
    """The word that chose between the forms of a map: `hull` behind the tag `method hull`."""
    tags = [part for part in loc[-2:-1] if isinstance(part, str) and " " in part]
    return tags[0].partition(" ")[2] if tags else ""


def _plain_message(raw: Any) -> str:  # Any: as above
    """A validator's own words, or pydantic's, as the tail of a sentence."""
    if raw["type"] == "value_error":
        return str(raw["ctx"]["error"])
    if raw["type"] == "string_pattern_mismatch":
        return f"must fit `{raw['ctx']['pattern']}`"
    text = str(raw["msg"])
    return text[:1].lower() + text[1:]


def _distinct(problems: list[_Problem]) -> list[_Problem]:
    """One problem per place, in file order; of a union's complaints the one that went deepest."""
    reached = {problem.reach for problem in problems}
    by_key: dict[Key, _Problem] = {}
    for problem in problems:
        key = problem.reach
        deeper = any(other != key and other[: len(key)] == key for other in reached)
        if deeper and problem.message.startswith(("expected", "must have")):
            continue
        known = by_key.setdefault(key, problem)
        if known is not problem and problem.message.startswith("expected "):
            by_key[key] = _either(known, problem)
    return list(by_key.values())


def _either(a: _Problem, b: _Problem) -> _Problem:
    expected, _, actual = a.message.partition(", found")
    other = b.message.partition(", found")[0].removeprefix("expected ")
    return _Problem(
        a.key, a.where, f"{expected} or {other}, found{actual}", a.hint or b.hint, a.reach
    )
