"""A robot as the files of a folder: each is read when it is asked for, and once."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TypeVar

from assetbuild.robot.codec import decode_file, reader_of
from assetbuild.robot.model import Contact, Control, Tree
from assetbuild.robot.shapes import Shapes, SourceShapes

T = TypeVar("T")
READERS = tuple(map(reader_of, (Tree, Shapes, Control)))
"""Made when this is imported: once for all forks of a process."""


@dataclass(frozen=True)
class SourceControl:
    """`source_control.json`, which `steps.control` joins with the recipe.

    control: in the names of the source's links and shapes, before merging and assembling;
        each moving joint has an actuator, passive where the source drives it otherwise.
    bodies: links that are bodies of the source with mass; the others only name places.
    ctrl: (keyframe, command by actuator) where the source states any; under "" those at rest in the
        zero pose, of actuators that drive no joint.
    surfaces: of a composite, by the prefix of each part, the surface that most of its shapes
        have; `control.contact` is the base's.
    neighbours: pairs of links that MuJoCo lets pass in the source without an exclude; an edit of
        the links between them does not change that.
    """

    control: Control = field(default_factory=Control)
    bodies: tuple[str, ...] = ()
    ctrl: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    surfaces: tuple[tuple[str, Contact], ...] = ()
    neighbours: tuple[tuple[str, str], ...] = ()


def _stored(kind: type[T], name: str) -> cached_property[T]:
    """What the file of this name holds."""
    return cached_property(lambda robot: decode_file(kind, robot.folder / name))


class RobotFiles:
    """The robot below `folder`, under the names that every step, target and check uses.

    A step has only the files that it declares; asking for another raises FileNotFoundError.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    links = _stored(Tree, "links.json")
    """The source's links, before fixed joints are merged."""
    tree = _stored(Tree, "tree.json")
    """The bodies that will be simulated, after merging."""
    shapes = _stored(Shapes, "shapes.json")
    """Visual and collision shapes with their materials, as `assemble` writes them."""
    source_shapes = _stored(SourceShapes, "shapes.json")
    """The shapes that the source describes, which stand in that file before `assemble`."""
    control = _stored(Control, "control.json")
    """Actuators, keyframes, contact and sensors."""
    ratings = _stored(Control, "ratings.json")
    """What a gain leaves alone: effort, velocity, damping and friction of the joints."""

    @cached_property
    def source_control(self) -> SourceControl | None:
        """What the source says beyond links and shapes; None of a source that says nothing."""
        file = self.folder / "source_control.json"
        return decode_file(SourceControl, file) if file.is_file() else None

    @property
    def mesh_dir(self) -> Path:
        """Folder of the files that `shapes.meshes` names."""
        return self.folder / "meshes"

    @property
    def hulls(self) -> Path:
        """File with the hulls of these meshes: see `mesh.hulls`."""
        return self.folder / "hulls.npz"

    @property
    def triangles(self) -> Path:
        """File with these meshes themselves, likewise."""
        return self.folder / "triangles.npz"
