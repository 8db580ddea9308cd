"""Metadata of the asset for people and for libraries of assets, in the words of NVIDIA's SimReady.

Nothing here is simulated. What the recipe does not state is left out.
"""

from __future__ import annotations

from pathlib import PurePosixPath

from pxr import Gf, Usd, UsdGeom

from assetbuild.recipe_types import Model
from assetbuild.robot.inertia import total_mass
from assetbuild.robot.model import Tree
from assetbuild.robot.sections import About
from assetbuild.simulators.usd_names import METADATA, NO_DATE, ROBOT_QCODE

EXTENTS_DIGITS = 4
"""Of a metre."""


class Origin(Model):
    """Whose robot it is. source_file: the description that it was built from."""

    about: About = About()
    license: str | None = None
    source_file: str | None = None


def write_metadata(stage: Usd.Stage, robot: str, tree: Tree, origin: Origin) -> None:
    """Author `SimReady_Metadata` in the custom data of the stage's root layer."""
    about = origin.about
    texts = {
        "author": about.author,
        "vendor": about.vendor,
        "description": about.description,
        "tags": ", ".join(about.tags),
        "asset_name": robot,
        "asset_type": "robot",
        "asset_license": origin.license,
        "category": "robot",
        "qcode": ROBOT_QCODE,
        "source_file": origin.source_file and PurePosixPath(origin.source_file).name,
        "usd_date_generated": about.date or NO_DATE,
    }
    metadata: dict[str, object] = {word: text for word, text in texts.items() if text}
    metadata["rigid_body_count"] = len(tree.bodies)
    metadata["mass"] = total_mass(tree)
    if (size := extents(stage)) is not None:
        metadata["asset_extents"] = size
        hint_extents(stage)
    stage.GetRootLayer().customLayerData = {METADATA: metadata}


def hint_extents(stage: Usd.Stage) -> None:
    """Author the bounds by purpose, so that a viewer frames the robot before it loads it."""
    purposes = UsdGeom.Imageable.GetOrderedPurposeTokens()
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), purposes)
    model = UsdGeom.ModelAPI.Apply(stage.GetDefaultPrim())
    model.SetExtentsHint(model.ComputeExtentsHint(cache))


def extents(stage: Usd.Stage) -> Gf.Vec3f | None:
    """Size of the robot in its zero pose along the axes of the stage, m; None without a shape."""
    seen = [UsdGeom.Tokens.default_, UsdGeom.Tokens.render, UsdGeom.Tokens.proxy]
    for purposes in (seen, [*seen, UsdGeom.Tokens.guide]):
        box = UsdGeom.BBoxCache(Usd.TimeCode.Default(), purposes).ComputeWorldBound(
            stage.GetDefaultPrim()
        )
        bounds = box.ComputeAlignedRange()
        if not bounds.IsEmpty():
            return Gf.Vec3f(*(round(side, EXTENTS_DIGITS) for side in bounds.GetSize()))
    return None
