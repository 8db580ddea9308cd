"""The JSON Schema of the recipe: for editors, and for `did you mean` in errors."""

from __future__ import annotations

import functools
import json
import re
from typing import Any

from pydantic import BaseModel

Schema = dict[str, Any]  # Any: JSON


def schema_of(model: type[BaseModel]) -> str:
    """JSON Schema 2020-12 of a recipe, keys as written."""
    schema = _schema_of(model)
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "assetbuild recipe",
        "description": "What a robot's bundle is made from, `recipes/<robot>.yaml`",
    }
    return json.dumps(head | {k: v for k, v in schema.items() if k not in head}, indent=2) + "\n"


def known_keys(model: type[BaseModel], path: tuple[str | int, ...], choice: str = "") -> list[str]:
    """The keys that `model` takes at `path`; none where any key is taken.

    choice: only of the forms one of whose keys must be this word.
    """
    names: list[str] = []
    for schema in _at(model, path):
        keys = schema.get("properties", {})
        if not choice or any(value.get("const") == choice for value in keys.values()):
            names += keys
    return names


def allowed_values(model: type[BaseModel], path: tuple[str | int, ...]) -> list[str]:
    """The words that `model` takes at `path`; none where it is not a choice."""
    values: list[object] = []
    for schema in _at(model, path):
        values += schema.get("enum", [])
        values += [schema["const"]] if "const" in schema else []
    return [str(value) for value in values if value is not None]


def meaning(model: type[BaseModel], path: tuple[str | int, ...]) -> str:
    """The description of the key at `path`, or ""."""
    texts = [str(s["description"]) for s in _at(model, path, open_up=False) if "description" in s]
    return texts[0] if texts else ""


@functools.cache
def _schema_of(model: type[BaseModel]) -> Schema:
    return model.model_json_schema(by_alias=True)


def _at(
    model: type[BaseModel], path: tuple[str | int, ...], *, open_up: bool = True
) -> list[Schema]:
    """The schemas that may hold at `path`, unions opened."""
    root = _schema_of(model)
    here = [root]
    for part in path:
        opened = [option for schema in here for option in _options(schema, root)]
        here = [child for schema in opened for child in _children(schema, part)]
    return [o for s in here for o in _options(s, root)] if open_up else here


def _options(schema: Schema, root: Schema) -> list[Schema]:
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[-1]
        return _options(root["$defs"][name], root)
    for choice in ("anyOf", "oneOf"):
        if choice in schema:
            return [option for member in schema[choice] for option in _options(member, root)]
    return [schema]


def _children(schema: Schema, part: str | int) -> list[Schema]:
    if isinstance(part, int):
        fixed = schema.get("prefixItems", [])
        if part < len(fixed):
            return [fixed[part]]
        return [schema["items"]] if isinstance(schema.get("items"), dict) else []
    if part in schema.get("properties", {}):
        return [schema["properties"][part]]
    matching = [
        child
        for pattern, child in schema.get("patternProperties", {}).items()
        if re.search(pattern, part)
    ]
    extra = schema.get("additionalProperties")
    return matching or ([extra] if isinstance(extra, dict) else [])
