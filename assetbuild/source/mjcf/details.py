"""What joints, sites, bodies, cameras and lights say that only MJCF has; mimics and surfaces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from assetbuild.robot.model import Camera, MjcfOnly
from assetbuild.robot.pose import IDENTITY
from assetbuild.source.mjcf.compiled import pose_at
from assetbuild.source.mjcf.links import BALL, Links
from assetbuild.source.mjcf.opaque import attributes_of, body_element, keys, leftover, words
from assetbuild.source.mjcf.text import WORLD, error_at, parts

if TYPE_CHECKING:
    from lxml.etree import _Element

_POSE = "pos quat euler axisangle xyaxes zaxis"
JOINT = keys(f"type axis range limited armature ref springdamper {_POSE}")
SITE = keys(f"fromto size {_POSE}")
BODY = keys(f"childclass {_POSE}")
CAMERA = keys(f"mode target fovy resolution {_POSE}")
LIGHT = keys(f"dir target texture {_POSE}")
CAMERA_MODES = ("fixed", "track", "trackcom", "targetbody", "targetbodycom")
_LENS = ("focal", "focalpixel", "sensorsize")


@dataclass
class Details:
    """cameras: as the Robot has them. mjcf_only: the rest."""

    cameras: list[Camera] = field(default_factory=list)
    mjcf_only: list[MjcfOnly] = field(default_factory=list)


def read_details(links: Links) -> Details:
    """In the order of the bodies."""
    found, said = Details(), links.source.classes.attributes
    found.mjcf_only += _root(links)
    for body, name in links.source.bodies:
        if name not in links.shift and name != WORLD:
            continue
        if name != WORLD and (more := leftover(said(body), BODY)):
            found.mjcf_only.append(MjcfOnly("body", attributes_of("body", more), name))
        for joint in parts(body, "joint"):
            found.mjcf_only += _joint(links, str(joint.get("name")), said(joint))
        for site in parts(body, "site"):
            found.mjcf_only += _site(links, site)
        for camera in parts(body, "camera"):
            _camera(links, str(camera.get("name")), said(camera), name, found)
        for light in parts(body, "light"):
            found.mjcf_only.append(_light(links, str(light.get("name")), said(light), name))
    return found


def _root(links: Links) -> Iterator[MjcfOnly]:
    """Where a floating root starts without keyframes; its free joint's name, and its brakes."""
    posed = links.source.root.find("keyframe/key") is not None  # else a pose may say its height
    if links.base == "floating" and (posed or links.mount != IDENTITY):
        place = {"pos": words(links.mount.xyz)}
        if links.mount.quat != IDENTITY.quat:
            place["quat"] = words(links.mount.quat)
        yield MjcfOnly("root", attributes_of("body", place), links.root)
    if links.free_joint and links.base == "floating":
        model = links.source.model
        first = int(model.jnt_dofadr[links.source.id_of("joint", links.free_joint)])
        brakes = {
            key: words((float(value),))
            for key in ("damping", "armature", "frictionloss")
            if (value := getattr(model, f"dof_{key}")[first])
        }
        own = {"name": links.free_joint, **brakes}
        yield MjcfOnly("freejoint", attributes_of("freejoint", own))


def _joint(links: Links, name: str, said: Mapping[str, str]) -> Iterator[MjcfOnly]:
    model, index = links.source.model, links.source.id_of("joint", name)
    if said.get("type") == "free" or int(model.jnt_type[index]) == 0:
        return
    if int(model.jnt_type[index]) == BALL:
        if more := _ball(links, index, said):
            yield MjcfOnly("joint", attributes_of("joint", more), name)
        return
    more = leftover(said, JOINT)
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


def _ball(links: Links, index: int, said: Mapping[str, str]) -> dict[str, str]:
    """As compiled, but for polynomials, which stand as they are."""
    model, dof = links.source.model, int(links.source.model.jnt_dofadr[index])
    more = leftover(said, JOINT | {"springref"})
    for key, value in (
        ("damping", model.dof_damping[dof]),
        ("frictionloss", model.dof_frictionloss[dof]),
        ("armature", model.dof_armature[dof]),
        ("stiffness", model.jnt_stiffness[index]),
    ):
        if len(more.get(key, "").split()) <= 1:
            more |= {key: words((float(value),))}
        if not any(float(number) for number in more[key].split()):
            del more[key]
    if model.jnt_limited[index]:
        more["range"] = words(model.jnt_range[index])
    elif said.get("limited") == "false":
        more["limited"] = "false"
    return more


def _site(links: Links, element: _Element) -> Iterator[MjcfOnly]:
    site, said = str(element.get("name")), links.source.classes.attributes(element)
    if site not in links.sites:
        return
    if said.get("mesh"):
        raise error_at(element, f"site `{site}`: a mesh is not read", "use a primitive")
    more = leftover(said, SITE)
    compiled = links.source.model.site(site)
    if more.pop("material", None):
        more["rgba"] = words(round(float(v), 7) for v in compiled.rgba)
    if "size" in said or "fromto" in said:
        more["size"] = words(compiled.size)
    more.setdefault("group", "0")
    yield MjcfOnly("frame", attributes_of("site", more), links.sites[site])


def _camera(links: Links, name: str, said: Mapping[str, str], body: str, found: Details) -> None:
    model, index = links.source.model, links.source.id_of("camera", name)
    mode = CAMERA_MODES[int(model.cam_mode[index])]
    pose = pose_at(model.cam_pos[index], model.cam_quat[index])
    width, height = (int(v) for v in model.cam_resolution[index])
    more = leftover(said, CAMERA)
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


def _light(links: Links, name: str, said: Mapping[str, str], body: str) -> MjcfOnly:
    model, index = links.source.model, links.source.id_of("light", name)
    pose = pose_at(model.light_pos[index], IDENTITY.quat)
    owner = body if body in links.shift else ""
    pose = links.in_link(body, pose) if owner else pose
    more = leftover(said, LIGHT - {"target"}) | {"dir": words(model.light_dir[index])}
    text = body_element("light", name, pose, more).replace(f' quat="{words(IDENTITY.quat)}"', "")
    return MjcfOnly("body", text, owner)
