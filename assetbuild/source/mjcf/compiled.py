"""The source as MuJoCo understands it: compiled once as it is, once without its meshes.

Defaults, angles, frames, `fromto`, inertia from shapes: MuJoCo resolves them, in doubles. It also
moves every mesh to its own principal axes, so where a mesh stands is read from a second model in
which spheres hold the places of the meshes.
"""

from __future__ import annotations

import copy
import math
import posixpath
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from assetbuild.errors import SourceError, StepError, Where
from assetbuild.lfs import refuse_pointer
from assetbuild.robot.pose import Pose, normalised_quat, vec3
from assetbuild.simulators.mujoco import Model, caught_warnings, mj
from assetbuild.source.mjcf.text import (
    FROM_OUTSIDE,
    Classes,
    Element,
    error_at,
    named_bodies,
    of_bodies,
    own_attributes,
    plain_text,
    remove,
    where_of,
)

_LINE = re.compile(r",? line (\d+)")


@dataclass(frozen=True)
class Compiled:
    """A flattened source: what it says, and what MuJoCo makes of it.

    model: the robot. places: the same, a small sphere in the place of each mesh.
    warnings: what MuJoCo said about the source.
    """

    root: Element
    model: Model
    places: Model
    warnings: tuple[str, ...]

    @cached_property
    def classes(self) -> Classes:
        """The default classes that speak for the elements."""
        return Classes(self.root)

    @cached_property
    def bodies(self) -> list[tuple[Element, str]]:
        """(element, name) of the world and of all bodies, depth first in file order."""
        return named_bodies(self.root)

    def entry(self, kind: str, name: str) -> Any:  # Any: MuJoCo's view of one
        """Return a body, joint, geom, site, camera, light, key, ... of the model."""
        return getattr(self.model, kind)(name)

    def id_of(self, kind: str, name: str) -> int:
        """Return the number of an entry."""
        return int(self.entry(kind, name).id)

    def pose_of(self, kind: str, name: str) -> Pose:
        """Where a body stands in its parent, or a geom, site or camera in its body."""
        entry = self.entry(kind, name)
        return pose_at(entry.pos, entry.quat)

    def joints_of(self, body: str) -> range:
        """Numbers of the joints on a body."""
        entry = self.entry("body", body)
        return range(int(entry.jntadr[0]), int(entry.jntadr[0] + entry.jntnum[0]))

    def joint_kinds(self, body: str) -> list[int]:
        """MuJoCo's numbers of their types, see `links.FREE`."""
        return [int(self.model.jnt_type[joint]) for joint in self.joints_of(body)]


def pose_at(position: Any, quat: Any) -> Pose:  # Any: rows of the model
    """A pose in plain numbers."""
    w, x, y, z = (float(v) for v in quat)
    return Pose(vec3(position), normalised_quat((w, x, y, z)))


def compile_source(root: Element, files: Mapping[str, bytes]) -> Compiled:
    """Compile a flattened source; SourceError with MuJoCo's words and our line.

    files: content of each mesh file by its path below the source's root.
    """
    for path, content in files.items():
        refuse_pointer(content, where=Where(path))
    _refuse_not_finite(root)
    bare = plain(root)
    full, warnings = _compiled(bare, _by_number(bare, files))
    if any("NaN" in text for text in warnings):
        raise error_at(root, "a number in it is NaN")
    try:
        places, _ = _compiled(without_meshes(bare), {})
    except SourceError as error:
        message = "a bug in assetbuild: what it made of the source's text is refused: "
        message += error.message
        hint = "please report it with this file"
        raise StepError(message, where=where_of(root), hint=hint) from None
    return Compiled(root, full, places, warnings)


def _by_number(root: Element, files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Number the mesh files: to MuJoCo, files of one name in two folders are one."""
    names = {path: f"{number}_{posixpath.basename(path)}" for number, path in enumerate(files)}
    for mesh in root.iterfind("asset/mesh"):
        if mesh.get("file") in names:
            mesh.set("file", names[str(mesh.get("file"))])
    return {names[path]: content for path, content in files.items()}


def _compiled(root: Element, files: Mapping[str, bytes]) -> tuple[Model, tuple[str, ...]]:
    text = plain_text(root, indented=True)
    with caught_warnings() as warnings:
        try:
            model = mj.MjModel.from_xml_string(text, dict(files))
        except (ValueError, RuntimeError) as error:  # the latter where it finds no memory
            raise _refusal(str(error), text, root) from None
    return model, tuple(" ".join(line.split()) for line in warnings)


def _refuse_not_finite(root: Element) -> None:
    """SourceError for an attribute with NaN or infinity; a name may be called so."""
    names = {element.get("name") for element in root.iter("*")}
    for element in root.iter("*"):
        for key, value in own_attributes(element).items():
            if "name" in key or value in names:
                continue
            with suppress(ValueError):  # words
                if not all(math.isfinite(float(word)) for word in value.split()):
                    message = f"<{element.tag}> `{key}` is `{value}`: not a finite number"
                    raise error_at(element, message, "leave out a limit that limits nothing")


def _refusal(message: str, text: str, root: Element) -> SourceError:
    """MuJoCo's complaint with the line of the source instead of that of our text."""
    from lxml import etree

    words = " ".join(message.removeprefix("XML Error: ").removeprefix("Error: ").split())
    match = _LINE.search(words)
    at = root
    if match:
        lines = [int(element.sourceline or 0) for element in etree.fromstring(text).iter("*")]  # type: ignore[call-overload] # the stubs call it a literal
        if int(match[1]) in lines:
            at = list(root.iter("*"))[lines.index(int(match[1]))]
        words = _LINE.sub("", words)
    hint = FROM_OUTSIDE if "not found" in words else ""
    if "unrecognized" in words:
        hint = "correct its spelling or its place; or remove it, where MuJoCo "
        hint += f"{mj.__version__} no longer knows it"
    return error_at(at, f"MuJoCo does not compile it: {words}", hint)


def plain(root: Element) -> Element:
    """The source without pictures, skins and height fields, its bodies and shapes all kept."""
    bare = copy.deepcopy(root)
    for element in list(bare.iter("texture", "layer", "hfield", "skin")):
        remove(element)
    for element in bare.iter("material", "light"):
        element.attrib.pop("texture", "")
    classes = Classes(bare)
    for geom in of_bodies(bare, "geom"):
        if classes.attributes(geom).get("type") == "hfield":
            remove(geom)
    return bare


def without_meshes(root: Element) -> Element:
    """The source with small spheres in the places of its meshes."""
    spheres = copy.deepcopy(root)
    classes = Classes(spheres)
    shapes = of_bodies(spheres, "geom", "site")
    for geom in [one for one in shapes if classes.attributes(one).get("mesh")]:
        geom.set("type", "sphere")
        geom.set("size", "0.01")
        geom.attrib.pop("fitscale", "")
    for element in spheres.iter("geom", "site"):
        element.attrib.pop("mesh", "")
    for mesh in spheres.findall("asset/mesh"):
        remove(mesh)
    return spheres
