"""The robot as the edits of its recipe leave it: their own code, run on the spot."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from dataclasses import replace
from pathlib import Path
from typing import get_args

from assetbuild.engine.scratch import Scratch, scratch
from assetbuild.errors import AssetBuildError
from assetbuild.geometry.convert_mesh import ConvertMesh
from assetbuild.init.look import InspectedRobot
from assetbuild.init.mesh_points import LARGEST
from assetbuild.init.repairs import Repair
from assetbuild.kinds import Edit
from assetbuild.mesh.read import Format
from assetbuild.plugins import load_plugin
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.shapes import MeshFile, SourceShapes
from assetbuild.robot.tree import merge_fixed_joints


def mended(
    robot: InspectedRobot, root: Path, repairs: Iterable[Repair], turned: Collection[str] = ()
) -> InspectedRobot:
    """Apply the edits in order; one whose mesh only the build can read is left out.

    root: of the source's files; turned: paths of the meshes that the recipe turns as their files
    say. The findings stay those of the source.
    """
    for repair in repairs:
        robot = _applied(robot, root, repair, turned)
    return robot


def _applied(
    robot: InspectedRobot, root: Path, repair: Repair, turned: Collection[str]
) -> InspectedRobot:
    try:
        plugin = load_plugin(Edit, repair.edit)
        edit = plugin.model_validate({repair.kind: re.escape(repair.on), **repair.keys})
        with scratch() as ports:
            ports.put("links.json", encode(robot.links))
            ports.put("shapes.json", encode(robot.shapes))
            _convert(edit, robot.shapes, root, ports, turned)
            ports.run(edit)
            done = RobotFiles(ports.folder)
            links, shapes = done.links, done.source_shapes
    except (AssetBuildError, OSError):
        return robot
    tree, _ = merge_fixed_joints(links, True, ())
    return replace(robot, links=links, tree=tree, shapes=shapes)


def _convert(
    edit: Edit, shapes: SourceShapes, root: Path, ports: Scratch, turned: Collection[str]
) -> None:
    """The meshes that the edit reads, where it looks for them. Raises OSError for a huge one."""
    formats: dict[str, Format] = {f".{format}": format for format in get_args(Format)}
    for index, shape in enumerate(edit.meshes(shapes)):
        assert isinstance(shape.geometry, MeshFile)  # noqa: S101 # that is what it asked for
        path = root / shape.geometry.path
        if path.stat().st_size > LARGEST or path.suffix.lower() not in formats:
            raise OSError(f"left to the build: {shape.geometry.path}")
        with scratch() as own:
            own.put("mesh", path.read_bytes())
            convert = ConvertMesh(
                format=formats[path.suffix.lower()],
                scale=shape.geometry.scale,
                up_axis="honour" if shape.geometry.path in turned else "ignore",
                subject=shape.name,
            )
            own.run(convert)
            folder = ports.folder / "mesh" / str(index)
            folder.mkdir(parents=True)
            (own.folder / "parts").rename(folder / "parts")
            (own.folder / "mesh.json").rename(folder / "mesh.json")
