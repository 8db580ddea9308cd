"""The kinds of plug-ins and their fixed ports. A plug-in is one file: its name is the file's.

Every target and check finds the robot under the same input names:

    links.json     Tree before merging fixed joints (after the recipe's edits): the source's links
    tree.json      Tree after merging: the bodies that will be simulated
    shapes.json    Shapes; mesh geometry names an asset
    control.json   Control
    meshes/        the assets, `<name>.obj`

A check finds each target that it `needs` as a folder of that name (`mjcf/`, `usd/`), and the
untouched description (but for comments) as `source.urdf` when `needs` says "source".
"""

from __future__ import annotations

import importlib
import json
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Self, TypeVar

from assetbuild.engine.step import Files, Step
from assetbuild.recipe.models import Recipe
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Box, Capsule, Control, Cylinder, Mesh, Shapes, Sphere, Tree
from assetbuild.robot.pose import IDENTITY, Pose, Vec3

ROBOT_PORTS = ("links.json", "tree.json", "shapes.json", "control.json", "meshes/")


@dataclass(frozen=True)
class Robot:
    """What a target or check reads. mesh_dir holds the files of `shapes.meshes`."""

    links: Tree
    tree: Tree
    shapes: Shapes
    control: Control
    mesh_dir: Path


def read_robot(files: Files) -> Robot:
    """The robot behind the fixed ports."""
    folder = files.inputs
    return Robot(
        links=decode(Tree, (folder / "links.json").read_bytes()),
        tree=decode(Tree, (folder / "tree.json").read_bytes()),
        shapes=decode(Shapes, (folder / "shapes.json").read_bytes()),
        control=decode(Control, (folder / "control.json").read_bytes()),
        mesh_dir=folder / "meshes",
    )


@dataclass(frozen=True)
class MeshPart:
    """One OBJ file of a converted mesh: all its triangles have one material.

    material: the source's name for it; rgba, texture: None = the source states none.
    """

    file: str
    vertices: int
    faces: int
    material: str | None = None
    rgba: tuple[float, float, float, float] | None = None
    texture: str | None = None


@dataclass(frozen=True)
class ConvertedMesh:
    """`mesh.json` beside `parts/`: what `convert_mesh` and `decimate_mesh` write.

    Metres, scale applied, outward normals. lower, upper: bounds. volume_m3: None when open.
    """

    parts: tuple[MeshPart, ...]
    faces: int
    area_m2: float
    lower: Vec3
    upper: Vec3
    watertight: bool
    volume_m3: float | None = None


@dataclass(frozen=True)
class Piece:
    """One collision piece. A `Mesh` geometry names a file in `pieces/`, a convex hull."""

    geometry: Box | Sphere | Cylinder | Capsule | Mesh
    X_frame_piece: Pose = IDENTITY
    vertices: int = 0
    faces: int = 0


@dataclass(frozen=True)
class Pieces:
    """`pieces.json` beside `pieces/`: what a collision method writes."""

    pieces: tuple[Piece, ...]


class Target(Step):
    """Reads the Robot, writes one format below `<name>/`. It may refuse; it may not repair.

    Subclasses set `outputs = ("<name>/",)`; what they write there appears in the bundle as is.
    """

    robot: str
    """Name of the robot: the stem of the main file."""
    reads: ClassVar[tuple[str, ...]] = ROBOT_PORTS
    """The robot ports that this target really reads; the rest is not linked to it."""

    @classmethod
    def configure(cls, recipe: Recipe) -> Self:
        """The step that a recipe asks for."""
        return cls(robot=recipe.robot)


class Check(Step):
    """Reads the Robot and built files, yields findings, writes `figures.json`."""

    outputs = ("figures.json",)
    needs: ClassVar[tuple[str, ...]] = ()
    """Names of targets, and "source" for the untouched description."""
    reads: ClassVar[tuple[str, ...]] = ROBOT_PORTS
    """The robot ports that this check really reads."""
    requires: ClassVar[Mapping[str, str]] = {}
    """Optional module -> the extra that brings it; without it the check is skipped aloud."""

    @classmethod
    def configure(cls, recipe: Recipe) -> Self | None:
        """The step that a recipe asks for; None = the recipe does not want this check."""
        return cls.model_validate({"robot": recipe.robot} if "robot" in cls.model_fields else {})


def write_figures(files: Files, figures: Mapping[str, object]) -> None:
    """The numbers of one check, for the report; floats as `repr`, keys sorted."""
    text = json.dumps(figures, sort_keys=True, indent=1)
    (files.outputs / "figures.json").write_text(text + "\n", encoding="utf-8")


P = TypeVar("P", bound=Step)


def plugin_names(package: str) -> tuple[str, ...]:
    """Names of the plug-ins in a package such as `assetbuild.targets`; imports none of them."""
    path = importlib.import_module(package).__path__
    return tuple(sorted(m.name for m in pkgutil.iter_modules(path) if not m.name.startswith("_")))


def load_plugin(kind: type[P], package: str, name: str) -> type[P]:
    """The one subclass of `kind` that `package.name` defines; KeyError when there is no file."""
    if name not in plugin_names(package):
        raise KeyError(name)
    module = importlib.import_module(f"{package}.{name}")
    own = [
        v for v in vars(module).values() if isinstance(v, type) and v.__module__ == module.__name__
    ]
    found = [v for v in own if issubclass(v, kind)]
    if len(found) != 1:
        raise TypeError(f"{module.__name__} must define exactly one {kind.__name__}")
    return found[0]
