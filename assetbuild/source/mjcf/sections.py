"""Equalities, tendons, sensors, contact pairs, keyframes and options of an MJCF."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import (
    Joint,
    Keyframe,
    Mimic,
    MjcfOnly,
    Place,
    Sensor,
    Simulation,
)
from assetbuild.robot.pose import Pose, Vec3, normalised_quat, vec3
from assetbuild.source.mjcf.drives import Drives
from assetbuild.source.mjcf.links import WORLD, Links, Model
from assetbuild.source.mjcf.opaque import element_text, keys, words
from assetbuild.source.mjcf.text import AT, DROPPED, Classes, error_at, where_of

if TYPE_CHECKING:
    from lxml.etree import _Element

NOT_READ = ("visual", "statistic", "size", "custom", "extension", "deformable", "skin")
"""Sections without a place in a robot: how it is shown, and what belongs to programs."""

ORDER = Rule(
    "mjcf.order",
    "info",
    "actuators or sensors are in another order than in the source",
    "refer to them by name",
)


@dataclass
class Sections:
    """What stands after the bodies. joints: those of the robot, with their mimics."""

    joints: list[Joint]
    sensors: list[Sensor] = field(default_factory=list)
    keyframes: list[Keyframe] = field(default_factory=list)
    ctrl: list[tuple[str, tuple[tuple[str, float], ...]]] = field(default_factory=list)
    excludes: list[tuple[str, str]] = field(default_factory=list)
    simulation: Simulation = field(default_factory=Simulation)
    mjcf_only: list[MjcfOnly] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)


def read_sections(root: _Element, links: Links, drives: Drives, model: Model) -> Sections:
    """In the order in which MJCF has them."""
    driven = {name: joint for name, joint in drives.names if joint}
    found, names = Sections(list(links.joints)), Names(links, driven)
    classes = Classes(root)
    found.simulation = Simulation.model_construct(
        timestep=float(model.opt.timestep), gravity=_gravity(model)
    )
    found.mjcf_only.append(options(root, model))
    for element in root.iterfind("contact/*"):
        _contact(element, classes, names, found)
    for element in root.iterfind("equality/*"):
        _equality(element, classes, names, model, found)
    for element in root.iterfind("tendon/*"):
        _tendon(element, classes, names, found)
    for element in root.iterfind("sensor/*"):
        _sensor(element, names, found)
    for element in root.iterfind("keyframe/key"):
        _keyframe(element, links, model, found)
    found.findings += _not_read(root)
    return found


class Names:
    """Names of the source's things in the Robot, and which things are not in it.

    driven: joint that an actuator drives in the Robot, by the actuator's name.
    """

    def __init__(self, links: Links, driven: Mapping[str, str]) -> None:
        self.links, self.driven = links, driven
        self._joints = {joint.name for joint in links.joints}

    def there(self, kind: str, name: str) -> bool:
        """Whether a body, joint or site that an element names is part of the Robot."""
        if kind == "body":
            return name == WORLD or name in self.links.shift
        if kind == "site":
            return name in self.links.sites
        return kind != "joint" or name in self._joints

    def of(self, kind: str, name: str) -> str:
        """The name in the Robot."""
        return self.links.sites.get(name, name) if kind == "site" else name


_KIND = {
    "body": "body", "body1": "body", "body2": "body", "joint": "joint", "joint1": "joint",
    "joint2": "joint", "site": "site", "site1": "site", "site2": "site", "refsite": "site",
    "sidesite": "site", "cranksite": "site", "slidersite": "site",
}  # fmt: skip
"""Attribute -> kind of what it names, where the name may change or the thing be missing."""


def _translated(said: Mapping[str, str], names: Names) -> tuple[dict[str, str], str]:
    """Attributes with names of the Robot, and the first name that is not in it, or ""."""
    out, missing = {}, ""
    for key, value in said.items():
        kind = _KIND.get(key, "")
        if key in ("objname", "refname"):
            kind = said.get(key.replace("name", "type"), "")
            kind = "body" if kind == "xbody" else kind
        if kind and not names.there(kind, value):
            missing = missing or value
        out[key] = names.of(kind, value)
    return out, missing


def _dropped(element: _Element, missing: str) -> Finding:
    return DROPPED(
        "robot",
        f"<{element.tag}> `{element.get('name') or ''}` was left out ({where_of(element)}): "
        f"`{missing}` is not part of the robot",
        severity="warning",
        data={"element": str(element.tag), "count": 1},
    )


def _text(element: _Element, said: Mapping[str, str], *, named: bool = True) -> str:
    name = {"name": str(element.get("name"))} if named and element.get("name") else {}
    return element_text(str(element.tag), name | dict(sorted(said.items())))


# --- contact --------------------------------------------------------------------------------


def _contact(element: _Element, classes: Classes, names: Names, found: Sections) -> None:
    said, missing = _translated(classes.attributes(element), names)
    if missing:
        found.findings.append(_dropped(element, missing))
    elif element.tag == "exclude" and WORLD not in (said["body1"], said["body2"]):
        a, b = sorted((said["body1"], said["body2"]))
        found.excludes.append((a, b))
    else:
        found.mjcf_only.append(MjcfOnly("contact", _text(element, said)))


# --- equalities and tendons -----------------------------------------------------------------


def _equality(
    element: _Element, classes: Classes, names: Names, model: Model, found: Sections
) -> None:
    said, missing = _translated(classes.attributes(element), names)
    if missing:
        found.findings.append(_dropped(element, missing))
        return
    if element.tag == "joint" and _mimic(element, said, model, found):
        return
    if element.tag == "connect" and "anchor" in said:
        x, y, z = (float(word) for word in said["anchor"].split())
        said["anchor"] = words(names.links.in_link(said["body1"], Pose((x, y, z))).xyz)
    if element.tag == "weld":
        _refuse_moved(element, said, names)
    found.mjcf_only.append(MjcfOnly("equality", _text(element, said)))


def _mimic(element: _Element, said: Mapping[str, str], model: Model, found: Sections) -> bool:
    """q1 = c0 + c1 q2, counted from the joints' `ref`, as the Robot counts."""
    index = int(model.equality(str(element.get("name"))).id)
    c = [float(v) for v in model.eq_data[index][:5]]
    follower, leader = said.get("joint1", ""), said.get("joint2", "")
    by_name = {joint.name: joint for joint in found.joints}
    if not leader or any(c[2:]) or c[1] == 0.0 or not bool(model.eq_active0[index]):
        return False
    if by_name[follower].mimic or _follows(by_name, leader, follower):
        return False
    coupled = replace(by_name[follower], mimic=Mimic(leader, c[1], c[0]))
    found.joints = [coupled if joint.name == follower else joint for joint in found.joints]
    more = {k: v for k, v in said.items() if k not in ("joint1", "joint2", "polycoef", "active")}
    more["name"] = str(element.get("name"))
    found.mjcf_only.append(MjcfOnly("mimic", element_text("joint", more), follower))
    return True


