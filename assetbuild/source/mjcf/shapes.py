"""Geoms of a compiled MJCF as shapes of the Robot, their looks and their surfaces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import chain, count
from typing import Any

from assetbuild.errors import quoted
from assetbuild.findings import Finding, Rule, Severity
from assetbuild.robot.mjcf_only import words
from assetbuild.robot.model import Contact, MjcfOnly
from assetbuild.robot.pose import Pose, Vec3, normalised_quat, rotation_of, vec3
from assetbuild.robot.shapes import (
    Box,
    Capsule,
    Cylinder,
    Material,
    MeshFile,
    Role,
    SourceGeometry,
    SourceShape,
    Sphere,
)
from assetbuild.simulators.mujoco import Model
from assetbuild.source.mjcf.compiled import pose_at
from assetbuild.source.mjcf.links import Links
from assetbuild.source.mjcf.opaque import body_element, keys, leftover
from assetbuild.source.mjcf.text import WORLD, Element, dropped, error_at, parts, where_of
from assetbuild.xml_text import free_name

PLANE, HFIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = range(8)
DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)
GROUPS = {"visual": "2", "collision": "3"}
"""What the MJCF target writes by itself."""
SAID = keys(
    "name class type size pos quat fromto euler axisangle xyaxes zaxis mesh fitscale contype "
    "conaffinity condim priority friction solref solimp margin gap mass density shellinertia "
    "material rgba group"
)
"""Attributes of a geom that the Robot holds, or that its inertia has taken in."""

VISIBLE_COLLISION = Rule(
    "mjcf.visible_collision",
    "info",
    "geoms that collide are drawn, too: a link's only ones, and those in a group of visual geoms, "
    "become a visual and a collision shape each; URDF and USD hold the others as collision only",
    'to see it there, repeat the geom in the MJCF with `contype="0" conaffinity="0" group="2"`',
)


def read_geoms(links: Links) -> Geoms:
    """All geoms of the robot; those of the world only where the world is its root."""
    geoms = Geoms(links)
    scenery: dict[str, list[str]] = {}
    for body, name in links.source.bodies:
        for geom in parts(body, "geom"):
            if name in links.shift:
                geoms.read(geom, name)
            elif name == WORLD:
                kind = geoms.classes.attributes(geom).get("type", "sphere")
                scenery.setdefault(kind, []).append(str(geom.get("name")))
    for kind, names in scenery.items():
        what = f"the {kind} {quoted(names, 6)} of the world was left out: it is scenery"
        if len(names) > 1:
            what = f"{len(names)} geoms of the world were left out, each a {kind}: "
            what += f"{quoted(names, 6)}; they are scenery"
        hint = "`scene.xml` has a floor of its own; a part of the robot belongs into a body"
        severity: Severity = "info" if kind == "plane" else "warning"
        lost = dropped("geom of worldbody", f"shape {names[0]}", what, hint, severity)
        links.findings.append(lost)
    links.findings += geoms.draw()
    worn = {shape.material for shape in geoms.shapes}  # a colour of its own makes another
    geoms.materials = {name: look for name, look in geoms.materials.items() if name in worn}
    links.mjcf_only = [i for i in links.mjcf_only if i.place != "material" or i.owner in worn]
    return geoms


class Geoms:
    """What the geoms of an MJCF amount to.

    contacts: by shape, of all that touch; drawn: those that are also shown, the attributes of
    their geoms, and what only the MJCF keeps of these.
    """

    def __init__(self, links: Links) -> None:
        self.shapes: list[SourceShape] = []
        self.materials: dict[str, Material] = {}
        self.contacts: dict[str, Contact] = {}
        self.links, self.source, root = links, links.source, links.source.root
        self.model, self.classes = links.source.model, links.source.classes
        self.looks = {m.get("name"): m for m in root.iterfind("asset/material")}
        self.pictures = {t.get("name"): t for t in root.iterfind("asset/texture")}
        self.meshes = {m.get("name"): m for m in root.iterfind("asset/mesh")}
        self.drawn: list[tuple[SourceShape, dict[str, str], dict[str, str]]] = []
        self.visual_groups: set[str] = set()

    def read(self, geom: Element, body: str) -> None:
        """Take one over, from a body of the robot."""
        name, attributes = str(geom.get("name")), self.classes.attributes(geom)
        if attributes.get("type") == "hfield":
            owner = next(geom.iterancestors("body"), None)
            is_stated = owner is None or next(parts(owner, "inertial"), None) is not None
            if (
                attributes.get("mass", attributes.get("density", "1")).strip("0. ")
                and not is_stated
            ):
                hint = 'write the body\'s <inertial>, or `mass="0"` at the height field'
                raise error_at(geom, "the mass of a height field is not read", hint)
            what = f"the height field `{name}` of `{body}` was left out: "
            what += "no format of a robot has terrain"
            hint = "the floor of `scene.xml` is flat: add the terrain to your own scene"
            lost = dropped("geom of type hfield", f"shape {name}", what, hint, "warning")
            self.links.findings.append(lost)
            return
        index = self.source.id_of("geom", name)
        touches = bool(self.model.geom_contype[index] or self.model.geom_conaffinity[index])
        role: Role = "collision" if touches else "visual"
        kind = int(self.model.geom_type[index])
        if kind not in (SPHERE, CAPSULE, CYLINDER, BOX, MESH):
            self._only_mjcf(geom, attributes, body, index)
            return
        geometry: SourceGeometry
        if kind == MESH:
            place = self.source.places.geom(name)
            X_link_geom = self.links.in_link(body, pose_at(place.pos, place.quat))
            geometry, X_geom_mesh = self._mesh(geom, str(attributes["mesh"]))
            X_link_geom = X_link_geom @ X_geom_mesh
        else:
            X_link_geom = self.links.in_link(body, self.source.pose_of("geom", name))
            geometry = _primitive(kind, vec3(self.model.geom_size[index]))
        material = self._material(attributes, index) if role == "visual" else None
        shape = SourceShape(name, body, role, geometry, X_link_geom, material)
        self.shapes.append(shape)
        more, group = leftover(attributes, SAID), attributes.get("group", "0")
        if group != GROUPS[role]:
            more["group"] = group
        if role == "visual":
            self.visual_groups.add(group)
        else:
            self.contacts[name] = contact_of(self.model, index)
            if "rgba" in attributes or "material" in attributes:
                more["rgba"] = words(self._colour(index))
            if int(group) < 3 and self._colour(index)[3] > 0.0:
                self.drawn.append((shape, attributes, more))
                return
        self.links.keep("shape", "geom", more, name)

    def draw(self) -> Iterator[Finding]:
        """Give what collides and is drawn a visual shape, too, unless the source has others for it.

        Converters write the visual meshes of a link in a group of their own, beside collision
        shapes that MuJoCo draws because nothing hides them.
        """
        seen = {shape.link for shape in self.shapes if shape.role == "visual"}
        names, left = {shape.name for shape in self.shapes}, list[str]()
        for shape, attributes, more in self.drawn:
            if shape.link in seen and attributes.get("group", "0") not in self.visual_groups:
                left.append(shape.name)
            else:
                look = self._material(attributes, self.source.id_of("geom", shape.name))
                name = free_name(f"{shape.name}_visual", names)
                self.shapes.append(replace(shape, name=name, role="visual", material=look))
                more = {key: value for key, value in more.items() if key not in ("group", "rgba")}
            self.links.keep("shape", "geom", more, shape.name)
        if both := [shape.name for shape, _, _ in self.drawn if shape.name not in left]:
            message = f"{len(both)} geoms collide and are drawn: {quoted(both, 6)}; each became a "
            message += "visual and a collision shape"
            yield VISIBLE_COLLISION("robot", message, data={"geoms": len(both)})
        if left:
            message = f"{len(left)} geoms collide and are drawn beside visual ones of their links: "
            message += f"{quoted(left, 6)}; in URDF and USD they only collide"
            yield VISIBLE_COLLISION("robot", message, data={"geoms": len(left)})

    def _only_mjcf(self, geom: Element, attributes: dict[str, str], body: str, index: int) -> None:
        """A shape that only MJCF has, whole: ellipsoids, planes, signed distance fields."""
        kind = attributes.get("type", "sphere")
        if kind == "sdf":
            hint = "use a mesh or a primitive"
            raise error_at(geom, f"geom `{geom.get('name')}`: a {kind} of a mesh is not read", hint)
        pose = self.links.in_link(body, self.source.pose_of("geom", str(geom.get("name"))))
        kept = leftover(attributes, PLACING | {"mesh", "fitscale"})  # of a fit: as compiled
        if kept.pop("material", None):
            kept["rgba"] = words(self._colour(index))
        size = words(self.model.geom_size[index])
        element = body_element("geom", str(geom.get("name")), pose, {**kept, "size": size})
        self.links.mjcf_only.append(MjcfOnly("body", element, body))

    # --- meshes and looks ---------------------------------------------------------------------

    def _mesh(self, geom: Element, name: str) -> tuple[MeshFile, Pose]:
        """The mesh file with a scale, and where it stands in the geom.

        MuJoCo: vertex = S Rᵀ (v - p) with `scale`, `refquat`, `refpos`. With one scale s for all
        axes that is the mesh scaled by s, turned by Rᵀ and moved by -s Rᵀ p.
        """
        element = self.meshes[name]
        attributes = self.classes.attributes(element)
        scale = _numbers(attributes, "scale", (1.0, 1.0, 1.0))
        p = _numbers(attributes, "refpos", (0.0, 0.0, 0.0))
        w, x, y, z = _numbers(attributes, "refquat", (1.0, 0.0, 0.0, 0.0))
        turn = normalised_quat((w, -x, -y, -z))
        uneven = len(set(scale)) > 1
        if uneven and turn != (1.0, 0.0, 0.0, 0.0):
            hint = "save the vertices `scale * (R(refquat)^T (v - refpos))` as a file (trimesh: "
            hint += "`apply_transform`), and omit the three attributes"
            raise error_at(element, f"mesh `{name}`: turned, then scaled unevenly", hint)
        offset = rotation_of(turn) @ [-v * s for v, s in zip(p, scale, strict=True)]
        if lost := tuple(sorted(set(attributes) & LOST_OF_MESH)):
            message = f"{', '.join(f'`{a}`' for a in lost)} of mesh `{element.get('name')}` was "
            message += f"left out ({where_of(element)})"
            hint = "our meshes are converted: their normals and hulls are made anew"
            finding = dropped("mesh", f"mesh {element.get('file')}", message, hint, attributes=lost)
            if finding not in self.links.findings:
                self.links.findings.append(finding)
        return MeshFile(str(element.get("file")), vec3(scale)), Pose(vec3(offset), turn)

    def _colour(self, index: int) -> tuple[float, float, float, float]:
        """The colour that MuJoCo draws: the geom's own unless that is the default."""
        rgba, material = _rgba(self.model.geom_rgba[index]), int(self.model.geom_matid[index])
        return (
            rgba if material < 0 or rgba != DEFAULT_RGBA else _rgba(self.model.mat_rgba[material])
        )

    def _material(self, attributes: Mapping[str, str], index: int) -> str | None:
        """The material of a visual geom; a colour of its own makes one."""
        colour, look = self._colour(index), self.looks.get(attributes.get("material", ""))
        if look is None and "rgba" not in attributes:
            return None
        known = self._look(look, str(look.get("name"))) if look is not None else Material("rgba")
        if look is not None and known.rgba == colour:
            return known.name
        base = "_".join((known.name, *(f"{round(v * 255):d}" for v in colour)))
        names = chain((base,), (f"{base}_{n}" for n in count(2)))
        looks = (replace(known, name=name, rgba=colour) for name in names)
        worn = next(o for o in looks if self.materials.get(o.name) in (None, o))
        if worn.name not in self.materials:
            self.materials[worn.name] = worn
            stated = ("material", known.name)
            same = [i for i in self.links.mjcf_only if (i.place, i.owner) == stated]
            self.links.mjcf_only += [replace(item, owner=worn.name) for item in same]
        return worn.name

    def _look(self, look: Element, name: str) -> Material:
        if name in self.materials:
            return self.materials[name]
        attributes = self.classes.attributes(look)
        self.links.keep("material", "material", leftover(attributes, keys("rgba texture")), name)
        picture = self.pictures.get(attributes.get("texture", ""))
        layers = look.find("layer")
        file = picture.get("file") if picture is not None else None
        if layers is not None or (picture is not None and file is None):
            message = f"the made or layered picture of material `{name}` was left out; its colour "
            message += "stays"
            hint = "give the material a `texture` with a PNG file"
            self.links.findings.append(dropped("texture", f"material {name}", message, hint))
        material = Material(name, _rgba(self.model.material(name).rgba), file)
        self.materials[name] = material
        return material


