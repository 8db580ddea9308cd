"""What joints, sites, bodies, cameras and lights say that only MJCF has; mimics and surfaces."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from assetbuild.findings import Finding
from assetbuild.robot.model import Camera, MjcfOnly
from assetbuild.robot.pose import IDENTITY
from assetbuild.source.mjcf.links import SLIDE, WORLD, Links, Model, _pose
from assetbuild.source.mjcf.opaque import attributes_of, body_element, keys, leftover, words
from assetbuild.source.mjcf.text import Classes, bodies, error_at, parts

if TYPE_CHECKING:
    from lxml.etree import _Element

_POSE = "pos quat euler axisangle xyaxes zaxis"
_JOINT = keys(f"type axis range limited armature ref springdamper {_POSE}")
_SITE = keys(f"fromto size {_POSE}")
_BODY = keys(f"childclass mocap {_POSE}")
_CAMERA = keys(f"mode target fovy resolution {_POSE}")
_LIGHT = keys(f"dir target texture {_POSE}")
CAMERA_MODES = ("fixed", "track", "trackcom", "targetbody", "targetbodycom")
_LENS = ("focal", "focalpixel", "sensorsize")


@dataclass
class Details:
    """cameras: as the Robot has them. mjcf_only: the rest."""

    cameras: list[Camera] = field(default_factory=list)
    mjcf_only: list[MjcfOnly] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)


def read_details(root: _Element, links: Links, model: Model) -> Details:
    """In the order of the bodies."""
    found, classes = Details(), Classes(root)
    world = root.find("worldbody")
    assert world is not None  # noqa: S101 # it compiled
    found.mjcf_only += _root(links, model)
    for body, name in [(world, WORLD), *((b, str(b.get("name"))) for b, _ in bodies(world))]:
        if name not in links.shift and name != WORLD:
            continue
        if name != WORLD:
            more = leftover(classes.attributes(body), _BODY)
            if more:
                found.mjcf_only.append(MjcfOnly("body", attributes_of("body", more), name))
        for joint in parts(body, "joint"):
            found.mjcf_only += _joint(joint, classes, links, model)
        for site in parts(body, "site"):
            found.mjcf_only += _site(site, name, classes, links, model)
        for camera in parts(body, "camera"):
            _camera(camera, name, classes, links, model, found)
        for light in parts(body, "light"):
            found.mjcf_only.append(_light(light, name, classes, links, model))
    return found


def _root(links: Links, model: Model) -> Iterator[MjcfOnly]:
    """Where a floating root starts without keyframes; its free joint's name, and its brakes."""
    if links.base == "floating" and links.mount != IDENTITY:
        place = {"pos": words(links.mount.xyz)}
        if links.mount.quat != IDENTITY.quat:
            place["quat"] = words(links.mount.quat)
        yield MjcfOnly("root", attributes_of("body", place), links.root)
    if links.free_joint and links.base == "floating":
        first = int(model.jnt_dofadr[int(model.joint(links.free_joint).id)])
        brakes = {
            key: words((float(values[first]),))
            for key, values in (
                ("damping", model.dof_damping),
                ("armature", model.dof_armature),
                ("frictionloss", model.dof_frictionloss),
            )
            if values[first]
        }
        own = {"name": links.free_joint, **brakes}
        yield MjcfOnly("freejoint", attributes_of("freejoint", own))


def _joint(element: _Element, classes: Classes, links: Links, model: Model) -> Iterator[MjcfOnly]:
    name, said = str(element.get("name")), classes.attributes(element)
    index = int(model.joint(name).id)
    if said.get("type") == "free" or int(model.jnt_type[index]) == 0:
        return
    more = leftover(said, _JOINT)
    for key in ("damping", "frictionloss"):
        if len(more.get(key, "0").split()) == 1:  # more numbers are a polynomial
            more.pop(key, None)
    if len(more.get("stiffness", "0").split()) == 1:
        more.pop("stiffness", None)
        more.pop("springref", None)
        stiffness = float(model.jnt_stiffness[index])
        if stiffness:
            rest = float(model.qpos_spring[int(model.jnt_qposadr[index])])
            rest -= links.rest.get(name, 0.0)
            more |= {"stiffness": words((stiffness,))}
            more |= {"springref": words((rest,))} if rest else {}
    if more:
        yield MjcfOnly("joint", attributes_of("joint", more), name)


def _site(
    element: _Element, body: str, classes: Classes, links: Links, model: Model
) -> Iterator[MjcfOnly]:
    site = str(element.get("name"))
    if site not in links.sites:
        return
    said = classes.attributes(element)
    if said.get("mesh"):
        raise error_at(element, f"site `{site}`: a mesh is not read", "use a primitive")
    more = leftover(said, _SITE)
    if more.pop("material", None):
        more["rgba"] = words(tuple(round(float(v), 7) for v in model.site(site).rgba))
    if "size" in said or "fromto" in said:
        more["size"] = words(tuple(float(v) for v in model.site(site).size))
    more.setdefault("group", "0")
    yield MjcfOnly("frame", attributes_of("site", more), links.sites[site])


def _camera(
    element: _Element, body: str, classes: Classes, links: Links, model: Model, found: Details
) -> None:
    name, said = str(element.get("name")), classes.attributes(element)
    index = int(model.camera(name).id)
    mode = CAMERA_MODES[int(model.cam_mode[index])]
    pose = _pose(model.cam_pos, model.cam_quat, index)
    width, height = (int(v) for v in model.cam_resolution[index])
    more = leftover(said, _CAMERA)
    if mode.startswith("target"):
        more |= {"mode": mode, "target": said.get("target", "")}
        mode = "fixed"
    if any(key in said for key in _LENS):
        more["fovy"] = ""  # the lens says it; MuJoCo refuses both
    if "resolution" not in said:
        more["resolution"] = ""
    size = (width, height) if "resolution" in said else Camera("", None, IDENTITY).resolution
    at = body if body in links.shift else None
    pose = links.in_link(body, pose) if at else pose
    fovy = math.radians(float(model.cam_fovy[index]))
    found.cameras.append(Camera(name, at, pose, fovy, size, mode))
    if more:
        found.mjcf_only.append(MjcfOnly("camera", attributes_of("camera", more), name))


def _light(element: _Element, body: str, classes: Classes, links: Links, model: Model) -> MjcfOnly:
    name, said = str(element.get("name")), classes.attributes(element)
    index = int(model.light(name).id)
    pose = _pose(model.light_pos, [IDENTITY.quat] * (index + 1), index)
    owner = body if body in links.shift else ""
    pose = links.in_link(body, pose) if owner else pose
    direction = tuple(float(v) for v in model.light_dir[index])
    more = leftover(said, _LIGHT - {"target"}) | {"dir": words(direction)}
    text = body_element("light", name, pose, more).replace(f' quat="{words(IDENTITY.quat)}"', "")
    return MjcfOnly("body", text, owner)


def is_slide(model: Model, joint: int) -> bool:
    """Whether a joint of the compiled model is prismatic."""
    return int(model.jnt_type[joint]) == SLIDE