def _follows(joints: Mapping[str, Joint], name: str, leader: str) -> bool:
    """Whether a joint already follows `leader`: no circles."""
    while (mimic := joints[name].mimic) is not None:
        name = mimic.joint
        if name == leader:
            return True
    return False


def _refuse_moved(element: _Element, said: Mapping[str, str], names: Names) -> None:
    for key in ("body1", "body2"):
        if any(names.links.shift.get(said.get(key, ""), (0.0, 0.0, 0.0))):
            hint = "connect two sites instead"
            text = f"<{element.tag}> on body `{said[key]}`, whose joint has a `pos`"
            raise error_at(element, text, hint)


def _tendon(element: _Element, classes: Classes, names: Names, found: Sections) -> None:
    said, missing = _translated(classes.attributes(element), names)
    children = []
    for child in element.iterchildren("*"):
        own = {str(key): str(value) for key, value in child.attrib.items() if key != AT}
        inside, lost = _translated(own, names)
        missing = missing or lost
        if inside.get("joint") in names.links.rest:
            hint = "give the joint no `ref`, and move its range and body instead"
            raise error_at(child, f"tendon over joint `{inside['joint']}` with `ref`", hint)
        children.append((str(child.tag), inside))
    if missing:
        found.findings.append(_dropped(element, missing))
        return
    material = said.pop("material", None)
    if element.tag == "fixed":  # a class of tendons may say how the spatial ones are drawn
        said.pop("width", None)
        said.pop("rgba", None)
    if material:
        found.findings.append(_plain_tendon(element))
    text = {"name": str(element.get("name"))} | dict(sorted(said.items()))
    found.mjcf_only.append(
        MjcfOnly("tendon", element_text(str(element.tag), text, tuple(children)))
    )


def _plain_tendon(element: _Element) -> Finding:
    return DROPPED(
        f"tendon {element.get('name')}",
        f"the material of tendon `{element.get('name')}` was left out ({where_of(element)})",
        "give the tendon an `rgba`",
        data={"element": "tendon material", "count": 1},
    )


# --- sensors --------------------------------------------------------------------------------

_Kind = Literal["frame", "body", "joint", "actuator", "shape", "camera", "tendon", "world"]
_PLACES: Mapping[str, _Kind] = {
    "site": "frame", "joint": "joint", "actuator": "actuator", "tendon": "tendon",
    "body": "body", "geom": "shape", "camera": "camera", "xbody": "frame",
}  # fmt: skip
_SAID = keys("name cutoff noise objtype objname reftype refname")


def _sensor(element: _Element, names: Names, found: Sections) -> None:
    own = {str(k): str(v) for k, v in element.attrib.items() if k not in (AT, "name")}
    said, missing = _translated(own, names)
    if missing:
        found.findings.append(_dropped(element, missing))
        return
    sensor = _as_sensor(element, said, names)
    if sensor is not None:
        found.sensors.append(sensor)
        if found.mjcf_only and found.mjcf_only[-1].place == "sensor":
            found.findings.append(_reordered(element))
        return
    found.mjcf_only.append(MjcfOnly("sensor", _text(element, said)))


