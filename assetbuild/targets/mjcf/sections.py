"""What stands beside the bodies of `<robot>.xml`: what holds parts together or lets them pass,
sensors, cameras and the sites that they sit on."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from xml.etree.ElementTree import Element

from assetbuild.errors import StepError
from assetbuild.robot.contact_filter import ContactFilter
from assetbuild.robot.model import Camera, Control, Joint, Place, Sensor, Tree
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.robot.shapes import Shapes
from assetbuild.targets.mjcf.drives import locked_at
from assetbuild.targets.mjcf.xml import element, number, numbers, pose_attributes

AT_SITE = frozenset(
    {"accelerometer", "gyro", "velocimeter", "magnetometer", "force", "torque", "touch",
     "rangefinder"}
)  # fmt: skip
_OBJECTS: Mapping[str, str] = {"shape": "geom", "camera": "camera", "body": "body"}


def contact_section(
    tree: Tree,
    shapes: Shapes,
    control: Control,
    hidden: frozenset[str],
    body_names: Mapping[str, str],
) -> Element:
    """The pairs of the recipe that MuJoCo does not filter itself, with a floating base or pinned.

    MuJoCo filters a body and its parent, unless the parent is part of the world.
    hidden: links that are no bodies in the MJCF.
    """
    rule = ContactFilter.of(tree, shapes, control)
    pairs = [
        element("exclude", {"body1": body_names[a], "body2": body_names[b]})
        for a, b in control.excludes
        if not hidden & {a, b}  # without shapes, they touch nothing
        and not rule.holds_without(tree.root, a, b)
    ]
    return element("contact", None, pairs)


def equality_section(
    joints: Iterable[Joint], control: Control, sites: Mapping[str, tuple[str, str]]
) -> Element:
    """Mimic joints: q = offset + multiplier * q(leader). Locked ones: q = a constant.

    Loops hold two sites together: of two bodies and one anchor MuJoCo holds what meets at qpos0.
    sites: names by that of the loop.
    """
    held: list[Element] = []
    soft = dict(control.soft_couplings)
    for joint in joints:
        leader, offset, multiplier = None, locked_at(joint), 0.0
        if joint.mimic:
            leader, offset = joint.mimic.joint, joint.mimic.offset
            multiplier = joint.mimic.multiplier
        if offset is not None:
            attributes = {
                "name": joint.name,
                "joint1": joint.name,
                "joint2": leader,
                "polycoef": numbers((offset, multiplier, 0.0, 0.0, 0.0)),
            }
            if joint.name in soft:
                attributes["solref"] = numbers(soft[joint.name].solref)
                attributes["solimp"] = numbers(soft[joint.name].solimp)
            held.append(element("joint", attributes))
    for loop in control.loops:
        is_weld = loop.kind == "weld"
        attributes = {
            "name": loop.name,
            "site1": sites[loop.name][0],
            "site2": sites[loop.name][1],
            "torquescale": number(loop.torque_scale) if is_weld else None,
            "solref": numbers(loop.solref),
            "solimp": numbers(loop.solimp),
        }
        held.append(element(loop.kind, attributes))
    return element("equality", None, held)


# --- sensors -------------------------------------------------------------------------------------


def extra_sites(tree: Tree, control: Control) -> Iterator[str]:
    """Bodies that need a site in their origin because a sensor sits there."""
    for sensor in control.sensors:
        if sensor.kind in AT_SITE and sensor.at.kind == "frame" and sensor.at.name in tree.by_body:
            yield sensor.at.name


def refuse_hidden(control: Control, hidden: Collection[str]) -> None:
    """StepError for what sits on a link that is no body in the MJCF (see `robot.chains`)."""
    seats = [(f"loop {loop.name}", end.body) for loop in control.loops for end in loop.ends]
    seats += [(f"camera {c.name}", c.link) for c in control.cameras if c.link]
    for sensor in control.sensors:
        places = (sensor.at, sensor.relative_to or sensor.at)
        seats += [(f"sensor {sensor.name}", p.name) for p in places if p.kind in ("frame", "body")]
    for what, link in seats:
        if link in hidden:
            raise StepError(
                f"{what}: link `{link}` has no mass and is no body in the MJCF",
                hint="put it on the link that the joints move, or give the link its mass",
            )


def sensor_section(
    control: Control, bodies: Mapping[str, str], drives: Mapping[str, str]
) -> Element:
    """`<sensor>`; StepError for one that MJCF does not know in this place.

    bodies, drives: names in the MJCF by the name of the body, and of the joint.
    """
    made = [_sensor(sensor, bodies, drives) for sensor in control.sensors]
    return element("sensor", None, made)


def _sensor(sensor: Sensor, bodies: Mapping[str, str], drives: Mapping[str, str]) -> Element:
    attributes: dict[str, str | None] = {"name": sensor.name, **_at(sensor, bodies, drives)}
    if sensor.relative_to is not None and sensor.relative_to.kind != "world":
        attributes["reftype"], attributes["refname"] = _object(sensor.relative_to, bodies)
    attributes["cutoff"] = number(sensor.cutoff) if sensor.cutoff else None
    attributes["noise"] = number(sensor.noise) if sensor.noise else None
    return element(sensor.kind, attributes)


def _at(sensor: Sensor, bodies: Mapping[str, str], drives: Mapping[str, str]) -> Mapping[str, str]:
    kind, at = sensor.kind, sensor.at
    if kind in AT_SITE and at.kind == "frame":
        return {"site": bodies.get(at.name, at.name)}
    if kind == "contact" and at.kind == "shape":
        # The strongest contact of the shape, with whatever touches it.
        return {"geom1": at.name, "data": "found force", "reduce": "maxforce", "num": "1"}
    if kind.startswith("frame"):
        objtype, name = _object(at, bodies)
        return {"objtype": objtype, "objname": name}
    if kind.startswith("subtree") and at.kind in ("body", "frame"):
        return {"body": bodies.get(at.name, at.name)}
    if at.kind in ("joint", "tendon", "camera"):
        return {at.kind: at.name}
    if at.kind == "actuator" and at.name in drives:
        return {"actuator": drives[at.name]}
    if at.kind == "world":
        return {}
    raise StepError(
        f"sensor {sensor.name}: MJCF has no {kind} at {at.kind} `{at.name}`",
        hint="an actuator sensor needs a joint with a drive; others a link" if at.name else "",
    )


def _object(place: Place, bodies: Mapping[str, str]) -> tuple[str, str]:
    """objtype and objname: a body's own frame is `xbody`, its inertial frame `body`."""
    if place.kind == "world":
        return "xbody", "world"
    if place.kind == "frame":
        return ("xbody", bodies[place.name]) if place.name in bodies else ("site", place.name)
    return _OBJECTS[place.kind], bodies.get(place.name, place.name)


