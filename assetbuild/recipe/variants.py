"""Variants: named patches on a recipe. Maps are merged, everything else is replaced.

Patches are applied to the tree of nodes, so that each value of the patched recipe keeps the line
that it came from, and the result is validated as any recipe is.
"""

from __future__ import annotations

from collections.abc import Mapping

from assetbuild.errors import RecipeError, did_you_mean
from assetbuild.recipe.yaml_tree import Entry, Node

FIRST_MATCH_WINS: frozenset[tuple[str, ...]] = frozenset(
    {
        ("collision", "links"),
        ("contact", "links"),
        ("randomize", "links"),
        ("randomize", "joints"),
    }
)
"""Maps whose order decides: there the patch's new keys come first, so that the variant wins."""
_NOT_IN_A_VARIANT = ("schema", "variants")


def variant_names(root: Node) -> tuple[str, ...]:
    """Names of the variants in a recipe's tree, in file order."""
    variants = _entries(root).get("variants")
    return tuple(_entries(variants.node)) if variants else ()


def patched(root: Node, variant: str) -> Node:
    """The recipe's tree with one variant applied; RecipeError when there is none of that name."""
    names = variant_names(root)
    if variant not in names:
        variants = _entries(root).get("variants")
        hint = did_you_mean(variant, names) or "the recipe has no `variants`"
        where = variants.where if variants else root.where
        raise RecipeError(f"no variant named `{variant}`", where=where, hint=hint)
    entry = _entries(_entries(root)["variants"].node)[variant]
    if not isinstance(entry.node.value, dict):
        raise RecipeError(f"variants.{variant}: expected a map", where=entry.where)
    for name in _NOT_IN_A_VARIANT:
        if name in entry.node.value:
            raise RecipeError(
                f"variants.{variant}.{name}: a variant cannot change `{name}`",
                where=entry.node.value[name].where,
            )
    return _merged(root, entry.node, ())


def _merged(base: Node, patch: Node, path: tuple[str, ...]) -> Node:
    if not isinstance(base.value, dict) or not isinstance(patch.value, dict):
        return patch
    old, new = base.value, patch.value
    changed = {
        key: Entry(
            entry.where,
            _merged(old[key].node, entry.node, (*path, key)) if key in old else entry.node,
        )
        for key, entry in new.items()
    }
    if path in FIRST_MATCH_WINS:
        value = changed | {key: entry for key, entry in old.items() if key not in changed}
    else:
        value = {key: changed.get(key, entry) for key, entry in old.items()} | changed
    # Shown where the base has it: an error about the map as a whole is rarely the patch's fault.
    return Node(base.where, value)


def _entries(node: Node) -> Mapping[str, Entry]:
    return node.value if isinstance(node.value, dict) else {}
