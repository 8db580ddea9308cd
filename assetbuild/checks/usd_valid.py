"""Does the USD survive a move, and what do OpenUSD's own validators object to?

What the stage says of the robot is read by the reader of facts.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule, Severity
from assetbuild.plugin_types import Check, write_figures

if TYPE_CHECKING:
    from pxr import Usd

UNREADABLE = Rule("usd.unreadable", "error", "the stage does not open", "report it: this is a bug")
UNRESOLVED = Rule(
    "usd.unresolved",
    "error",
    "a reference does not resolve after the bundle is moved",
    "references must be relative and stay inside of the asset's folder",
)
VALIDATION = Rule(
    "usd.validation",
    ("error", "warning", "info"),
    "a validator of OpenUSD reports an issue",
    "its message names the prim",
)
VALIDATION_SKIPPED = Rule(
    "usd.validation_skipped",
    "info",
    "this OpenUSD has no validators",
    "install usd-core 25.2 or newer",
)


EXTENT = Rule(
    "usd.extent",
    "error",
    "a shape or the robot states no bounds, or others than it has: viewers lose sight of it",
    "if nobody edited the bundle, this is a bug: please report it",
)
VARIANT = Rule(
    "usd.variant_engines",
    "error",
    "a variant of `Physics` speaks to other engines than its name says",
    "if nobody edited the bundle, this is a bug: please report it",
)
ENGINES = {
    "none": set[str](),
    "physics": {"Physics", "Physx", "Newton", "Mjc"},
    "physx": {"Physics", "Physx"},
    "newton": {"Physics", "Newton", "Mjc"},
    "mujoco": {"Physics", "Newton", "Mjc"},
}
"""How the schemas of a variant begin."""
UNDEFINED = Rule(
    "usd.undefined",
    "error",
    "a layer adds to a prim that no layer defines, so that nobody reads it",
    "if nobody edited the bundle, this is a bug: please report it",
)
ROUNDING_M = 1e-5
"""float32 of the corners of a large shape."""


class UsdValid(Check):
    """`usd/<robot>.usda`, opened with usd-core alone from a copy in another folder."""

    needs: ClassVar[tuple[str, ...]] = ("usd",)
    reads: ClassVar[tuple[str, ...]] = ()
    isolated: ClassVar[bool] = True
    preload = ("pxr.Usd", "pxr.UsdGeom", "pxr.UsdPhysics", "pxr.UsdShade")

    robot: str
    """Name of the robot: the stem of the main file."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: the size of all layers."""
        with tempfile.TemporaryDirectory() as elsewhere:
            folder = Path(elsewhere).resolve() / "moved"
            shutil.copytree(files.inputs / "usd", folder)
            main = folder / f"{self.robot}.usda"
            size = sum(p.stat().st_size for p in folder.rglob("*") if p.is_file())
            write_figures(files, {"bytes": size})
            found = [*_references(main, folder), *lint_file(main)]
            yield from found
            sound = all(finding.severity != "error" for finding in found)
            for path in (main, folder / "scene.usda") if sound else ():
                yield from _prims(path, whole=path == main) if path.is_file() else ()


def lint_file(path: Path) -> Iterator[Finding]:
    """What can be said about any USD file: does it open, and what do the validators object to?"""
    from pxr import Tf, Usd

    try:
        yield from _validation(Usd.Stage.Open(str(path)))
    except Tf.ErrorException as error:
        reasons = " ".join(dict.fromkeys(str(each.commentary) for each in error.args))
        why = " ".join(reasons.replace(f"{path.parent}/", "").split())[:300]
        yield UNREADABLE("robot", f"`{path.name}` cannot be read as USD: {why}")


