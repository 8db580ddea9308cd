"""The reference page of all recipe keys, composed from the models that declare them."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import assetbuild
from assetbuild.pipeline.recipes import whole_model
from assetbuild.plugin_types import Check, Plugin, Target
from assetbuild.plugins import load_plugin, plugin_names
from assetbuild.recipe.schema import Schema

INTRODUCTION = """\
# Recipe keys

Every key that a recipe may have: those of the robot, and those that targets, checks, edits and
collision methods declare for themselves. A plug-in of another package adds its own: see
[write your own target](../how-to/plugins.md). `assetbuild schema` prints the same as JSON Schema.
An empty unit means a number without one, or no number.

"""
UNIT = re.compile(
    r"(?:^|[ (])(kg m2|kg/m3|m2/s2|N m s/rad(?: or N s/m)?|N m/rad(?: or N/m)?|N m(?: or N)?|rad/s"
    r"(?: or m/s)?|m/s2|m/s|1/s|rad(?: or m)?|kg|Hz|MB|m|s)(?=[;:,.) ]|$)"
)
"""Units as descriptions write them; a description states its key's unit first."""


def key_page() -> str:
    """`docs/reference/recipe.md`."""
    schema = json.loads(json.dumps(whole_model().model_json_schema(by_alias=True)))
    readers = dict(_plugin_readers())
    sections = [_section("", schema, schema, readers)]
    for key, value in sorted(schema["properties"].items()):
        for path, found in _maps(key, value, schema):
            sections.append(_section(path, found, schema, readers))
    return INTRODUCTION + "\n".join(dict.fromkeys(sections))


def _maps(path: str, value: Schema, root: Schema) -> Iterator[tuple[str, Schema]]:
    """(path, schema) of every map of keys at and below a key, outermost first."""
    for option in _options(value, root):
        if "properties" in option:
            label = _chosen(option)
            yield f"{path} ({label})" if label else path, option
            for key, child in option["properties"].items():
                yield from _maps(f"{path}.{key}", child, root)
        inner = option.get("additionalProperties")
        if isinstance(inner, dict):
            yield from _maps(f"{path}.<name>", inner, root)
        if isinstance(option.get("items"), dict):
            yield from _maps(f"{path}[]", option["items"], root)


def _chosen(option: Schema) -> str:
    """What distinguishes one form of a map from the others: `method: hull`."""
    words = [f"{k}: {v['const']}" for k, v in option["properties"].items() if "const" in v]
    return words[0] if words and not words[0].startswith("schema") else ""


def _options(value: Schema, root: Schema) -> list[Schema]:
    if "$ref" in value:
        return _options(root["$defs"][value["$ref"].rsplit("/", 1)[-1]], root)
    members = [*value.get("anyOf", ()), *value.get("oneOf", ())]
    return [option for member in members for option in _options(member, root)] or [value]


def _section(path: str, found: Schema, root: Schema, readers: Mapping[str, str]) -> str:
    title = f"## `{path}`\n\n" if path else "## The recipe\n\n"
    about = "" if not path else " ".join(found.get("description", "").split()) + "\n\n"
    head = "| key | type | unit | default | read by | meaning |\n| --- |" + " --- |" * 5 + "\n"
    rows = []
    for key, value in found["properties"].items():
        whole = f"{path}.{key}" if path else key
        meaning = value.get("description") or _options(value, root)[0].get("description", "")
        meaning = " ".join(meaning.split())
        unit = UNIT.search(meaning) if _is_number(value, root) else None
        default = "required" if key in found.get("required", ()) else _default(value)
        cells = (f"`{key}`", _type(value, root), unit.group(1) if unit else "", default)
        rows.append([*cells, _reader(whole, readers), meaning])
    lines = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |\n" for row in rows]
    return title + about + head + "".join(lines)


def _default(value: Schema) -> str:
    if "default" not in value or value["default"] is None or isinstance(value["default"], dict):
        return ""
    return f"`{json.dumps(value['default'])}`"


def _is_number(value: Schema, root: Schema) -> bool:
    return any(
        option.get("type") in ("number", "integer") or _is_number_list(option, root)
        for option in _options(value, root)
    )


def _is_number_list(option: Schema, root: Schema) -> bool:
    return any(_is_number(item, root) for item in option.get("prefixItems", ()))


def _type(value: Schema, root: Schema) -> str:
    """`number`, `text`, `true or false`, a choice, a list or a map, in words."""
    words = [_word(option, root) for option in _options(value, root)]
    return " or ".join(dict.fromkeys(word for word in words if word))


def _word(option: Schema, root: Schema) -> str:
    if "const" in option or "enum" in option:
        return ", ".join(f"`{word}`" for word in option.get("enum", [option.get("const")]))
    if "prefixItems" in option:
        return f"{len(option['prefixItems'])} numbers" if _is_number_list(option, root) else "list"
    kind = option.get("type", "any")
    if kind == "array":
        return f"list of {_type(option.get('items', {}), root) or 'values'}"
    words = {"string": "text", "boolean": "true or false", "object": "map", "null": ""}
    return {**words, "integer": "whole number"}.get(kind, str(kind))


# --- who reads a key ------------------------------------------------------------------------


def _reader(path: str, readers: Mapping[str, str]) -> str:
    """The plug-in that declares the nearest section, else the rooms whose plan reads the key."""
    parts = path.split(" ")[0].split(".")
    for length in range(len(parts), 0, -1):
        if found := readers.get(".".join(parts[:length])):
            return found
    return ", ".join(_rooms(re.sub(r"\W.*", "", parts[0])))


def _plugin_readers() -> Iterator[tuple[str, str]]:
    kinds: tuple[tuple[type[Plugin], str], ...] = ((Check, "check"), (Target, "target"))
    for kind, word in kinds:
        for name in plugin_names(kind):
            plugin = load_plugin(kind, name)
            for path in plugin.sections:
                yield path, f"{word} `{name}`"
            if plugin.section == "validate":
                yield from ((f"validate.{key}", f"{word} `{name}`") for key in plugin.keys())  # noqa: SIM118
            elif plugin.keys():
                yield plugin.section, f"{word} `{name}`"


@functools.cache
def _rooms(key: str) -> tuple[str, ...]:
    """Rooms in whose code `recipe.<key>` stands."""
    named = re.compile(rf"recipe\.{key}_?\b")
    return tuple(sorted({room for room, text in _texts() if named.search(text)}))


@functools.cache
def _texts() -> tuple[tuple[str, str], ...]:
    """(room, text) of every module of the package above `recipe/`."""
    root = Path(next(iter(assetbuild.__path__)))
    found: list[tuple[str, Any]] = [
        (path.relative_to(root).parts[0].removesuffix(".py"), path) for path in root.rglob("*.py")
    ]
    return tuple(
        (room, path.read_text(encoding="utf-8")) for room, path in found if room != "recipe"
    )
