"""A stage as a whole: opened, its units and its variants."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pxr import Sdf, Tf, Usd, UsdGeom, UsdPhysics

from assetbuild.errors import UsageError
from assetbuild.facts.table import Writer
from assetbuild.facts.usd_prims import Units


@contextmanager
def opened(path: Path) -> Iterator[Usd.Stage]:
    """The stage with its default variants; UsageError where USD cannot make sense of it."""
    try:
        stage = Usd.Stage.Open(str(path))
        broken = [" ".join(str(error).split()) for error in stage.GetCompositionErrors()]
        if not stage.GetDefaultPrim():
            broken.append("it has no default prim, which says which of the prims is the robot")
        if broken:
            raise UsageError(broken[0].replace(f"{path.parent}/", ""))
        yield stage
    except Tf.ErrorException as error:
        raise UsageError(f"`{path}` is not readable as USD: {error}") from None


UNITS = ("upAxis", "metersPerUnit", "kilogramsPerUnit")
"""Metadata of a stage, which others take for centimetres and y where it states nothing."""


def units_of(stage: Usd.Stage, book: Writer) -> Units:
    """Units of a stage, noted with its up axis; UsageError where one is not positive."""
    units = Units(UsdGeom.GetStageMetersPerUnit(stage), UsdPhysics.GetStageKilogramsPerUnit(stage))
    if not (units.metre > 0.0 and units.kilogram > 0.0):
        raise UsageError(
            f"its units are {units.metre:g} m and {units.kilogram:g} kg",
            hint="`metersPerUnit` and `kilogramsPerUnit` must be positive",
        )
    book.put("robot", "", {
        "up axis": str(UsdGeom.GetStageUpAxis(stage)),
        "metres per unit": units.metre,
        "kilograms per unit": units.kilogram,
        "usd:stated units": tuple(name for name in UNITS if stage.HasAuthoredMetadata(name)),
    })  # fmt: skip
    return units


VARIANTS = "Physics"
ENGINES = ("physx", "newton", "mjc")
"""How the schemas and attributes of PhysX, Newton and MuJoCo start."""


def engines_of(stage: Usd.Stage, variant: str) -> tuple[str, ...]:
    """Whose words a variant has. Their values are those of the selected one: layers are shared."""
    session = Sdf.Layer.CreateAnonymous(".usda")
    other = Usd.Stage.Open(stage.GetRootLayer(), session)
    other.SetEditTarget(session)
    other.GetDefaultPrim().GetVariantSet(VARIANTS).SetVariantSelection(variant)
    words: set[str] = set()
    for prim in other.TraverseAll():
        words |= {*prim.GetPrimTypeInfo().GetAppliedAPISchemas(), *prim.GetAuthoredPropertyNames()}
    lower = [word.lower() for word in words]
    return tuple(engine for engine in ENGINES if any(w.startswith(engine) for w in lower))