def _rgba(values: Any) -> tuple[float, float, float, float]:  # Any: a row of the model
    """The colour that the source states, without the noise of single precision."""
    r, g, b, a = (round(float(v), 7) for v in values)
    return (r, g, b, a)


def contact_of(model: Model, index: int) -> Contact:
    """The surface of a geom; what equals MuJoCo's default stays unsaid."""
    slide, torsion, roll = (float(v) for v in model.geom_friction[index])
    stiff, damp = (float(v) for v in model.geom_solref[index])
    a, b, c, d, e = (float(v) for v in model.geom_solimp[index])
    return Contact.model_construct(  # what a file says may lie outside of a recipe's bounds
        friction=(slide, torsion, roll),
        condim=model.geom_condim[index].item(),
        priority=int(model.geom_priority[index]),
        solref=(stiff, damp) if (stiff, damp) != (0.02, 1.0) else None,
        solimp=(a, b, c, d, e) if (a, b, c, d, e) != (0.9, 0.95, 0.001, 0.5, 2.0) else None,
        margin=float(model.geom_margin[index]),
        gap=float(model.geom_gap[index]),
        contype=int(model.geom_contype[index]),
        conaffinity=int(model.geom_conaffinity[index]),
    )


PLACING = keys("pos quat fromto euler axisangle xyaxes zaxis size mass density shellinertia")
LOST_OF_MESH = keys("maxhullvert smoothnormal octree_maxdepth")


def _primitive(kind: int, size: Vec3) -> SourceGeometry:
    """MJCF counts half edges and half lengths."""
    if kind == SPHERE:
        return Sphere(size[0])
    if kind == CAPSULE:
        return Capsule(size[0], 2 * size[1])
    if kind == CYLINDER:
        return Cylinder(size[0], 2 * size[1])
    return Box((2 * size[0], 2 * size[1], 2 * size[2]))


def _numbers(
    attributes: Mapping[str, str], key: str, default: tuple[float, ...]
) -> tuple[float, ...]:
    return tuple(float(word) for word in attributes[key].split()) if key in attributes else default
