"""Equalities, tendons, sensors, contact pairs, keyframes and options of an MJCF."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Literal

from assetbuild.findings import Data, Finding, Rule, Severity
from assetbuild.robot.loops import FAR
from assetbuild.robot.model import (
    Joint,
    Keyframe,
    Loop,
    LoopEnd,
    MjcfOnly,
    Place,
    Sensor,
    Simulation,
)
from assetbuild.robot.pose import IDENTITY, Pose, Vec3, vec3
from assetbuild.simulators.mujoco import LEAST_STEP_S
from assetbuild.source.mjcf.compiled import Model, pose_at
from assetbuild.source.mjcf.drives import Drives
from assetbuild.source.mjcf.links import FREE, JOINT_REF, Links, coupled, coupling_of, tendon_rest
from assetbuild.source.mjcf.opaque import element_text, keys, leftover, words
from assetbuild.source.mjcf.scenery import kind_of
from assetbuild.source.mjcf.text import WORLD, dropped, error_at, own_attributes, where_of

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
ORIGIN: Vec3 = (0.0, 0.0, 0.0)
LOOP_WORDS = keys(
    "name class body1 body2 site1 site2 anchor relpose solref solimp torquescale active"
)
"""Attributes of a `connect` or `weld` that a loop of the robot holds."""
USUAL_ARENA = 2**24
"""Bytes: MuJoCo 4 by itself takes 13 to 16 MB for a robot."""
AT_REST = keys("qvel act mpos mquat time")
"""What a keyframe says beyond a pose at rest."""
SENSOR = keys("name cutoff noise objtype objname reftype refname")


def read_sections(links: Links, drives: Drives) -> Sections:
    """In the order in which MJCF has them."""
    source = links.source
    sections = Sections(links, {name: joint for name, joint in drives.names if joint})
    timestep = float(source.model.opt.timestep)
    if not LEAST_STEP_S <= timestep <= 1.0:
        at = source.root.find("option[@timestep]")
        raise error_at(
            source.root if at is None else at,
            f"a timestep of {timestep:g} s simulates nothing",
            "robots take 0.0005 to 0.01 s",
        )
    sections.simulation = Simulation.model_construct(
        timestep=timestep, gravity=_gravity(source.model)
    )
    sections.mjcf_only.append(_options(source.root, source.model))
    if int(source.model.narena) > USUAL_ARENA and source.root.find("size[@memory]") is not None:
        memory = {"memory": str(int(source.model.narena))}
        sections.mjcf_only.append(MjcfOnly("size", element_text("size", memory)))
    for section, read in (
        ("contact", sections.contact),
        ("equality", sections.equality),
        ("tendon", sections.tendon),
        ("sensor", sections.sensor),
    ):
        for element in source.root.iterfind(f"{section}/*"):
            read(element, sections.translated(source.classes.attributes(element)))
    for element in source.root.iterfind("keyframe/key"):
        sections.keyframe(element)
    sections.findings += _not_read(source.root)
    return sections


class Sections:
    """What stands after the bodies; takes elements whose attributes name things of the Robot.

    driven: joint that an actuator drives in the Robot, by the actuator's name.
    joints: those of the robot, with their mimics.
    """

    simulation: Simulation

    def __init__(self, links: Links, driven: Mapping[str, str]) -> None:
        self.links, self.driven, self.model = links, driven, links.source.model
        self.joints: list[Joint] = list(links.joints)
        self.sensors: list[Sensor] = []
        self.keyframes: list[Keyframe] = []
        self.ctrl: list[tuple[str, tuple[tuple[str, float], ...]]] = []
        self.excludes: list[tuple[str, str]] = []
        self.mjcf_only: list[MjcfOnly] = []
        self.loops: list[Loop] = []
        self.findings: list[Finding] = []

    def translated(self, stated: Mapping[str, str]) -> dict[str, str]:
        """Attributes with names of the Robot: a site may have another there."""
        sites = self.links.sites
        return {
            k: sites.get(v, v) if kind_of(k, stated) == "site" else v for k, v in stated.items()
        }

    def _keep(self, place: str, element: _Element, stated: Mapping[str, str]) -> None:
        """Leave it to MJCF, with its children."""
        children = ((str(c.tag), self.translated(own_attributes(c))) for c in element)
        named = {"name": str(element.get("name"))} if element.get("name") else {}
        text = element_text(str(element.tag), named | dict(sorted(stated.items())), children)
        self.mjcf_only.append(MjcfOnly(place, text))

    def contact(self, element: _Element, stated: Mapping[str, str]) -> None:
        """A pair, or an exclude between bodies of the robot."""
        if element.tag == "exclude" and WORLD not in (stated["body1"], stated["body2"]):
            a, b = sorted((stated["body1"], stated["body2"]))
            self.excludes.append((a, b))
        else:
            self._keep("contact", element, stated)

    # --- equalities and tendons ---------------------------------------------------------------

    def equality(self, element: _Element, stated: dict[str, str]) -> None:
        """A coupled joint may be a mimic, and two bodies a loop; frames may have moved."""
        index = self.links.source.id_of("equality", str(element.get("name")))
        softness = (*self.model.eq_solref[index], *self.model.eq_solimp[index])
        is_near = all(abs(float(value)) <= FAR for value in self.model.eq_data[index])
        if not is_near or not all(map(math.isfinite, softness)):
            message = f"<{element.tag}> `{element.get('name')}` has a number that is not finite"
            raise error_at(element, f"{message}, or above {FAR:g}", "correct the number")
        if element.tag in ("joint", "tendon") and self._mimic(element, stated):
            return
        if element.tag in ("connect", "weld") and self._loop(element, stated):
            return
        if element.tag == "connect" and "anchor" in stated:
            x, y, z = (float(word) for word in stated["anchor"].split())
            stated["anchor"] = words(self.links.in_link(stated["body1"], Pose((x, y, z))).xyz)
        if element.tag == "weld":
            self._weld(element, stated)
        self._keep("equality", element, stated)

    def _mimic(self, element: _Element, stated: Mapping[str, str]) -> bool:
        """A linear coupling of two joints; its words that are no mimic's stay with it."""
        index = self.links.source.id_of("equality", str(element.get("name")))
        coupling = coupling_of(str(element.tag), self.model, index, stated)
        joints = coupling and coupled(self.joints, *coupling)
        if not coupling or not joints:
            return False
        self.joints = joints
        more = leftover(stated, keys("joint1 joint2 tendon1 tendon2 polycoef active"))
        more["name"] = str(element.get("name"))
        self.mjcf_only.append(MjcfOnly("mimic", element_text("joint", more), coupling[0]))
        return True

    def _loop(self, element: _Element, stated: Mapping[str, str]) -> bool:
        """Two bodies that are held together; False of one that is switched off, and of a tether."""
        links, model, name = self.links, self.model, str(element.get("name"))
        index = links.source.id_of("equality", name)
        if not bool(model.eq_active0[index]) or leftover(stated, LOOP_WORDS):
            return False
        ends = [self._loop_end(index, side) for side in (0, 1)]
        if None in ends:
            message = f"<{element.tag}> `{name}` holds the floating robot to the world "
            message += f"({where_of(element)}): in the MJCF only, every other format lets it go"
            self.findings.append(TETHER("robot", message, data={"name": name}))
            return False
        a, b = (end for end in ends if end is not None)
        data = model.eq_data[index]
        kind: Literal["connect", "weld"] = "weld" if element.tag == "weld" else "connect"
        self.loops.append(
            Loop(
                name,
                kind,
                a,
                b,
                tuple(float(v) for v in model.eq_solref[index]),
                tuple(float(v) for v in model.eq_solimp[index]),
                float(data[10]) if kind == "weld" else 1.0,
            )
        )
        return True

    def _loop_end(self, index: int, side: int) -> LoopEnd | None:
        """What MuJoCo holds: a site, or a point or frame of a body; None in a floating one's world.

        Of a weld the first body carries the relative pose, the second the anchor.
        """
        import mujoco

        links, model = self.links, self.model
        at = int((model.eq_obj1id, model.eq_obj2id)[side][index])
        data, turn = model.eq_data[index], (1.0, 0.0, 0.0, 0.0)
        if int(model.eq_objtype[index]) == mujoco.mjtObj.mjOBJ_SITE:
            X, body = pose_at(model.site_pos[at], model.site_quat[at]), int(model.site_bodyid[at])
        elif int(model.eq_type[index]) == mujoco.mjtEq.mjEQ_WELD:
            place, turn = (data[:3], turn) if side else (data[3:6], data[6:10])
            X, body = pose_at(place, turn), at
        else:
            X, body = pose_at(data[3 * side : 3 * side + 3], turn), at
        name = str(model.body(body).name)
        if body == 0 and WORLD not in links.shift:
            if links.base == "floating":
                return None
            return LoopEnd(links.root, links.mount.inverse() @ X)
        return LoopEnd(name, links.in_link(name, X))

    def _weld(self, element: _Element, stated: dict[str, str]) -> None:
        """State the relative pose of bodies whose frames have moved, as compiled."""
        shifts = [self.links.shift.get(stated.get(f"body{side}", ""), ORIGIN) for side in (1, 2)]
        if not any(map(any, shifts)):
            return
        index = self.links.source.id_of("equality", str(element.get("name")))
        data = self.model.eq_data[index]
        one, two = (Pose(shift) for shift in shifts)
        X = one.inverse() @ pose_at(data[3:6], data[6:10]) @ two
        stated["relpose"] = words((*X.xyz, *X.quat))
        stated["anchor"] = words(two.inverse().apply(data[:3]))

    def tendon(self, element: _Element, stated: dict[str, str]) -> None:
        """As it is, without its material; its length counts from the `ref` of its joints."""
        index = self.links.source.id_of("tendon", str(element.get("name")))
        if rest := tendon_rest(element, self.links.rest):
            message = f"its length counts from the `ref` of its joints: 0 here is {rest:g}"
            hint = "subtract it from lengths of the source's controllers"
            data: Data = {"ref": rest}
            finding = JOINT_REF(f"tendon {element.get('name')}", message, hint, data=data)
            self.findings.append(finding)
            ends = {
                "range": self.model.tendon_range,
                "springlength": self.model.tendon_lengthspring,
            }
            for key, values in ends.items():
                if key in stated or (key == "springlength" and "stiffness" in stated):
                    stated[key] = words(float(v) - rest for v in values[index])
        if stated.pop("material", None):
            name = f"tendon {element.get('name')}"
            message = f"the material of {name} was left out ({where_of(element)})"
            lost = dropped("tendon material", name, message, "give the tendon an `rgba`")
            self.findings.append(lost)
        if element.tag == "fixed":  # a class of tendons may say how the spatial ones are drawn
            stated.pop("width", None)
            stated.pop("rgba", None)
        self._keep("tendon", element, stated)

    # --- sensors ------------------------------------------------------------------------------

    def sensor(self, element: _Element, stated: Mapping[str, str]) -> None:
        """One of the Robot's, or MjcfOnly."""
        sensor = self._as_sensor(element, stated)
        if sensor is None:
            self._keep("sensor", element, stated)
            return
        self.sensors.append(sensor)
        if self.mjcf_only and self.mjcf_only[-1].place == "sensor":
            message = f"sensors from `{element.get('name')}` on stand before those that only MJCF "
            message += "has: their places in `sensordata` differ from the source's"
            self.findings.append(ORDER("robot", message, "ask for sensors by name"))

    def _as_sensor(self, element: _Element, stated: Mapping[str, str]) -> Sensor | None:
        """The sensor in the Robot's words; None when they do not say all of it."""
        targets = [key for key in stated if key in _PLACES and key not in ("xbody",)]
        extra = set(stated) - SENSOR - set(targets)
        if extra or len(targets) + ("objname" in stated) != 1 or element.tag in ("contact", "user"):
            return None
        if targets == ["actuator"]:
            joint = self.driven.get(stated["actuator"], "")
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

    # --- keyframes ----------------------------------------------------------------------------

    def keyframe(self, element: _Element) -> None:
        """A pose at rest."""
        name, links, model = str(element.get("name")), self.links, self.model
        index = links.source.id_of("key", name)
        qpos = [float(v) for v in model.key_qpos[index]]
        base = links.mount if links.base == "floating" else None
        if base is not None and FREE in links.source.joint_kinds(links.root):
            base = pose_at(qpos[:3], qpos[3:7])
        values, turns = [], []
        for joint in links.joints:
            if joint.kind != "fixed":
                address = int(model.jnt_qposadr[links.source.id_of("joint", joint.name)])
            if joint.kind == "ball":
                turn = pose_at(ORIGIN, qpos[address : address + 4]).quat
                turns += [(joint.name, turn)] if turn != IDENTITY.quat else []
            elif joint.kind != "fixed":
                values.append((joint.name, qpos[address] - links.rest.get(joint.name, 0.0)))
        self.keyframes.append(Keyframe(name, tuple(values), base, tuple(turns)))
        if element.get("ctrl"):
            ctrl = enumerate(model.key_ctrl[index])
            commands = tuple((str(model.actuator(i).name), float(value)) for i, value in ctrl)
            self.ctrl.append((name, commands))
        lost = tuple(sorted(AT_REST & set(element.attrib)))
        if lost:
            names = ", ".join(f"`{key}`" for key in lost)
            message = f"{names} of keyframe `{name}` was left out: a keyframe of a robot is a pose "
            message += "at rest"
            self.findings.append(dropped("key", f"keyframe {name}", message, attributes=lost))


def _place(kind: str, name: str) -> Place:
    if name == WORLD and kind in ("body", "xbody"):
        return Place("world")
    return Place(_PLACES[kind], name)


def _gravity(model: Model) -> Vec3:
    """m/s²; a source that switches gravity off has none, in every format and under its name."""
    import mujoco

    off = int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    return (0.0, 0.0, 0.0) if off else vec3(model.opt.gravity)


def _options(root: _Element, model: Model) -> MjcfOnly:
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


def _not_read(root: _Element) -> Iterator[Finding]:
    for tag in NOT_READ:
        elements = root.findall(tag)
        if elements:
            severity: Severity = "info" if tag in ("visual", "statistic", "size") else "warning"
            message = f"<{tag}> was left out ({where_of(elements[0])})"
            hint = "it says nothing about the robot itself"
            yield dropped(tag, "robot", message, hint, severity, count=len(elements))