def camera_elements(tree: Tree, control: Control) -> Iterator[tuple[str | None, Element]]:
    """(body, `<camera>`); None: the world."""
    for camera in control.cameras:
        body, X_body_link = tree.placement(camera.link) if camera.link else (None, IDENTITY)
        yield body, _camera(camera, X_body_link @ camera.X_link_camera)


def _camera(camera: Camera, X_body_camera: Pose) -> Element:
    width, height = camera.resolution
    return element(
        "camera",
        {
            "name": camera.name,
            "mode": camera.tracking if camera.tracking != "fixed" else None,
            **pose_attributes(X_body_camera),
            "fovy": number(to_mjcf_degrees(camera.fovy)),
            "resolution": f"{width} {height}",
        },
    )


def to_mjcf_degrees(angle: float) -> float:
    """A field of view: MJCF counts it in degrees whatever `compiler angle` says."""
    return math.degrees(angle)


def site_elements(
    tree: Tree, body_sites: Sequence[str], names: Mapping[str, str]
) -> Iterator[tuple[str, Element]]:
    """(body, site): one per kept frame, and one in the origin of each body of `body_sites`."""
    for frame in tree.frames:
        attributes = {"name": frame.name, **pose_attributes(frame.X_body_frame)}
        yield frame.body, element("site", attributes)
    for body in body_sites:
        yield body, element("site", {"name": names[body]})