def _as_sensor(element: _Element, said: Mapping[str, str], names: Names) -> Sensor | None:
    """The sensor in the Robot's words; None when they do not say all of it."""
    targets = [key for key in said if key in _PLACES and key not in ("xbody",)]
    extra = set(said) - _SAID - set(targets)
    if extra or len(targets) + ("objname" in said) != 1 or element.tag in ("contact", "user"):
        return None
    if targets == ["actuator"]:
        joint = names.driven.get(said["actuator"], "")
        if not joint:
            return None
        at = Place("actuator", joint)
    elif targets:
        at = Place(_PLACES[targets[0]], said[targets[0]])
    else:
        at = _place(said["objtype"], said["objname"])
    relative = _place(said["reftype"], said["refname"]) if "refname" in said else None
    cutoff, noise = float(said.get("cutoff", 0.0)), float(said.get("noise", 0.0))
    name, kind = str(element.get("name")), str(element.tag)
    return Sensor(name, kind, at, relative, cutoff, noise)


def _place(kind: str, name: str) -> Place:
    if name == WORLD and kind in ("body", "xbody"):
        return Place("world")
    return Place(_PLACES[kind], name)


def _reordered(element: _Element) -> Finding:
    return ORDER(
        "robot",
        f"sensors from `{element.get('name')}` on stand before those that only MJCF has: "
        "their places in `sensordata` differ from the source's",
        "ask for sensors by name",
    )


# --- keyframes and options ------------------------------------------------------------------


def _keyframe(element: _Element, links: Links, model: Model, found: Sections) -> None:
    name = str(element.get("name"))
    index = int(model.key(name).id)
    qpos = [float(v) for v in model.key_qpos[index]]
    base = None
    if links.base == "floating":
        base = links.mount
        if links.free_joint or _floats(model, links.root):
            w, x, y, z = qpos[3:7]
            base = Pose(vec3(qpos[:3]), normalised_quat((w, x, y, z)))
    values = []
    for joint in links.joints:
        if joint.kind != "fixed":
            address = int(model.jnt_qposadr[int(model.joint(joint.name).id)])
            values.append((joint.name, qpos[address] - links.rest.get(joint.name, 0.0)))
    found.keyframes.append(Keyframe(name, tuple(values), base))
    if element.get("ctrl"):
        names = [str(model.actuator(i).name) for i in range(model.nu)]
        found.ctrl.append((name, tuple(zip(names, _floats_of(model.key_ctrl[index]), strict=True))))
    lost = sorted({"qvel", "act", "mpos", "mquat", "time"} & set(element.attrib))
    if lost:
        found.findings.append(_dropped_of_key(element, lost))


def _floats(model: Model, root: str) -> bool:
    index = int(model.body(root).id)
    return bool(model.body_jntnum[index]) and int(model.jnt_type[model.body_jntadr[index]]) == 0


def _floats_of(values: object) -> tuple[float, ...]:
    return tuple(float(v) for v in values)  # type: ignore[attr-defined] # an array of the model


def _dropped_of_key(element: _Element, lost: list[str]) -> Finding:
    return DROPPED(
        f"keyframe {element.get('name')}",
        f"{', '.join(f'`{key}`' for key in lost)} of keyframe `{element.get('name')}` was left "
        "out: a keyframe of a robot is a pose at rest",
        data={"element": "key", "attributes": tuple(lost)},
    )


def _gravity(model: Model) -> Vec3:
    """m/s²; a source that switches gravity off has none, in every format and under its name."""
    import mujoco

    off = int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    return (0.0, 0.0, 0.0) if off else vec3(model.opt.gravity)


def options(root: _Element, model: Model) -> MjcfOnly:
    """`<option>` as the source compiles: what it leaves to MuJoCo's defaults is said too.

    Without the flag `gravity`: see `_gravity`.
    """
    said: dict[str, str] = {}
    flags: dict[str, str] = {}
    for option in root.iterchildren("option"):
        said |= {
            str(k): str(v) for k, v in option.attrib.items() if k not in (AT, "timestep", "gravity")
        }
        for flag in option.iterchildren("flag"):
            flags |= {str(k): str(v) for k, v in flag.attrib.items() if k not in (AT, "gravity")}
    integrators = ("Euler", "RK4", "implicit", "implicitfast")
    number = int(model.opt.integrator)
    if number < len(integrators):
        said.setdefault("integrator", integrators[number])
    said.setdefault("cone", ("pyramidal", "elliptic")[int(model.opt.cone)])
    said.setdefault("impratio", words((float(model.opt.impratio),)))
    children = (("flag", dict(sorted(flags.items()))),) if flags else ()
    return MjcfOnly("option", element_text("option", dict(sorted(said.items())), children))


def _not_read(root: _Element) -> Iterator[Finding]:
    for tag in NOT_READ:
        found = root.findall(tag)
        if found:
            yield DROPPED(
                "robot",
                f"<{tag}> was left out ({where_of(found[0])})",
                "it says nothing about the robot itself",
                severity="info" if tag in ("visual", "statistic", "size") else "warning",
                data={"element": tag, "count": len(found)},
            )
