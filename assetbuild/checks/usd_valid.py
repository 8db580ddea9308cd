"""The USD asset is whole: valid, complete after a move, nothing lost, driven, on the right base.

`pxr.UsdValidation` finds what breaks the schemas. It does not find what breaks a robot: a variant
nobody selected, a base welded to the world, a joint without drive, a mesh lost on the way.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule, Severity
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.joint_springs import as_drives
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.shapes import Shapes

if TYPE_CHECKING:
    from pxr import Usd

VARIANT_SET = "Physics"

MATERIAL_BINDING = Rule(
    "usd.material_binding",
    "error",
    "a prim is bound to a material that is not on the stage",
    "report it: a material was lost on the way to USD",
)
UNREADABLE = Rule("usd.unreadable", "error", "the stage does not open", "report it: this is a bug")
UNRESOLVED = Rule(
    "usd.unresolved",
    "error",
    "a reference does not resolve after the bundle is moved",
    "report it: this is a bug",
)
DEFAULT_PRIM = Rule(
    "usd.default_prim", "error", "there is no default prim", "report it: this is a bug"
)
NO_VARIANT = Rule(
    "usd.variant", "error", "no physics variant is selected", "report it: this is a bug"
)
VALIDATION = Rule(
    "usd.validation",
    ("error", "warning", "info"),
    "a validator of OpenUSD reports an issue",
    "read its message",
)
VALIDATION_SKIPPED = Rule(
    "usd.validation_skipped",
    "info",
    "this OpenUSD has no validators",
    "install usd-core 25.2 or newer",
)
ARTICULATION = Rule(
    "usd.articulation",
    "error",
    "there is not exactly one articulation root",
    "report it: this is a bug",
)
BASE = Rule(
    "usd.base",
    "error",
    "a floating base is welded, or a fixed one is not",
    "report it: this is a bug",
)
NO_DRIVE = Rule("usd.drive", "error", "a driven joint has no drive", "report it: this is a bug")
COUNT = Rule(
    "usd.count.*",
    "error",
    "bodies, joints, shapes or materials were lost",
    "report it: this is a bug",
)


class UsdValid(Check):
    """`usd/<robot>.usda`, opened with usd-core alone from a copy in another folder."""

    needs: ClassVar[tuple[str, ...]] = ("usd",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "shapes.json", "control.json")
    isolated: ClassVar[bool] = True
    preload: ClassVar[tuple[str, ...]] = (
        "pxr.Usd",
        "pxr.UsdGeom",
        "pxr.UsdPhysics",
        "pxr.UsdShade",
    )

    robot: str
    """Name of the robot: the stem of the main file."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: what is on the stage, by kind."""
        robot = RobotFiles(files.inputs)
        with tempfile.TemporaryDirectory() as elsewhere:
            folder = Path(elsewhere).resolve() / "moved"
            shutil.copytree(files.inputs / "usd", folder)
            main = folder / f"{self.robot}.usda"
            yield from _references(main, folder)
            stage = _open(main)
            if stage is None:
                write_figures(files, {})
                yield UNREADABLE("robot", f"`{main.name}` cannot be opened as USD")
                return
            yield from _variant(stage)
            yield from _validation(stage)
            found = Contents.of(stage)
            yield from _counts(found, robot.tree, robot.shapes, robot.control)
            yield from _drives(found, robot.control)
            yield from _base(found, robot.tree)
            yield from _bindings(stage)
            figures: dict[str, object] = dict(found.counts())
            figures["bytes"] = sum(p.stat().st_size for p in folder.rglob("*") if p.is_file())
            write_figures(files, figures)
            del stage, found


