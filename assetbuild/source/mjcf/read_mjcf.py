"""A flattened MJCF and its meshes -> the Robot: links, shapes, and what drives and watches it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.findings import Finding, Rule
from assetbuild.robot.codec import encode
from assetbuild.robot.contact_filter import passing_pairs
from assetbuild.robot.files import SourceControl
from assetbuild.robot.mjcf_only import words
from assetbuild.robot.model import Base, Camera, Contact, MjcfOnly, Tree
from assetbuild.robot.pose import IDENTITY
from assetbuild.robot.shapes import SourceShapes
from assetbuild.robot.tree import depth_first
from assetbuild.source.mjcf.compiled import compile_source, pose_at
from assetbuild.source.mjcf.drives import Drives, read_drives
from assetbuild.source.mjcf.links import BALL, FREE, Links, read_links
from assetbuild.source.mjcf.opaque import body_element, keys, leftover
from assetbuild.source.mjcf.sections import ORDER, read_sections
from assetbuild.source.mjcf.shapes import read_geoms
from assetbuild.source.mjcf.text import AT, WORLD, Element, error_at, parts

SOURCE_WARNING = Rule(
    "mjcf.source_warning", "warning", "MuJoCo warns about the source", "read the warning"
)


class ReadMjcf(Step):
    """Reads `source.xml`, `lines.json` and the mesh files below `files/`.

    MuJoCo compiles the source; the Robot gets the compiled numbers in full precision. What the
    Robot has no words for travels as `MjcfOnly`; what cannot travel is reported (`mjcf.dropped`).
    Raises SourceError with file and line for what is no robot of rigid bodies on joints.
    """

    usual_s = 0.4
    outputs = ("links.json", "shapes.json", "source_control.json")
    isolated = True
    preload = ("mujoco",)
    limits = Limits(wall_s=120.0, memory_mb=4096)

    base: Base | None = None
    """What the root is; None = as the source says."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes Tree, SourceShapes and SourceControl."""
        root = _source(files.inputs)
        paths = sorted({str(mesh.get("file")) for mesh in root.iterfind("asset/mesh")})
        meshes = {path: (files.inputs / "files" / path).read_bytes() for path in paths}
        compiled = compile_source(root, meshes)
        links = read_links(compiled, self.base)
        cameras = tuple(read_details(links))
        geoms = read_geoms(links)
        drives = read_drives(links)
        surfaces = list(geoms.contacts.values())
        control = replace(
            read_sections(links, drives),
            actuators=tuple(drives.actuators),
            # The surface that most collision shapes have; the first of equals.
            contact=max(surfaces, key=surfaces.count, default=Contact()),
            contacts=tuple(geoms.contacts.items()),
            cameras=cameras,
            mjcf_only=(*links.mjcf_only, *drives.mjcf_only),
        )
        shapes = SourceShapes(tuple(geoms.shapes), tuple(geoms.materials.values()))
        tree = _tree(root.get("model") or "robot", links, drives)
        source = SourceControl(
            control,
            tuple(links.kept),
            _commands(drives, links),
            neighbours=tuple(passing_pairs(tree, shapes, control)),
        )
        (files.outputs / "links.json").write_bytes(encode(tree))
        (files.outputs / "shapes.json").write_bytes(encode(shapes))
        (files.outputs / "source_control.json").write_bytes(encode(source))
        for text in compiled.warnings:
            message = f"MuJoCo warns about the source: {text}"
            yield SOURCE_WARNING("robot", message, "repair it in the source")
        yield from links.findings
        yield from _order(links, drives)


def _source(folder: Path) -> Element:
    """`source.xml`, each element with the place where it stood."""
    from lxml import etree

    root = etree.fromstring((folder / "source.xml").read_bytes())
    lines = json.loads((folder / "lines.json").read_bytes())
    for element, where in zip(root.iter("*"), lines, strict=True):
        element.set(AT, where)
    return root


