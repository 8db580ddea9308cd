"""The variants of `Physics`: each is the whole robot less the words of other engines.

The facts of a USD are those of the variant that is selected. Of another one this reads which
statement composes: it must be the very one of the selected variant, from the same file, or belong
to an engine that the variant is not for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from pxr import Sdf, Usd

VARIANT_SET = "Physics"
ENGINES = {"physx": "PhysX", "newton": "Newton", "mjc": "MuJoCo"}
"""By how the names of an engine's schemas and attributes start, in lower case."""
READ = {
    "none": None,
    "physics": frozenset({"PhysX", "Newton", "MuJoCo"}),
    "physx": frozenset({"PhysX"}),
    "newton": frozenset({"Newton", "MuJoCo"}),
    "mujoco": frozenset({"Newton", "MuJoCo"}),
}
"""Whose words each variant has; `none` has no physics at all."""

Statements = Mapping[tuple[str, str], object]


def variants_amiss(stage: Usd.Stage) -> dict[str, tuple[str, ...]]:
    """By variant with physics that is not selected: what it has too much or too little of."""
    top = stage.GetDefaultPrim()
    variants = top.GetVariantSet(VARIANT_SET)
    chosen = variants.GetVariantSelection()
    whole = _statements(stage)
    amiss = {}
    for name in variants.GetVariantNames():
        read = READ.get(name)
        if name == chosen or read is None:
            continue
        session = Sdf.Layer.CreateAnonymous(".usda")
        other = Usd.Stage.Open(stage.GetRootLayer(), session)
        other.SetEditTarget(session)
        other.GetDefaultPrim().GetVariantSet(VARIANT_SET).SetVariantSelection(name)
        said = _statements(other)
        wanted = {key: value for key, value in whole.items() if _engine(key[1]) in {"", *read}}
        amiss[name] = tuple(sorted(_differences(said, wanted)))
    return amiss


def _statements(stage: Usd.Stage) -> Statements:
    """By prim and name: where each property, type and applied schema is stated."""
    found: dict[tuple[str, str], object] = {}
    for prim in stage.TraverseAll():
        path = str(prim.GetPath())
        if not _engine(prim.GetTypeName()):
            found[path, ""] = prim.GetTypeName()
        else:
            found[path, prim.GetTypeName()] = True
        for schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
            found[path, schema] = True
        for prop in prim.GetAuthoredProperties():
            name = prop.GetName()
            if _engine(prim.GetTypeName()):
                name = f"{prim.GetTypeName()} {name}"
            found[path, name] = tuple(
                (spec.layer.identifier, str(spec.path)) for spec in prop.GetPropertyStack()
            )
    return found


def _engine(name: str) -> str:
    """Whose word it is; '' = everybody's."""
    lower = name.lower()
    return next((engine for start, engine in ENGINES.items() if lower.startswith(start)), "")


def _differences(said: Statements, wanted: Statements) -> Iterator[str]:
    for path, name in said.keys() | wanted.keys():
        if said.get((path, name)) != wanted.get((path, name)):
            yield f"{path} {name or 'itself'}"
