"""Equalities, tendons, sensors, contact pairs, keyframes and options of an MJCF."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Literal

from assetbuild.findings import Finding, Rule, Severity
from assetbuild.robot.loops import FAR
from assetbuild.robot.mjcf_only import words
from assetbuild.robot.model import (
    Control,
    Keyframe,
    Loop,
    LoopEnd,
    Mimic,
    MjcfOnly,
    Place,
    Sensor,
    Simulation,
)
from assetbuild.robot.pose import IDENTITY, Pose, Vec3, vec3
from assetbuild.simulators.mujoco import LEAST_STEP_S, Model, mj
from assetbuild.simulators.mujoco.linear_couplings import tendon_coupling
from assetbuild.source.mjcf.compiled import pose_at
from assetbuild.source.mjcf.drives import Drives
from assetbuild.source.mjcf.links import FREE, JOINT_REF, ORIGIN, Links
from assetbuild.source.mjcf.opaque import element_text, keys, leftover
from assetbuild.source.mjcf.text import WORLD, Element, dropped, error_at, own_attributes, where_of

NOT_READ = ("visual", "statistic", "size", "custom", "extension", "deformable", "skin")
"""Sections without a place in a robot: how it is shown, and what belongs to programs."""

ORDER = Rule(
    "mjcf.order",
    "info",
    "actuators or sensors are in another order than in the source",
    "refer to them by name",
)


TETHER = Rule(
    "mjcf.base_constrained",
    "warning",
    "a `connect` or `weld` holds a floating robot to the world, in the MJCF only",
    "remove it, or write `base: fixed`",
)


_Kind = Literal["frame", "body", "joint", "actuator", "shape", "camera", "tendon", "world"]
_PLACES: Mapping[str, _Kind] = {
    "site": "frame", "joint": "joint", "actuator": "actuator", "tendon": "tendon",
    "body": "body", "geom": "shape", "camera": "camera", "xbody": "frame",
}  # fmt: skip
LOOP_WORDS = keys(
    "name class body1 body2 site1 site2 anchor relpose solref solimp torquescale active"
)
"""Attributes of a `connect` or `weld` that a loop of the robot holds."""
USUAL_ARENA = 2**24
"""Bytes: MuJoCo 4 by itself takes 13 to 16 MB for a robot."""
AT_REST = keys("qvel act mpos mquat time")
"""What a keyframe says beyond a pose at rest."""
SENSOR = keys("name cutoff noise objtype objname reftype refname")


def read_sections(links: Links, drives: Drives) -> Control:
    """Read them in the order in which MJCF has them; the joints of the links get their mimics."""
    source = links.source
    timestep = float(source.model.opt.timestep)
    if not LEAST_STEP_S <= timestep <= 1.0:
        at = source.root.find("option[@timestep]")
        raise error_at(
            source.root if at is None else at,
            f"a timestep of {timestep:g} s simulates nothing",
            "robots take 0.0005 to 0.01 s",
        )
    gravity = _gravity(source.model)
    links.mjcf_only.append(_options(source.root, source.model))
    if int(source.model.narena) > USUAL_ARENA and source.root.find("size[@memory]") is not None:
        links.keep("size", "size", {"memory": str(int(source.model.narena))})
    excludes = set(_excludes(links))
    loops = tuple(_loops(links))
    _read_tendons(links)
    sensors = tuple(_sensors(links, {name: joint for name, joint in drives.names if joint}))
    keyframes = tuple(_keyframe(links, key) for key in source.root.iterfind("keyframe/key"))
    links.findings += _not_read(source.root)
    return Control(
        keyframes=keyframes,
        excludes=tuple(sorted(excludes)),
        simulation=Simulation.model_construct(timestep=timestep, gravity=gravity),
        sensors=sensors,
        loops=loops,
    )


def _elements(links: Links, section: str) -> Iterator[tuple[Element, str, dict[str, str]]]:
    """Yield (element, name, attributes) of a section; a site may have another name here."""
    for element in links.source.root.iterfind(f"{section}/*"):
        stated = links.renamed(links.source.classes.attributes(element))
        yield element, str(element.get("name")), stated


def _keep(links: Links, section: str, element: Element, stated: Mapping[str, str]) -> None:
    """Leave an element to MJCF, with its children."""
    children = ((str(c.tag), links.renamed(own_attributes(c))) for c in element)
    named = {"name": str(element.get("name"))} if element.get("name") else {}
    text = element_text(str(element.tag), named | dict(sorted(stated.items())), children)
    links.mjcf_only.append(MjcfOnly(section, text))


def _excludes(links: Links) -> Iterator[tuple[str, str]]:
    """Yield the excludes between bodies of the robot, and leave all other contacts to MJCF."""
    for element, _, stated in _elements(links, "contact"):
        if element.tag == "exclude" and WORLD not in (stated["body1"], stated["body2"]):
            a, b = sorted((stated["body1"], stated["body2"]))
            yield a, b
        else:
            _keep(links, "contact", element, stated)


# --- equalities and tendons -------------------------------------------------------------------


def _loops(links: Links) -> Iterator[Loop]:
    """Yield the loops, make coupled joints mimics, and leave all other equalities to MJCF."""
    model = links.source.model
    for element, name, stated in _elements(links, "equality"):
        index = links.source.id_of("equality", name)
        softness = (*model.eq_solref[index], *model.eq_solimp[index])
        is_near = all(abs(float(value)) <= FAR for value in model.eq_data[index])
        if not is_near or not all(map(math.isfinite, softness)):
            message = f"<{element.tag}> `{name}` has a number that is not finite"
            raise error_at(element, f"{message}, or above {FAR:g}", "correct the number")
        if element.tag in ("joint", "tendon") and _mimic(links, element, index, stated):
            continue
        if element.tag in ("connect", "weld") and (loop := _loop(links, element, index, stated)):
            yield loop
            continue
        if element.tag == "connect" and "anchor" in stated:
            x, y, z = (float(word) for word in stated["anchor"].split())
            stated["anchor"] = words(links.in_link(stated["body1"], Pose((x, y, z))).xyz)
        if element.tag == "weld":
            _restate_weld(links, index, stated)
        _keep(links, "equality", element, stated)


def _mimic(links: Links, element: Element, index: int, stated: Mapping[str, str]) -> bool:
    """Make the follower of a linear coupling a mimic; return False of any other equality."""
    name, mimic = _coupling(element, links.source.model, index, stated)
    by_name = {joint.name: joint for joint in links.joints}
    if mimic is None or not {name, mimic.joint} <= by_name.keys() or by_name[name].mimic:
        return False
    above: Mimic | None = mimic
    while above is not None:
        if above.joint == name:  # a circle
            return False
        above = by_name[above.joint].mimic
    by_name[name] = replace(by_name[name], mimic=mimic)
    links.joints = list(by_name.values())
    more = leftover(stated, keys("joint1 joint2 tendon1 tendon2 polycoef active"))
    more["name"] = str(element.get("name"))
    links.mjcf_only.append(MjcfOnly("mimic", element_text("joint", more), name))
    return True


def _coupling(
    element: Element, model: Model, index: int, stated: Mapping[str, str]
) -> tuple[str, Mimic | None]:
    """Return (follower, mimic) of an equality; no mimic where it is no linear coupling.

    q1 = c0 + c1 q2, counted from the joints' `ref`, as the Robot counts.
    """
    if element.tag == "tendon" and (coupling := tendon_coupling(model, index)):
        follower, leader = (str(model.joint(joint).name) for joint in coupling[:2])
        return follower, Mimic(leader, *coupling[2:])
    c0, c1, *more = (float(value) for value in model.eq_data[index][:5])
    leader = stated.get("joint2", "")
    if element.tag != "joint" or not leader or any(more) or not c1 or not model.eq_active0[index]:
        return "", None
    return stated.get("joint1", ""), Mimic(leader, c1, c0)


def _loop(links: Links, element: Element, index: int, stated: Mapping[str, str]) -> Loop | None:
    """Return the loop that holds two bodies; None where it is switched off or a tether."""
    model, name = links.source.model, str(element.get("name"))
    if not bool(model.eq_active0[index]) or leftover(stated, LOOP_WORDS):
        return None
    a, b = (_loop_end(links, index, side) for side in (0, 1))
    if a is None or b is None:
        message = f"<{element.tag}> `{name}` holds the floating robot to the world "
        message += f"({where_of(element)}): in the MJCF only, every other format lets it go"
        links.findings.append(TETHER("robot", message, data={"name": name}))
        return None
    solref, solimp = (tuple(map(float, row[index])) for row in (model.eq_solref, model.eq_solimp))
    if element.tag == "connect":
        return Loop(name, "connect", a, b, solref, solimp)
    return Loop(name, "weld", a, b, solref, solimp, float(model.eq_data[index][10]))


def _loop_end(links: Links, index: int, side: int) -> LoopEnd | None:
    """What MuJoCo holds: a site, or a point or frame of a body; None in a floating one's world.

    Of a weld the first body carries the relative pose, the second the anchor.
    """
    model = links.source.model
    at = int((model.eq_obj1id, model.eq_obj2id)[side][index])
    data, turn, body = model.eq_data[index], IDENTITY.quat, at
    if int(model.eq_objtype[index]) == mj.mjtObj.mjOBJ_SITE:
        X, body = pose_at(model.site_pos[at], model.site_quat[at]), int(model.site_bodyid[at])
    elif int(model.eq_type[index]) == mj.mjtEq.mjEQ_WELD:
        X = pose_at(data[:3], turn) if side else pose_at(data[3:6], data[6:10])
    else:
        X = pose_at(data[3 * side : 3 * side + 3], turn)
    name = str(model.body(body).name)
    if body == 0 and WORLD not in links.shift:
        if links.base == "floating":
            return None
        return LoopEnd(links.root, links.mount.inverse() @ X)
    return LoopEnd(name, links.in_link(name, X))


def _restate_weld(links: Links, index: int, stated: dict[str, str]) -> None:
    """State the relative pose of bodies whose frames have moved, as compiled."""
    one, two = (Pose(links.shift.get(stated.get(f"body{n}", ""), ORIGIN)) for n in (1, 2))
    if (one, two) != (IDENTITY, IDENTITY):
        data = links.source.model.eq_data[index]
        X = one.inverse() @ pose_at(data[3:6], data[6:10]) @ two
        stated["relpose"] = words((*X.xyz, *X.quat))
        stated["anchor"] = words(two.inverse().apply(data[:3]))


def _read_tendons(links: Links) -> None:
    """Leave tendons to MJCF, without material, their length from the `ref` of their joints."""
    model = links.source.model
    for element, name, stated in _elements(links, "tendon"):
        index, subject = links.source.id_of("tendon", name), f"tendon {name}"
        moved = [
            child for child in element.iterchildren("joint") if child.get("joint") in links.rest
        ]
        rest = sum(float(str(c.get("coef"))) * links.rest[str(c.get("joint"))] for c in moved)
        if rest:
            message = f"its length counts from the `ref` of its joints: 0 here is {rest:g}"
            hint = "subtract it from lengths of the source's controllers"
            links.findings.append(JOINT_REF(subject, message, hint, data={"ref": rest}))
            ends = {"range": model.tendon_range, "springlength": model.tendon_lengthspring}
            for key, values in ends.items():
                if key in stated or (key == "springlength" and "stiffness" in stated):
                    stated[key] = words(float(v) - rest for v in values[index])
        if stated.pop("material", None):
            message = f"the material of {subject} was left out ({where_of(element)})"
            lost = dropped("tendon material", subject, message, "give the tendon an `rgba`")
            links.findings.append(lost)
        if element.tag == "fixed":  # a class of tendons may say how the spatial ones are drawn
            stated.pop("width", None)
            stated.pop("rgba", None)
        _keep(links, "tendon", element, stated)


# --- sensors and keyframes --------------------------------------------------------------------


def _sensors(links: Links, driven: Mapping[str, str]) -> Iterator[Sensor]:
    """Yield those that the Robot has words for, and leave the others to MJCF."""
    kept, moved = False, list[str]()
    for element, name, stated in _elements(links, "sensor"):
        sensor = _sensor(element, stated, driven)
        if sensor is None:
            _keep(links, "sensor", element, stated)
            kept = True
            continue
        yield sensor
        moved += [name] * kept
    if moved:
        message = f"sensors from `{moved[0]}` on stand before those that only MJCF "
        message += "has: their places in `sensordata` differ from the source's"
        links.findings.append(ORDER("robot", message, "ask for sensors by name"))


def _sensor(
    element: Element, stated: Mapping[str, str], driven: Mapping[str, str]
) -> Sensor | None:
    """Return the sensor in the Robot's words; None when they do not say all of it.

    driven: joint that an actuator drives in the Robot, by the actuator's name.
    """
    targets = [key for key in stated if key in _PLACES and key not in ("xbody",)]
    extra = set(stated) - SENSOR - set(targets)
    if extra or len(targets) + ("objname" in stated) != 1 or element.tag in ("contact", "user"):
        return None
    if targets == ["actuator"]:
        joint = driven.get(stated["actuator"], "")
        if not joint:
            return None
        at = Place("actuator", joint)
    elif targets:
        at = Place(_PLACES[targets[0]], stated[targets[0]])
    else:
        at = _place(stated["objtype"], stated["objname"])
    relative = _place(stated["reftype"], stated["refname"]) if "refname" in stated else None
    cutoff, noise = float(stated.get("cutoff", 0.0)), float(stated.get("noise", 0.0))
    return Sensor(str(element.get("name")), str(element.tag), at, relative, cutoff, noise)


def _keyframe(links: Links, element: Element) -> Keyframe:
    """Return the pose at rest that a <key> states."""
    name, model = str(element.get("name")), links.source.model
    qpos = [float(v) for v in model.key_qpos[links.source.id_of("key", name)]]
    base = links.mount if links.base == "floating" else None
    if base is not None and FREE in links.source.joint_kinds(links.root):
        base = pose_at(qpos[:3], qpos[3:7])
    values, turns = [], []
    for joint in [joint for joint in links.joints if joint.kind != "fixed"]:
        address = int(model.jnt_qposadr[links.source.id_of("joint", joint.name)])
        if joint.kind != "ball":
            values.append((joint.name, qpos[address] - links.rest.get(joint.name, 0.0)))
        elif (turn := pose_at(ORIGIN, qpos[address : address + 4]).quat) != IDENTITY.quat:
            turns.append((joint.name, turn))
    if lost := tuple(sorted(AT_REST & set(element.attrib))):
        names = ", ".join(f"`{key}`" for key in lost)
        message = f"{names} of keyframe `{name}` was left out: a keyframe of a robot is a pose "
        message += "at rest"
        links.findings.append(dropped("key", f"keyframe {name}", message, attributes=lost))
    return Keyframe(name, tuple(values), base, tuple(turns))


def _place(kind: str, name: str) -> Place:
    if name == WORLD and kind in ("body", "xbody"):
        return Place("world")
    return Place(_PLACES[kind], name)


def _gravity(model: Model) -> Vec3:
    """m/s²; a source that switches gravity off has none, in every format and under its name."""
    off = int(model.opt.disableflags) & int(mj.mjtDisableBit.mjDSBL_GRAVITY)
    return (0.0, 0.0, 0.0) if off else vec3(model.opt.gravity)


def _options(root: Element, model: Model) -> MjcfOnly:
    """`<option>` as the source compiles: what it leaves to MuJoCo's defaults is said too.

    Without the flag `gravity`: see `_gravity`.
    """
    stated: dict[str, str] = {}
    flags: dict[str, str] = {}
    for option in root.iterchildren("option"):
        stated |= leftover(own_attributes(option), keys("timestep gravity"))
        for flag in option.iterchildren("flag"):
            flags |= leftover(own_attributes(flag), keys("gravity"))
    integrators = ("Euler", "RK4", "implicit", "implicitfast")
    number = int(model.opt.integrator)
    if number < len(integrators):
        stated.setdefault("integrator", integrators[number])
    stated.setdefault("cone", ("pyramidal", "elliptic")[int(model.opt.cone)])
    stated.setdefault("impratio", words((model.opt.impratio,)))
    stated.setdefault("tolerance", words((model.opt.tolerance,)))
    children = [("flag", dict(sorted(flags.items())))] if flags else ()
    return MjcfOnly("option", element_text("option", dict(sorted(stated.items())), children))


def _not_read(root: Element) -> Iterator[Finding]:
    for tag in NOT_READ:
        elements = root.findall(tag)
        if elements:
            severity: Severity = "info" if tag in ("visual", "statistic", "size") else "warning"
            message = f"<{tag}> was left out ({where_of(elements[0])})"
            hint = "it says nothing about the robot itself"
            yield dropped(tag, "robot", message, hint, severity, count=len(elements))
