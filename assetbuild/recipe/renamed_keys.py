"""Keys that were called otherwise in version 0.1; they work for one more minor version."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from assetbuild.findings import Finding, Rule
from assetbuild.recipe.yaml_tree import Entry, Node

OLD_KEY = Rule(
    "recipe.renamed_key",
    "info",
    "the recipe states a key by a name that it had before",
    "write the new name; the old one works for one minor version",
)
_IN_CONTACT = {"mask": "contype", "partners": "conaffinity"}
_IN_EXPERIMENT = {"broken": "error_limit"}
NEW_KEYS: Mapping[tuple[str, ...], Mapping[str, str]] = {
    ("contact",): _IN_CONTACT,
    ("contact", "links", "*"): _IN_CONTACT,
    ("identify", "*"): {"tied": "shared", "use": "apply", "widest": "max_relative_interval"},
    ("validate", "free_fall"): _IN_EXPERIMENT,
    ("validate", "loops"): _IN_EXPERIMENT,
    ("validate", "sine"): _IN_EXPERIMENT,
    ("validate", "trials"): {"dead": "min_response"},
}
"""Map of a recipe (`*`: any key or item) -> old name of a key in it -> its name now."""


def with_new_keys(root: Node) -> tuple[Node, tuple[Finding, ...]]:
    """The recipe's tree with today's names of its keys, and a finding about each old one.

    A key that is there by both names is left alone: validation then says that one is unknown.
    """
    findings: list[Finding] = []
    return _with_new_keys(root, (), findings), tuple(findings)


def _with_new_keys(node: Node, path: tuple[str, ...], findings: list[Finding]) -> Node:
    """The tree below `path` with today's names; `*` in a path stands for an item of a list."""
    if isinstance(node.value, tuple):
        items = (_with_new_keys(item, (*path, "*"), findings) for item in node.value)
        return replace(node, value=tuple(items))
    if not isinstance(node.value, dict):
        return node
    names, entries = _new_names(path), {}
    for key, entry in node.value.items():
        name = names.get(key, key)
        if name in node.value:
            name = key
        if name != key:
            subject = f"recipe {'.'.join((*path, key))}"
            message = f"the key `{key}` is called `{name}` now"
            findings.append(OLD_KEY(subject, message, where=str(entry.where)))
        entries[name] = Entry(entry.where, _with_new_keys(entry.node, (*path, key), findings))
    return replace(node, value=entries)


def _new_names(path: tuple[str, ...]) -> Mapping[str, str]:
    """Old name -> new name of the keys in the map at `path`; a variant has those of the recipe."""
    if path[:1] == ("variants",):
        path = path[2:]
    for pattern, names in NEW_KEYS.items():
        if len(path) == len(pattern) and all(
            part in ("*", key) for part, key in zip(pattern, path, strict=True)
        ):
            return names
    return {}
