"""The description as links, shapes and what else it says: URDF or MJCF."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

from assetbuild.engine.graph import Ref
from assetbuild.engine.planner import Planner
from assetbuild.recipe.models import Recipe
from assetbuild.source.mjcf.flatten_mjcf import FlattenMjcf
from assetbuild.source.mjcf.inline import FOLDER
from assetbuild.source.mjcf.read_mjcf import ReadMjcf
from assetbuild.source.plan import Description, SourceFiles
from assetbuild.source.urdf.read_urdf import ReadUrdf


@dataclass(frozen=True)
class Reading:
    """What a reader made of the description.

    robot: `links.json` and `shapes.json`. meshes: listing of the files it names; files: those
        of an MJCF by path, which its reader has asked for already.
    control: `source_control.json` of an MJCF. urdf: the untouched description, when it is one.
    mjcf: `source.xml` and its meshes as a check finds them, by input name.
    """

    robot: Mapping[str, Ref]
    meshes: Ref
    files: Mapping[str, Ref] | None = field(default=None, kw_only=True)
    source_map: Ref
    control: Ref | None = None
    urdf: Ref | None = None
    mjcf: Mapping[str, Ref] = field(default_factory=dict)


def read_description(
    recipe: Recipe, source: SourceFiles, description: Description, p: Planner
) -> Reading | None:
    """The steps that read the robot; None while an answer is missing."""
    if recipe.source.mjcf is not None:
        return _read_mjcf(recipe, source, description, p)
    origin = recipe.source
    step = ReadUrdf(
        file=description.path,
        base=recipe.base,
        packages=dict(sorted(origin.packages.items())),
        relative_to=origin.relative_to,
        absolute=dict(sorted(origin.absolute.items())),
        missing=tuple(sorted(origin.missing.visuals)),
    )
    read = p.add("read_urdf", step, {"robot.urdf": description.ref})
    return Reading(
        robot={port: read[port] for port in ("links.json", "shapes.json")},
        meshes=read["meshes.json"],
        source_map=read["source_map.json"],
        urdf=read["source.urdf"],
    )


def _read_mjcf(
    recipe: Recipe, source: SourceFiles, description: Description, p: Planner
) -> Reading | None:
    tree = {description.path: description.ref} | dict(description.includes)
    inputs = {f"tree/{path}": ref for path, ref in sorted(tree.items())}
    step = FlattenMjcf(file=description.path, body=recipe.source.body)
    if "grammar" in recipe.stated("mjcf"):
        step = step.model_copy(update={"grammar": recipe.value("mjcf.grammar")})
    flat = p.add("flatten_mjcf", step, inputs)
    answer = p.ask(flat["meshes.json"])
    listed = json.loads(answer) if answer is not None else []
    own = [entry for entry in listed if not entry["path"].startswith(FOLDER)]
    files = source.meshes(own, description.path) if answer is not None else None
    if files is None:
        return None
    made = (entry["path"] for entry in listed if entry not in own)
    files = {**files, **{path: flat["inline/"] / path.removeprefix(FOLDER) for path in made}}
    given = {"source.xml": flat["source.xml"]}
    given |= {f"files/{path}": ref for path, ref in files.items()}
    # Without the key the source itself says whether its root floats.
    base = recipe.base if "base" in recipe.model_fields_set else None
    read = p.add("read_mjcf", ReadMjcf(base=base), {**given, "lines.json": flat["lines.json"]})
    return Reading(
        robot={port: read[port] for port in ("links.json", "shapes.json")},
        meshes=flat["meshes.json"],
        files=files,
        source_map=flat["source_map.json"],
        control=read["source_control.json"],
        mjcf=given,
    )
