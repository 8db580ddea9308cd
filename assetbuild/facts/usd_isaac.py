"""Isaac Sim's robot schema: the order of links and joints, names, the kind of robot, poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from assetbuild.facts.table import Writer
from assetbuild.facts.usd_isaac_expected import JOINT, LINK, ROBOT, SITE
from assetbuild.facts.usd_prims import Prim, Units

_POSE = "isaac:robot:pose"


def read_schema(
    top: Prim,
    parts: Mapping[str, Mapping[str, Prim]],
    angular: Mapping[str, bool],
    poses: Sequence[Prim],
    units: Units,
    book: Writer,
) -> None:
    """What the robot's prim, its parts and its poses say.

    parts: prims by path, below the schema that names them; angular: of each joint, by path.
    """
    names = {path: prim.name for prims in parts.values() for path, prim in prims.items()}
    top.has(ROBOT)
    book.put("stage", "", {
        "usd:robot type": top.text("isaac:robotType") or "Default",
        "usd:robot links": _names(top.targets("isaac:physics:robotLinks"), names),
        "usd:robot joints": _names(top.targets("isaac:physics:robotJoints"), names),
        "usd:robot poses": _names(
            top.targets("isaac:robot:namedPoses"), {prim.path: prim.name for prim in poses}
        ),
    })  # fmt: skip
    for schema, word in ((LINK, "nameOverride"), (JOINT, "NameOverride"), (SITE, "")):
        for path, prim in parts[schema].items():
            if prim.has(schema) and word and (said := prim.text(f"isaac:{word}")) is not None:
                book.put("prim", path, {f"usd:isaac:{word}": said})
    for prim in poses:
        _pose(prim, names, angular, units, book)


def _names(paths: Sequence[str], names: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(names.get(path, path) for path in paths)


def _pose(
    prim: Prim,
    names: Mapping[str, str],
    angular: Mapping[str, bool],
    units: Units,
    book: Writer,
) -> None:
    name = prim.name
    prim.metadata.pop("displayName", None)
    joints, stated = prim.targets(f"{_POSE}:joints"), prim.take(f"{_POSE}:jointValues")
    values = [float(value) for value in stated] if stated is not None else []  # type: ignore[attr-defined] # USD's own array
    if len(joints) != len(values):
        said = f"{len(values)} values of {len(joints)} joints"
        book.put("stage", "", {f"usd:pose {name}": said})
        return
    for path, value in zip(joints, values, strict=True):
        at = value * units.length(angular.get(path, True))
        book.put("joint", names.get(path, path), {f"usd:pose {name}": at})
