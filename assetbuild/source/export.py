"""What a CAD export leaves beside the URDF."""

from __future__ import annotations

import posixpath

from assetbuild.engine.planner import Planner
from assetbuild.recipe.models import Recipe
from assetbuild.source.plan import Description, SourceFiles
from assetbuild.source.reading import Reading
from assetbuild.source.urdf.lint_export import LintExport


def lint_export(
    recipe: Recipe, source: SourceFiles, description: Description, read: Reading, p: Planner
) -> None:
    """Add the lint of SolidWorks' and Onshape's exports; nothing for an MJCF or a xacro."""
    if recipe.source.urdf is None:
        return
    path = recipe.source.urdf
    folder, stem = posixpath.dirname(path), posixpath.splitext(posixpath.basename(path))[0]
    table = posixpath.join(folder, f"{stem}.csv")
    config = posixpath.normpath(posixpath.join(folder, "..", "config"))
    names = posixpath.join(config, f"joint_names_{stem}.yaml")
    wanted = {table} if config.startswith("..") else {table, names}
    beside = source.present("export tables", wanted)
    if beside is None:
        return
    inputs = {"robot.urdf": description.ref, "links.json": read.robot["links.json"]}
    inputs |= {"table.csv": beside[table]} if table in beside else {}
    inputs |= {"joint_names.yaml": beside[names]} if names in beside else {}
    step = LintExport(
        table=table if table in beside else "", names=names if names in beside else ""
    )
    p.add("lint_export", step, inputs)