@dataclass(frozen=True)
class Contents:
    """What a composed stage holds, each prim in stage order."""

    bodies: tuple[Usd.Prim, ...]
    joints: tuple[Usd.Prim, ...]
    colliders: tuple[Usd.Prim, ...]
    visuals: tuple[Usd.Prim, ...]
    materials: tuple[Usd.Prim, ...]
    articulations: tuple[Usd.Prim, ...]

    @classmethod
    def of(cls, stage: Usd.Stage) -> Contents:
        """Everything below the default prim, inside of instances too."""
        from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

        prims = list(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))
        colliders = tuple(p for p in prims if p.HasAPI(UsdPhysics.CollisionAPI))
        return cls(
            bodies=tuple(p for p in prims if p.HasAPI(UsdPhysics.RigidBodyAPI)),
            joints=tuple(p for p in prims if p.IsA(UsdPhysics.Joint)),
            colliders=colliders,
            visuals=tuple(p for p in prims if p.IsA(UsdGeom.Gprim) and p not in colliders),
            materials=tuple(
                p
                for p in prims
                if p.IsA(UsdShade.Material) and not p.HasAPI(UsdPhysics.MaterialAPI)
            ),
            articulations=tuple(p for p in prims if p.HasAPI(UsdPhysics.ArticulationRootAPI)),
        )

    @property
    def world_joints(self) -> tuple[Usd.Prim, ...]:
        """Enabled joints with one end in the world."""
        from pxr import UsdPhysics

        return tuple(
            prim
            for prim in self.joints
            if UsdPhysics.Joint(prim).GetJointEnabledAttr().Get() and len(_ends(prim)) == 1
        )

    @property
    def driven(self) -> frozenset[str]:
        """Names of joints with a drive."""
        from pxr import UsdPhysics

        kinds = ("angular", "linear")
        return frozenset(
            name_of(p) for p in self.joints if any(p.HasAPI(UsdPhysics.DriveAPI, k) for k in kinds)
        )

    def counts(self) -> dict[str, int]:
        """How many of each; joints to the world are not counted as joints of the robot."""
        return {
            "bodies": len(self.bodies),
            "joints": len([p for p in self.joints if len(_ends(p)) == 2]),
            "drives": len(self.driven),
            "colliders": len(self.colliders),
            "visuals": len(self.visuals),
            "materials": len(self.materials),
        }


def name_of(prim: Usd.Prim) -> str:
    """The robot's name for a prim: its displayName where the identifier had to differ."""
    return str(prim.GetMetadata("displayName") or prim.GetName())


def _ends(joint: Usd.Prim) -> list[str]:
    """Paths of the bodies that a joint holds; the world has none."""
    from pxr import UsdPhysics

    api = UsdPhysics.Joint(joint)
    ends = (api.GetBody0Rel().GetTargets(), api.GetBody1Rel().GetTargets())
    return [str(targets[0]) for targets in ends if targets]


def _references(main: Path, folder: Path) -> Iterator[Finding]:
    """Each file that a layer names must be there, inside of the moved folder."""
    from pxr import Tf, UsdUtils

    try:
        layers, assets, unresolved = UsdUtils.ComputeAllDependencies(str(main))
    except Tf.ErrorException:
        return  # not a layer at all: `usd.unreadable` says so
    hint = "references must be relative and stay inside of the asset's folder"
    for path in sorted(unresolved):
        named = path.replace(f"{folder}/", "")
        yield UNRESOLVED("robot", f"`{named}` is not found after a move", hint)
    paths = [layer.realPath for layer in layers] + list(assets)
    for path in sorted(paths):
        if not Path(path).resolve().is_relative_to(folder):
            yield UNRESOLVED("robot", f"`{Path(path).name}` lies outside", hint)


def _open(main: Path) -> Usd.Stage | None:
    from pxr import Tf, Usd

    try:
        return Usd.Stage.Open(str(main))
    except Tf.ErrorException:
        return None