def _tree(name: str, links: Links, drives: Drives) -> Tree:
    """Depth first, each joint with the effort limit of its drive."""
    order, joints = depth_first(links.root, links.joints)
    by_name = {body.name: body for body in links.bodies}
    efforts = {row.joint: row.effort for row in drives.actuators}
    limits = {j.name: replace(j.limits, effort=efforts.get(j.name)) for j in joints}
    return Tree(
        name,
        links.base,
        tuple(by_name[body] for body in order),
        tuple(replace(joint, limits=limits[joint.name]) for joint in joints),
        X_world_root=links.mount if links.base == "fixed" else IDENTITY,
    )


def _commands(
    drives: Drives, links: Links
) -> tuple[tuple[str, tuple[tuple[str, float], ...]], ...]:
    """Return each keyframe's commands by actuator; position drives count from the joint's `ref`.

    Under "" those of a keyframe that the source does not have.
    """
    by_joint, model = {row.joint: row for row in drives.actuators}, links.source.model
    rest = {
        name: links.rest.get(joint, 0.0) * by_joint[joint].gear
        for name, joint in drives.names
        if joint and by_joint[joint].model == "pd"
    }
    stated = []
    for key in links.source.root.iterfind("keyframe/key"):
        if key.get("ctrl"):
            name = str(key.get("name"))
            ctrl = enumerate(model.key_ctrl[links.source.id_of("key", name)])
            named = ((str(model.actuator(i).name), float(value)) for i, value in ctrl)
            stated.append((name, tuple((a, value - rest.get(a, 0.0)) for a, value in named)))
    moved = any(value for _, value in drives.resting)
    return (*stated, ("", tuple(drives.resting))) if moved else tuple(stated)


def _order(links: Links, drives: Drives) -> Iterator[Finding]:
    """The MJCF that we write has its drives in the order of the joints, the others after them."""
    order = {joint.name: number for number, joint in enumerate(links.joints)}
    places = [order.get(joint, len(order)) for _, joint in drives.names]
    if places != sorted(places):
        names = ", ".join(name for name, _ in drives.names[:6])
        yield ORDER(
            "robot",
            f"the source lists its actuators ({names}, ...) in another order than its joints; the "
            "MJCF that is written lists them in the order of the joints",
            "address actuators by name: a policy of the source has its commands in another order",
            data={"actuators": len(drives.names)},
        )


_POSE = "pos quat euler axisangle xyaxes zaxis"
JOINT = keys(f"type axis range limited armature ref springdamper {_POSE}")
SITE = keys(f"fromto size {_POSE}")
BODY = keys(f"childclass {_POSE}")
CAMERA = keys(f"mode target fovy resolution {_POSE}")
LIGHT = keys(f"dir target texture {_POSE}")
CAMERA_MODES = ("fixed", "track", "trackcom", "targetbody", "targetbodycom")
_LENS = ("focal", "focalpixel", "sensorsize")


def read_details(links: Links) -> Iterator[Camera]:
    """Yield the cameras as the Robot has them; leave the rest to MJCF, in the order of bodies."""
    _keep_root(links)
    for body, name in links.source.bodies:
        if name not in links.shift and name != WORLD:
            continue
        if name != WORLD:
            links.keep("body", "body", leftover(links.source.classes.attributes(body), BODY), name)
        for joint in parts(body, "joint"):
            links.keep("joint", "joint", _joint(links, joint), str(joint.get("name")))
        for site in parts(body, "site"):
            _keep_site(links, site)
        for camera in parts(body, "camera"):
            yield _camera(links, camera, name)
        for light in parts(body, "light"):
            _keep_light(links, light, name)


def _keep_root(links: Links) -> None:
    """Keep where a floating root starts, its free joint's name, and its brakes."""
    posed = links.source.root.find("keyframe/key") is not None  # else a pose may say its height
    if links.base == "floating" and (posed or links.mount != IDENTITY):
        place = {"pos": words(links.mount.xyz)}
        if links.mount.quat != IDENTITY.quat:
            place["quat"] = words(links.mount.quat)
        links.keep("root", "body", place, links.root)
    if links.free_joint and links.base == "floating":
        joint = links.source.entry("joint", links.free_joint)
        brakes = {
            key: words((value,))
            for key in ("damping", "armature", "frictionloss", "stiffness")
            if (value := float(getattr(joint, key)[0]))
        }
        links.keep("freejoint", "freejoint", {"name": links.free_joint, **brakes})


