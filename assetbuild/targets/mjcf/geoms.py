"""The geoms of a robot: visual in group 2 without contact, collision in group 3."""

from __future__ import annotations

from collections.abc import Mapping

from assetbuild.robot.model import (
    Box,
    Capsule,
    Contact,
    Control,
    Cylinder,
    Geometry,
    Mesh,
    Shape,
    Shapes,
    Sphere,
)
from assetbuild.robot.pose import Pose
from assetbuild.targets.mjcf.classes import Names
from assetbuild.targets.mjcf.surfaces import (
    GeomRow,
    find_geom_classes,
    geom_uses,
    surface_attributes,
)
from assetbuild.targets.mjcf.xml import Element, element, number, numbers, pose_attributes

VISUAL_GROUP, COLLISION_GROUP = "2", "3"


class Geoms:
    """Geom elements and their default classes, which say what geoms have in common."""

    def __init__(
        self,
        shapes: Shapes,
        control: Control,
        roles: Mapping[str, str],
        names: Names,
        X_body_shape: Mapping[str, Pose],
    ) -> None:
        """roles: the class names of `visual` and `collision`, already taken from `names`;
        X_body_shape by the shape's name."""
        surfaces = dict(control.contacts)
        visual = {"type": "mesh", "contype": "0", "conaffinity": "0", "group": VISUAL_GROUP}
        collision = {
            "group": COLLISION_GROUP,
            **surface_attributes(control.contact, Contact()),
        }
        rows = {
            "visual": [
                GeomRow(
                    s,
                    _attributes(s, X_body_shape[s.name])
                    | ({"material": s.material} if s.material else {}),
                )
                for s in shapes.of("visual")
            ],
            "collision": [
                GeomRow(
                    s,
                    _attributes(s, X_body_shape[s.name]),
                    surface_attributes(surfaces.get(s.name, control.contact), control.contact),
                )
                for s in shapes.of("collision")
            ],
        }
        found = [
            (rows[role], find_geom_classes(roles[role], fixed, rows[role], names))
            for role, fixed in (("visual", visual), ("collision", collision))
            if rows[role]
        ]
        self._classes = [role for _, role in found]
        self._uses = {
            name: use for own, role in found for name, use in geom_uses(role, own).items()
        }

    def classes(self) -> list[Element]:
        """The default classes of both roles, without those of roles that no shape has."""
        return [role.element() for role in self._classes]

    def geom(self, shape: Shape) -> Element:
        """One geom, with only what its class does not say."""
        use = self._uses[shape.name]
        said = dict(use.attributes)
        return element(
            "geom",
            {
                "name": shape.name,
                "class": use.class_name,
                "type": said.pop("type", None),
                "size": said.pop("size", None),
                "mesh": shape.geometry.mesh if isinstance(shape.geometry, Mesh) else None,
                **said,
            },
        )


def _attributes(shape: Shape, X_body_shape: Pose) -> dict[str, str]:
    kind, size = _geometry(shape)
    said = {"type": kind, "size": size, **pose_attributes(X_body_shape)}
    return {key: value for key, value in said.items() if value is not None}


def _geometry(shape: Shape) -> tuple[str, str | None]:
    """(type, size): MJCF counts half edges and half lengths."""
    geometry: Geometry = shape.geometry
    match geometry:
        case Box(size):
            return "box", numbers(edge / 2 for edge in size)
        case Sphere(radius):
            return "sphere", number(radius)
        case Cylinder(radius, length):
            return "cylinder", numbers((radius, length / 2))
        case Capsule(radius, length):
            return "capsule", numbers((radius, length / 2))
        case Mesh():
            return "mesh", None
