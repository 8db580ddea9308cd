"""Metadata of a USD for people and libraries of assets (NVIDIA's SimReady): read and expected.

The numbers are compared with the robot, the words with the recipe. The size is compared with the
stage that states it, because no other file knows the bounds of what is drawn.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Any

from pxr import Gf, Usd, UsdGeom

from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Writer
from assetbuild.robot.inertia import total_mass
from assetbuild.simulators.usd_names import METADATA, NO_DATE, ROBOT_QCODE

_NEAR = 1e-3
"""Metres by which a stated size may differ from the stage's."""
_NUMBERS = ("rigid_body_count", "mass")


def metadata_facts(
    stage: Usd.Stage,
    said: Mapping[str, Any],  # Any: values of USD's dictionaries
    book: Writer,
) -> None:
    """The words of `customLayerData`; others than SimReady's are left unread."""
    for key, value in said.items():
        if key != METADATA or not isinstance(value, Mapping):
            book.skip(stage.GetRootLayer().GetDisplayName(), f"customLayerData:{key}", value)
            continue
        for word, stated in value.items():
            if word == "asset_extents":
                if not _is_size_of(stage, stated):
                    book.put("stage", "", {"usd:metadata asset_extents": str(stated)})
            elif word in _NUMBERS and isinstance(stated, int | float):
                book.put("stage", "", {f"usd:metadata {word}": float(stated)})
            else:
                book.put("stage", "", {f"usd:metadata {word}": str(stated)})


def _is_size_of(stage: Usd.Stage, stated: object) -> bool:
    """Whether it is the size of what is seen, or where nothing is, of all shapes."""
    if not isinstance(stated, Gf.Vec3f | Gf.Vec3d):
        return False
    seen = ["default", "render", "proxy"]
    for purposes in (seen, [*seen, "guide"]):
        cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), purposes)
        box = cache.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange()
        if not box.IsEmpty():
            sides = zip(stated, box.GetSize(), strict=True)
            return all(abs(a - b) <= _NEAR for a, b in sides)
    return False


def expected_metadata(robot: str, reference: Reference, book: Writer) -> None:
    """What the recipe and the robot say."""
    about = reference.options.get("about") or {}
    files = (reference.options.get(f"source.{kind}") for kind in ("urdf", "xacro", "mjcf"))
    words = {
        **{word: about.get(word) for word in ("author", "vendor", "description")},
        "tags": ", ".join(about.get("tags", ())),
        "asset_license": reference.options.get("source.license"),
        "source_file": next((PurePosixPath(file).name for file in files if file), None),
        "usd_date_generated": about.get("date") or NO_DATE,
        "asset_name": robot,
        "asset_type": "robot",
        "category": "robot",
        "qcode": ROBOT_QCODE,
        "rigid_body_count": float(len(reference.tree.bodies)),
        "mass": total_mass(reference.tree),
    }
    stated = {f"usd:metadata {word}": value for word, value in words.items() if value}
    book.put("stage", "", stated)