def _variant(stage: Usd.Stage) -> Iterator[Finding]:
    prim = stage.GetDefaultPrim()
    if not prim:
        yield DEFAULT_PRIM("robot", "the stage has no default prim")
        return
    variants = prim.GetVariantSet(VARIANT_SET)
    names, selected = variants.GetVariantNames(), variants.GetVariantSelection()
    if not variants.HasAuthoredVariantSelection() or selected not in names or selected == "none":
        shown = f"`{selected}`" if selected else "nothing"
        yield NO_VARIANT(
            "robot",
            f"variant set `{VARIANT_SET}` selects {shown}: the robot opens without physics",
            f"select one of {', '.join(f'`{n}`' for n in names if n != 'none') or 'none given'}",
        )


def _validation(stage: Usd.Stage) -> Iterator[Finding]:
    """All validators of usd-core; those that it lacks (before 25) are a finding of their own."""
    try:
        from pxr import UsdValidation
    except ImportError:
        yield VALIDATION_SKIPPED(
            "robot", "this usd-core has no UsdValidation", "install usd-core 25.2 or later"
        )
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


def _counts(found: Contents, tree: Tree, shapes: Shapes, control: Control) -> Iterator[Finding]:
    expected = {
        "bodies": len(tree.bodies),
        "joints": len(tree.joints) + len(control.loops),
        "drives": len([a for a in control.actuators if a.model != "passive"])
        + len(as_drives(control)),
        "colliders": len(shapes.of("collision")),
        "visuals": len(shapes.of("visual")),
        "materials": len(shapes.all_coloured.materials),
    }
    for kind, count in found.counts().items():
        if count != expected[kind]:
            yield COUNT.named(kind)(
                "robot",
                f"{count} {kind} in USD, the robot has {expected[kind]}",
                data={"found": count, "expected": expected[kind]},
            )


def _drives(found: Contents, control: Control) -> Iterator[Finding]:
    for actuator in control.actuators:
        if actuator.model != "passive" and actuator.joint not in found.driven:
            yield NO_DRIVE(
                f"actuator {actuator.joint}",
                f"`{actuator.model}` in the recipe, but the joint has no drive in USD",
                "PhysX ignores gains and effort limit of a joint without DriveAPI",
            )


def _base(found: Contents, tree: Tree) -> Iterator[Finding]:
    """One articulation; its root on the root link (floats) or on the world joint (stands)."""
    roots, welds = found.articulations, found.world_joints
    if len(roots) != 1:
        names = ", ".join(f"`{name_of(p)}`" for p in roots) or "none"
        yield ARTICULATION("robot", f"needs one articulation root, there are: {names}")
        return
    if tree.base == "floating":
        for joint in welds:
            yield BASE(
                "robot",
                f"`{name_of(joint)}` welds the floating base to the world",
                "remove the joint: the robot would hang in the air",
            )
        if name_of(roots[0]) != tree.root:
            yield BASE("robot", f"the articulation root is `{name_of(roots[0])}`, not the base")
    elif roots[0] not in welds or name_of_end(roots[0]) != tree.root:
        yield BASE(
            "robot",
            "the fixed base is not held by an articulation root on the joint to the world",
            "on the link itself, PhysX would let the base drift",
        )


def _bindings(stage: Usd.Stage) -> Iterator[Finding]:
    """Materials that are bound, for the eye or for contact, must be there."""
    for prim in stage.Traverse():
        for name in ("material:binding", "material:binding:physics"):
            for target in prim.GetRelationship(name).GetTargets():
                found = stage.GetPrimAtPath(target)
                if not found or not found.IsActive():
                    yield MATERIAL_BINDING(
                        f"shape {name_of(prim)}",
                        f"is bound to the material `{target}`, which is not there",
                    )


def name_of_end(joint: Usd.Prim) -> str:
    """Name of the one body that a world joint holds."""
    ends = _ends(joint)
    return name_of(joint.GetStage().GetPrimAtPath(ends[0])) if ends else ""


def lint_file(path: Path) -> Iterator[Finding]:
    """What can be said about any USD file: does it open, and what do the validators object to?"""
    stage = _open(path)
    if stage is None:
        yield UNREADABLE("robot", f"`{path.name}` cannot be opened as USD")
        return
    yield from _validation(stage)