def _joint(links: Links, element: Element) -> dict[str, str]:
    """Return what a joint says that the Robot does not hold."""
    name, attributes = str(element.get("name")), links.source.classes.attributes(element)
    joint = links.source.entry("joint", name)
    if int(joint.type[0]) == FREE:
        return {}
    if int(joint.type[0]) == BALL:
        return _ball(joint, attributes)
    more = leftover(attributes, JOINT)
    for key in ("damping", "frictionloss"):
        if len(more.get(key, "0").split()) == 1:  # more numbers are a polynomial
            more.pop(key, None)
    if len(more.get("stiffness", "0").split()) == 1:
        more.pop("stiffness", None)
        more.pop("springref", None)
        if stiffness := float(joint.stiffness[0]):
            rest = float(joint.qpos_spring[0]) - links.rest.get(name, 0.0)
            more |= {"stiffness": words((stiffness,))}
            more |= {"springref": words((rest,))} if rest else {}
    return more


def _ball(joint: Any, attributes: Mapping[str, str]) -> dict[str, str]:  # Any: of the model
    """Take it as compiled, but for polynomials, which stand as they are."""
    more = leftover(attributes, JOINT | {"springref"})
    for key in ("damping", "frictionloss", "armature", "stiffness"):
        if len(more.get(key, "").split()) <= 1:
            more |= {key: words((float(getattr(joint, key)[0]),))}
        if not any(float(number) for number in more[key].split()):
            del more[key]
    if joint.limited[0]:
        more["range"] = words(joint.range)
    elif attributes.get("limited") == "false":
        more["limited"] = "false"
    return more


def _keep_site(links: Links, element: Element) -> None:
    site, attributes = str(element.get("name")), links.source.classes.attributes(element)
    if site not in links.sites:
        return
    if attributes.get("mesh"):
        raise error_at(element, f"site `{site}`: a mesh is not read", "use a primitive")
    more = leftover(attributes, SITE)
    compiled = links.source.model.site(site)
    if more.pop("material", None):
        more["rgba"] = words(round(float(v), 7) for v in compiled.rgba)
    if "size" in attributes or "fromto" in attributes:
        more["size"] = words(compiled.size)
    more.setdefault("group", "0")
    links.keep("frame", "site", more, links.sites[site])


def _camera(links: Links, element: Element, body: str) -> Camera:
    """Return the camera as the Robot has it, and keep what else it says."""
    name, attributes = str(element.get("name")), links.source.classes.attributes(element)
    model, index = links.source.model, links.source.id_of("camera", name)
    mode = CAMERA_MODES[int(model.cam_mode[index])]
    pose = pose_at(model.cam_pos[index], model.cam_quat[index])
    width, height = (int(v) for v in model.cam_resolution[index])
    more = leftover(attributes, CAMERA)
    if "target" in attributes:  # a mode that looks at nothing may state one, too
        more["target"] = attributes["target"]
    if mode.startswith("target"):
        more["mode"], mode = mode, "fixed"
    if any(key in attributes for key in _LENS):
        more["fovy"] = ""  # the lens says it; MuJoCo refuses both
    if "resolution" not in attributes:
        more["resolution"] = ""
    size = (width, height) if "resolution" in attributes else Camera("", None, IDENTITY).resolution
    links.keep("camera", "camera", more, name)
    at, fovy = body if body in links.shift else None, math.radians(float(model.cam_fovy[index]))
    return Camera(name, at, links.in_link(body, pose), fovy, size, mode)


def _keep_light(links: Links, element: Element, body: str) -> None:
    name, attributes = str(element.get("name")), links.source.classes.attributes(element)
    model, index = links.source.model, links.source.id_of("light", name)
    pose = links.in_link(body, pose_at(model.light_pos[index], IDENTITY.quat))
    more = leftover(attributes, LIGHT - {"target"}) | {"dir": words(model.light_dir[index])}
    text = body_element("light", name, pose, more).replace(f' quat="{words(IDENTITY.quat)}"', "")
    links.mjcf_only.append(MjcfOnly("body", text, body if body in links.shift else ""))
