"""Visual and collision geometry: as a source names it, and as the robot holds it."""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace
from typing import Literal

from assetbuild.robot.pose import IDENTITY, Pose, Vec3

Role = Literal["visual", "collision"]


@dataclass(frozen=True)
class Box:
    """size: full edge lengths, m."""

    size: Vec3


@dataclass(frozen=True)
class Sphere:
    """radius: m."""

    radius: float


@dataclass(frozen=True)
class Cylinder:
    """Axis z, centred; length: full, m."""

    radius: float
    length: float


@dataclass(frozen=True)
class Capsule:
    """Axis z, centred; length: of the cylinder between the two half spheres, m."""

    radius: float
    length: float


Primitive = Box | Sphere | Cylinder | Capsule


def sizes_of(primitive: Primitive) -> tuple[float, ...]:
    """Edges of a box, else radius and length, m."""
    return primitive.size if isinstance(primitive, Box) else astuple(primitive)


@dataclass(frozen=True)
class MeshFile:
    """A mesh as a source names it. path: below the source's root; scale: per axis.

    `assemble` puts `Mesh`es in the places of all of them.
    """

    path: str
    scale: Vec3 = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Mesh:
    """mesh: name of a `MeshAsset`, whose vertices are in metres whatever its source's scale."""

    mesh: str


SourceGeometry = Primitive | MeshFile
Geometry = Primitive | Mesh


@dataclass(frozen=True)
class Material:
    """rgba in 0..1; texture: file name of a PNG in the mesh folder, or None."""

    name: str
    rgba: tuple[float, float, float, float] = (0.5, 0.5, 0.5, 1.0)
    texture: str | None = None


@dataclass(frozen=True)
class Placed:
    """One piece of geometry at its place.

    name: unique among the shapes of the robot.
    link: the source link that carries it (see `Tree.placement`).
    material: name of one of the robot's materials; None = the format's default. Collision has none.
    """

    name: str
    link: str
    role: Role
    geometry: Primitive | MeshFile | Mesh
    X_link_shape: Pose = IDENTITY
    material: str | None = None


@dataclass(frozen=True)
class SourceShape(Placed):
    """A shape as the source describes it, edits included: the build has not converted it yet."""

    geometry: SourceGeometry


@dataclass(frozen=True)
class Shape(Placed):
    """A shape as `assemble` writes it, and as all targets and checks read it."""

    geometry: Geometry


@dataclass(frozen=True)
class MeshAsset:
    """A mesh file of the bundle: `<name>.obj`, metres, triangles.

    name: `<stem>-<8 of the digest>`. convex: the file is a convex hull (collision pieces are).
    """

    name: str
    file: str
    vertices: int
    faces: int
    convex: bool = False


@dataclass(frozen=True)
class SourceShapes:
    """All geometry that a source describes."""

    shapes: tuple[SourceShape, ...] = ()
    materials: tuple[Material, ...] = ()

    def of(self, role: Role) -> tuple[SourceShape, ...]:
        """The shapes of one role, in order."""
        return tuple(shape for shape in self.shapes if shape.role == role)


@dataclass(frozen=True)
class Shapes:
    """All geometry of the robot."""

    shapes: tuple[Shape, ...] = ()
    materials: tuple[Material, ...] = ()
    meshes: tuple[MeshAsset, ...] = ()

    def of(self, role: Role) -> tuple[Shape, ...]:
        """The shapes of one role, in order."""
        return tuple(shape for shape in self.shapes if shape.role == role)

    @property
    def all_coloured(self) -> Shapes:
        """The shapes with MuJoCo's grey material on each visual shape that has none.

        For formats in which a shape without a material looks different in every program.
        """
        if all(shape.material is not None for shape in self.of("visual")):
            return self
        taken = {material.name for material in self.materials}
        name = next(n for n in ("grey", *(f"grey_{i}" for i in range(99))) if n not in taken)
        shapes = (
            replace(shape, material=name)
            if shape.role == "visual" and shape.material is None
            else shape
            for shape in self.shapes
        )
        return replace(self, shapes=tuple(shapes), materials=(*self.materials, Material(name)))
