"""A stage as a whole: opened, its units, its layers and its variants."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pxr import Sdf, Tf, Usd, UsdGeom, UsdPhysics

from assetbuild.errors import UsageError
from assetbuild.facts.reader import StatementError
from assetbuild.facts.table import Value, Writer
from assetbuild.facts.usd_about import metadata_facts
from assetbuild.facts.usd_prims import PLAIN, Units
from assetbuild.facts.usd_variants import VARIANT_SET, variants_amiss
from assetbuild.simulators.usd_names import METADATA


@contextmanager
def opened(path: Path) -> Iterator[Usd.Stage]:
    """The stage with its default variants; UsageError where USD cannot make sense of it."""
    try:
        stage = Usd.Stage.Open(str(path))
        if not stage.GetDefaultPrim():
            said = stage.GetRootLayer().defaultPrim or "nothing"
            meant = "a default prim, which says which of the prims is the robot"
            raise StatementError("stage", said, meant, path.name)
        for broken in stage.GetCompositionErrors():
            _refuse(str(broken), path.parent)
        yield stage
    except Tf.ErrorException as error:
        raise UsageError(f"`{path}` is not readable as USD: {error}") from None


def _refuse(error: str, folder: Path) -> None:
    """Raises StatementError for what keeps USD from reading a layer, by its own message."""
    text = " ".join(error.split())
    found = _PLACE.search(text)
    if found is None:
        raise StatementError("stage", text.replace(f"{folder}/", ""), "a layer that composes", "")
    file, line, wish, said, prim = found.groups()
    where = f"{file.removeprefix(f'{folder}/')}:{line}"
    raise StatementError(f"prim {prim}", said, f"a statement of USD ({wish.strip()})", where)


_PLACE = re.compile(r"-- (\S+?):(\d+):\d+: (.*?)(?: at)? '(.*)' in <([^>]*)>")
"""`-- FILE:LINE:COLUMN: Expected } at 'STATEMENT' in </PRIM>` of USD's parser."""


def units_of(stage: Usd.Stage) -> Units:
    """Units of a stage; UsageError where one is not positive."""
    units = Units(UsdGeom.GetStageMetersPerUnit(stage), UsdPhysics.GetStageKilogramsPerUnit(stage))
    if not (units.metre > 0.0 and units.kilogram > 0.0):
        raise UsageError(
            f"its units are {units.metre:g} m and {units.kilogram:g} kg",
            hint="`metersPerUnit` and `kilogramsPerUnit` must be positive",
        )
    return units


_LAYER = frozenset({"subLayers", "subLayerOffsets", "documentation", "comment"})
"""No facts: what they compose is compared."""


def stage_facts(stage: Usd.Stage, units: Units, book: Writer) -> None:
    """Units, up axis and metadata of the stage, and of every layer that it is made of.

    Runtimes scale and turn a layer whose units differ from the stage's.
    """
    book.put("robot", "", {
        "up axis": str(UsdGeom.GetStageUpAxis(stage)),
        "metres per unit": units.metre,
        "kilograms per unit": units.kilogram,
    })  # fmt: skip
    book.put("stage", "", {"usd:defaultPrim": str(stage.GetDefaultPrim().GetName())})
    own: dict[str, list[Value]] = {}
    for layer in stage.GetUsedLayers():
        root = layer.pseudoRoot
        fields = [key for key in root.ListInfoKeys() if key not in _LAYER]
        if layer.anonymous and not fields:
            continue
        for key in fields:
            if key in ("upAxis", "metersPerUnit", "kilogramsPerUnit"):
                value = root.GetInfo(key)
                own.setdefault(key, []).append(value if isinstance(value, float) else str(value))
            elif key == "defaultPrim":
                if not layer.GetPrimAtPath(f"/{layer.defaultPrim}"):
                    book.skip(layer.GetDisplayName(), key, layer.defaultPrim)
            elif key == "customLayerData" and layer == stage.GetRootLayer():
                metadata_facts(stage, root.GetInfo(key), book)
            elif (
                key == "customLayerData"
                and set(root.GetInfo(key)) == {METADATA}
                and _lies_beside(layer, stage.GetRootLayer())
            ):
                pass  # of the robot that a scene refers to: it belongs to that file alone
            else:
                book.skip(layer.GetDisplayName(), key, root.GetInfo(key))
    for key, values in own.items():
        differing = tuple(sorted({str(value) for value in values}))
        book.put("stage", "", {f"usd:{key} of layers": differing})


def variant_facts(prim: Usd.Prim, book: Writer) -> None:
    """Variant sets with their selections, and what the variants say that are not selected."""
    sets = prim.GetVariantSets()
    amiss = variants_amiss(prim.GetStage())
    for variant, names in amiss.items():
        book.put("stage", "", {f"usd:amiss in {VARIANT_SET}={variant}": names})
    for name in sets.GetNames():
        chosen = sets.GetVariantSelection(name)
        book.put("stage", "", {
            f"usd:variants of {name}": tuple(sorted(sets.GetVariantSet(name).GetVariantNames())),
            f"usd:selected {name}": chosen,
        })  # fmt: skip
        for spec in prim.GetPrimStack():
            found = spec.variantSets[name].variants if name in spec.variantSets else {}
            for variant in found.keys():  # noqa: SIM118 # a proxy of USD, not a dictionary
                if variant != chosen and (name != VARIANT_SET or variant not in amiss):
                    said = " ".join(_said_by(found[variant].primSpec))
                    book.put("stage", "", {f"usd:variant {name}={variant}": said})


def _said_by(spec: Sdf.PrimSpec) -> Iterator[str]:
    """What a variant adds: its metadata, properties and children by name."""
    for key in spec.ListInfoKeys():
        if key not in PLAIN:
            yield str(key)
    yield from (str(found.name) for found in spec.properties)
    yield from (str(found.name) for found in spec.nameChildren)


def _lies_beside(layer: Sdf.Layer, root: Sdf.Layer) -> bool:
    """Whether it is another file of the same folder: payloads lie in a folder of their own."""
    return Path(layer.realPath).parent == Path(root.realPath).parent