def _prims(path: Path, *, whole: bool) -> Iterator[Finding]:
    """What prims state, beside what USD computes of them; prims that no layer defines.

    whole: the asset itself, which states its bounds and has variants.
    """
    from pxr import Tf, Usd, UsdGeom

    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException:
        return  # the scene's reader says so
    for prim in stage.TraverseAll():
        if not prim.IsDefined():
            yield UNDEFINED(f"prim {prim.GetPath()}", f"`{path.name}` speaks of it alone")
    yield from _extents(stage)
    if not whole:
        return
    # The asset's bounds, by which viewers frame it and libraries list it.
    robot = UsdGeom.ModelAPI(stage.GetDefaultPrim())
    purposes = UsdGeom.Imageable.GetOrderedPurposeTokens()
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), purposes)
    bounds = robot.ComputeExtentsHint(cache)
    has_shapes = any(low[0] <= high[0] for low, high in zip(bounds[::2], bounds[1::2], strict=True))
    if robot.GetExtentsHint() != (bounds if has_shapes else None):
        yield EXTENT(f"prim {robot.GetPath()}", "its `extentsHint` is not that of its shapes")
    metadata = stage.GetRootLayer().customLayerData.get("SimReady_Metadata", {})
    if robot.GetExtentsHint() and "asset_extents" not in metadata:
        yield EXTENT(f"prim {robot.GetPath()}", "the asset's metadata lack `asset_extents`")
    # Schemas of engines in each variant of `Physics`.
    root = stage.GetDefaultPrim()
    stage.SetEditTarget(stage.GetSessionLayer())
    for variant, expected in ENGINES.items() if root.HasVariantSets() else ():
        root.GetVariantSet("Physics").SetVariantSelection(variant)
        types = [prim.GetPrimTypeInfo() for prim in stage.Traverse()]
        schemas = {name for each in types for name in each.GetAppliedAPISchemas()}
        there = {engine for engine in ENGINES["physics"] for s in schemas if s.startswith(engine)}
        if there - expected or expected - there - {"Mjc"}:  # which speaks of contacts and limits
            text = f"its variant `{variant}` has schemas of {sorted(there)}, not {sorted(expected)}"
            yield VARIANT(f"prim {root.GetPath()}", text, data={"variant": variant})


def _extents(stage: Usd.Stage) -> Iterator[Finding]:
    """What each shape states, beside what USD computes of it."""
    from pxr import Usd, UsdGeom

    for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
        shape = UsdGeom.Boundable(prim)
        if not shape or not prim.IsA(UsdGeom.Gprim):
            continue
        if not shape.GetExtentAttr().HasAuthoredValue():
            yield EXTENT(f"prim {prim.GetPath()}", "states no extent")
            continue
        stated = shape.GetExtentAttr().Get()
        real = UsdGeom.Boundable.ComputeExtentFromPlugins(shape, Usd.TimeCode.Default())
        off = [abs(a - b) for one, two in zip(stated, real or (), strict=False)
               for a, b in zip(one, two, strict=True)]  # fmt: skip
        size = max((abs(v) for corner in real or () for v in corner), default=0.0)
        if off and max(off) > ROUNDING_M * max(1.0, size):
            text = f"states an extent that is off by {max(off):.3g} m"
            yield EXTENT(f"prim {prim.GetPath()}", text, data={"off_m": max(off)})


def _references(main: Path, folder: Path) -> Iterator[Finding]:
    """Each file that a layer names must be there, inside of the moved folder."""
    from pxr import Tf, UsdUtils

    try:
        layers, assets, unresolved = UsdUtils.ComputeAllDependencies(str(main))
    except Tf.ErrorException:
        return  # not a layer at all: `usd.unreadable` says so
    for path in sorted(unresolved):
        named = path.replace(f"{folder}/", "")
        yield UNRESOLVED("robot", f"`{named}` is not found after a move")
    paths = [layer.realPath for layer in layers] + list(assets)
    for path in sorted(paths):
        if not Path(path).resolve().is_relative_to(folder):
            yield UNRESOLVED("robot", f"`{Path(path).name}` lies outside")


def _validation(stage: Usd.Stage) -> Iterator[Finding]:
    """All validators of usd-core; those that it lacks (before 25) are a finding of their own."""
    try:
        from pxr import UsdValidation
    except ImportError:
        yield VALIDATION_SKIPPED("robot", "this usd-core has no UsdValidation")
        return
    kinds = UsdValidation.ValidationErrorType
    severities: dict[object, Severity] = {kinds.Error: "error", kinds.Warn: "warning"}
    metadata = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    for error in UsdValidation.ValidationContext(metadata).Validate(stage):
        sites = [site.GetPrim().GetPath() for site in error.GetSites() if site.IsPrim()]
        prims = ", ".join(str(path) for path in sites)
        yield VALIDATION(
            "robot",
            f"{error.GetName()}: {error.GetMessage()}",
            severity=severities.get(error.GetType(), "info"),
            data={"prims": prims},
        )
