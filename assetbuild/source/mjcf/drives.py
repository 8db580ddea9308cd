"""Actuators of a compiled MJCF: the Robot's own where it has the words, else left as they are."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from assetbuild.robot.mjcf_only import words
from assetbuild.robot.model import MOVING, Actuator, ActuatorModel, General, MjcfOnly
from assetbuild.simulators.mujoco import Model, actuators, mj
from assetbuild.simulators.mujoco.drives import read_drive
from assetbuild.source.mjcf.links import Links
from assetbuild.source.mjcf.opaque import element_text
from assetbuild.source.mjcf.scenery import kind_of
from assetbuild.source.mjcf.text import Element, dropped, error_at, own_attributes, where_of

KINDS = {
    "dyn": ("none", "integrator", "filter", "filterexact", "muscle", "user"),
    "gain": ("fixed", "affine", "muscle", "user"),
    "bias": ("none", "affine", "muscle", "user"),
}
"""MuJoCo's words for `dyntype`, `gaintype` and `biastype` of a law that a <general> can state."""
ALONE = frozenset({"muscle", "user"})
"""Kinds that MJCF alone has the words for."""
Law = dict[str, tuple[str, tuple[float, ...]]]
"""(MuJoCo's word, parameters) of each part of an actuator's law."""
STEADY = frozenset({"none", "filter", "filterexact"})
"""Kinds of `dyntype` whose state becomes the command."""
STRAIGHT = (0, 1)
"""Transmissions to a joint, which are the same for a hinge and a slide: MuJoCo's `joint` and
`jointinparent`."""


@dataclass
class Drives:
    """actuators: one for each moving joint, in the order of the joints.

    names: of the actuators, in the order of the source, with the joint that the Robot drives or "".
    resting: (actuator, command that leaves the robot alone at zero) of those that drive no joint.
    """

    actuators: list[Actuator] = field(default_factory=list)
    mjcf_only: list[MjcfOnly] = field(default_factory=list)
    names: list[tuple[str, str]] = field(default_factory=list)
    resting: list[tuple[str, float]] = field(default_factory=list)


def read_drives(links: Links) -> Drives:
    """Every actuator of the source; joints without one are passive."""
    drives, model = Drives(), links.source.model
    driven: dict[str, Actuator] = {}
    moving = {joint.name: joint for joint in links.joints if joint.kind in MOVING}
    levers = [read_drive(model, index) for index in actuators(model)]
    joints = [lever.joint_name if lever else "" for lever in levers]
    for element in links.source.root.iterfind("actuator/*"):
        name = str(element.get("name"))
        index = links.source.id_of("actuator", name)
        if element.get("user"):
            message = f"`user` of actuator `{name}` was left out ({where_of(element)})"
            hint = "it says nothing about the robot itself"
            lost = dropped("actuator", f"actuator {name}", message, hint, attributes=("user",))
            links.findings.append(lost)
        joint, lever = joints[index], levers[index]
        taken = _taken(model, index) if joint in moving and joints.count(joint) == 1 else None
        alone = int(model.actuator_trntype[index]) not in STRAIGHT
        if taken is not None and lever is not None:
            scaled = None if joint in links.rest else _scaled(taken)
            alone = alone or scaled is not None
            taken = _at_rest(_geared(scaled or taken, lever.gear), links.rest.get(joint, 0.0))
            driven[joint] = replace(taken, joint=joint, name=name)
        if taken is None or alone:
            owner = joint if taken else ""
            drives.mjcf_only.append(MjcfOnly("actuator", _whole(element, links, index), owner))
            drives.names.append((name, ""))
            if not owner:
                drives.resting.append((name, _resting(model, index)))
            continue
        drives.names.append((name, joint))
        endless, more = moving[joint].kind == "continuous", list[tuple[str, dict[str, str]]]()
        if model.actuator_actearly[index]:
            more.append(("general", {"actearly": "true"}))
        if group := int(model.actuator_group[index]):
            more.append(("general", {"group": str(group)}))
        if taken.model == "pd" and taken.ctrl is None and not endless:
            # It may be sent beyond the joint's range, where a target would clip it.
            more.append(("position", {"inheritrange": "0"}))
        drives.mjcf_only += [MjcfOnly("drive", element_text(*one), joint) for one in more]
    for name, moved in moving.items():
        actuator = driven.get(name, Actuator(name, "passive"))
        clamp = _range(model, "jnt_actfrc", int(model.joint(name).id))
        limited, words_of_its_own = _clamped(actuator, clamp)
        drives.actuators.append(
            replace(
                limited,
                damping=moved.damping or 0.0,
                friction=moved.friction or 0.0,
                armature=float(model.joint(name).armature[0]),
                source="the source's MJCF" if actuator.model != "passive" else "",
            )
        )
        if words_of_its_own:
            text = element_text("general", words_of_its_own)
            drives.mjcf_only.append(MjcfOnly("drive", text, name))
    return drives


def _clamped(
    actuator: Actuator, clamp: tuple[float, float] | None
) -> tuple[Actuator, dict[str, str]]:
    """(with the effort limit that the joint's `actuatorfrcrange` leaves, its own limit in MJCF).

    MuJoCo clips the force of the drive to its own range, and the sum on the joint to the joint's.
    """
    most = max(-clamp[0], clamp[1]) if clamp else math.inf
    effort = actuator.effort
    if most == math.inf or (effort is not None and effort <= most):
        return actuator, {}
    limited = replace(actuator, effort=most)
    if actuator.model == "passive":
        return limited, {}
    word = "ctrl" if actuator.model == "motor" and actuator.ctrl is None else "force"
    if effort is None or actuator.model == "motor":
        # Taken away from the element, and switched off where its class says it.
        return limited, {f"{word}range": "", f"{word}limited": "false"}
    effort /= abs(actuator.gear)
    return limited, {"forcerange": words((-effort, effort))}


def _taken(model: Model, index: int) -> Actuator | None:
    """The actuator in the Robot's words; None when they do not say all of it."""
    gear = [float(v) for v in model.actuator_gear[index]]
    plain = gear[0] != 0.0 and not any(gear[1:])
    plain = plain and not int(model.actuator_actlimited[index]) and not _extended(model, index)
    if not plain or int(model.actuator_plugin[index]) >= 0:
        return None
    force = _range(model, "actuator_force", index)
    if force is not None and force[0] != -force[1]:
        return None
    law = _law(model, index)
    if any(kind in ALONE or kind not in KINDS[part] for part, (kind, _) in law.items()):
        return None
    effort = force[1] if force else None
    ctrl = _range(model, "actuator_ctrl", index)
    (dyntype, _), (gaintype, gain), (biastype, bias) = law.values()
    kp, kd = gain[0], 0.0 - bias[2]
    if (dyntype, gaintype) == ("none", "fixed") and not any(gain[1:]):
        if (
            biastype == "none"
            and kp == 1.0
            and effort is None
            and (not ctrl or ctrl[0] == -ctrl[1])
        ):
            return Actuator("", "motor", effort=ctrl[1] if ctrl else None, ctrl=ctrl)
        if biastype == "affine" and kp > 0.0 and not any(bias[3:]):
            if bias[:2] == (0.0, -kp) and kd >= 0.0:
                return Actuator("", "pd", kp=kp, kd=kd, effort=effort, ctrl=ctrl)
            if bias[:3] == (0.0, 0.0, -kp):
                return Actuator("", "velocity", kd=kp, effort=effort, ctrl=ctrl)
    attributes: dict[str, Any] = {}  # Any: the tables' words are those of the model
    for part, (kind, prm) in law.items():
        attributes |= {f"{part}type": kind, f"{part}prm": _trimmed(prm)}
    general = General.model_construct(**attributes)
    return Actuator("", "general", effort=effort, ctrl=ctrl, general=general)


def _scaled(actuator: Actuator) -> Actuator | None:
    """The drive behind a general law gain u + b0 - kp l - kd v, whose command u is no position.

    The law is kp (target - l) - kd v with target = (gain u + b0) / kp; grippers have it, whose
    command is 0 to 255. Without kp it is a speed: kd (target - v) with target = gain u / kd.
    """
    law = actuator.general
    if law is None or (law.dyntype, law.gaintype, law.biastype) != ("none", "fixed", "affine"):
        return None
    gain, (b0, b1, b2, *more) = law.gainprm[0], (*law.biasprm, 0.0, 0.0, 0.0)
    kp, kd = 0.0 - b1, 0.0 - b2
    if any(law.gainprm[1:]) or any(more) or gain <= 0.0 or min(kp, kd) < 0.0:
        return None
    if not (kp or (kd and not b0)):
        return None
    ends = [(gain * end + b0) / (kp or kd) for end in actuator.ctrl or ()]
    model: ActuatorModel = "pd" if kp else "velocity"
    ctrl = (ends[0], ends[1]) if ends else None
    return replace(actuator, model=model, kp=kp, kd=kd, ctrl=ctrl, general=None)


def _geared(actuator: Actuator, gear: float) -> Actuator:
    """The numbers of an actuator on its joint.

    MuJoCo's length is gear q and its force pulls with gear f: a stiffness counts gear^2 times, a
    limit of the force |gear| times. A command is a position or a speed of the actuator, or a force.
    """
    geared = replace(
        actuator,
        gear=gear,
        kp=actuator.kp * gear * gear,
        kd=actuator.kd * gear * gear,
        effort=None if actuator.effort is None else actuator.effort * abs(gear),
    )
    if actuator.ctrl is not None:
        low, high = sorted(end / geared.command_gear for end in actuator.ctrl)
        geared = replace(geared, ctrl=(low, high))
    return geared


def _at_rest(actuator: Actuator, ref: float) -> Actuator:
    """The same drive where positions count from `ref` of the joint.

    A position drive pulls with kp (ctrl - q - ref): its commands count from `ref` too. In general
    gain and bias are affine in the position: g0 + g1 (q + ref).
    """
    if not ref or actuator.model in ("motor", "velocity"):
        return actuator
    if actuator.model == "pd":
        ctrl = actuator.ctrl
        return replace(actuator, ctrl=(ctrl[0] - ref, ctrl[1] - ref) if ctrl else None)
    assert actuator.general is not None  # noqa: S101 # `_taken` made it
    general, ref = actuator.general, actuator.gear * ref
    if general.gaintype == "affine":
        general = general.model_copy(update={"gainprm": _moved(general.gainprm, ref)})
    if general.biastype == "affine":
        general = general.model_copy(update={"biasprm": _moved(general.biasprm, ref)})
    return replace(actuator, general=general)


def _moved(prm: tuple[float, ...], ref: float) -> tuple[float, ...]:
    """15 digits, as an MJCF states them: parameters are compared as text."""
    return (float(f"{prm[0] + prm[1] * ref:.15g}"), *prm[1:]) if len(prm) > 1 else prm


def _whole(element: Element, links: Links, index: int) -> str:
    """The actuator as `<general>` with all its compiled numbers, or as stated where it is more."""
    model = links.source.model
    law = _law(model, index)
    if int(model.actuator_plugin[index]) >= 0:
        hint = "use one of MuJoCo's own kinds"
        raise error_at(element, f"actuator `{element.get('name')}` of a plug-in", hint)
    known = all(kind in KINDS[part] for part, (kind, _) in law.items())
    beyond = not known or _extended(model, index)
    named = {k: v for k, v in links.renamed(own_attributes(element)).items() if kind_of(k, {})}
    attributes = {"name": str(element.get("name")), **named}
    over = {attributes.get("joint") or attributes.get("jointinparent")}
    tendons = links.source.root.iterfind("tendon/fixed")
    over |= {
        j.get("joint") for t in tendons if t.get("name") == attributes.get("tendon") for j in t
    }
    moves_force = any(  # with the position of the joint
        kind == "muscle" or (part != "dyn" and kind == "affine" and prm[1] != 0.0)
        for part, (kind, prm) in law.items()
    )
    if over & links.rest.keys() and (beyond or moves_force):
        hint = "give the joint no `ref`, and move its range and body instead"
        raise error_at(element, f"actuator `{attributes['name']}` on a joint with `ref`", hint)
    if beyond:
        stated = links.source.classes.attributes(element)  # in the source's own words
        plain = {key: value for key, value in stated.items() if key != "user"}
        return element_text(str(element.tag), plain | attributes)
    attributes |= {f"{part}type": kind for part, (kind, _) in law.items()}
    attributes |= {f"{part}prm": words(_trimmed(prm)) for part, (_, prm) in law.items()}
    attributes["gear"] = words(model.actuator_gear[index])
    if element.get("cranksite"):
        attributes["cranklength"] = words((model.actuator_cranklength[index],))
    if attributes["gaintype"] == "muscle":
        attributes["lengthrange"] = words(model.actuator_lengthrange[index])
    if int(model.actuator_group[index]):
        attributes["group"] = str(int(model.actuator_group[index]))
    for kind in ("ctrl", "force", "act"):
        limits = _range(model, f"actuator_{kind}", index)
        attributes[f"{kind}limited"] = "true" if limits else "false"
        if limits:
            attributes[f"{kind}range"] = words(limits)
    if model.actuator_actearly[index]:
        attributes["actearly"] = "true"
    return element_text("general", attributes)


def _resting(model: Model, index: int) -> float:
    """The command of an actuator, within its range, that pulls with no force at the zero pose."""
    (dyntype, _), (gaintype, gain), (biastype, bias) = _law(model, index).values()
    command = 0.0
    if gaintype == "fixed" and biastype == "affine" and dyntype in STEADY and gain[0]:
        command = 0.0 - (bias[0] + bias[1] * float(model.actuator_length0[index])) / gain[0]
    limits = _range(model, "actuator_ctrl", index)
    return min(max(command, limits[0]), limits[1]) if limits else command


def _law(model: Model, index: int) -> Law:
    """Return what makes the force of an actuator: `dyn`, `gain` and `bias`."""
    law: Law = {}
    for part, enum in (("dyn", mj.mjtDyn), ("gain", mj.mjtGain), ("bias", mj.mjtBias)):
        kind, prm = (getattr(model, f"actuator_{part}{of}")[index] for of in ("type", "prm"))
        word = enum(int(kind)).name.split("_")[1].lower()
        law[part] = word, tuple(float(value) for value in prm)
    return law


def _extended(model: Model, index: int) -> bool:
    """Whether it has more than a law: a delay, its own damping or armature."""
    return any(
        bool(float(getattr(model, f"actuator_{name}")[index].max()))
        for name in ("damping", "armature", "delay")
        if hasattr(model, f"actuator_{name}")
    )


def _range(model: Model, what: str, index: int) -> tuple[float, float] | None:
    """Return the range that limits a force or command; None where nothing limits it."""
    lower, upper = (float(end) for end in getattr(model, f"{what}range")[index])
    return (lower, upper) if getattr(model, f"{what}limited")[index] else None


def _trimmed(values: Any) -> tuple[float, ...]:  # Any: a row of the model
    """Drop the zeros at its end; at least one number stays."""
    kept = [float(v) for v in values]
    while len(kept) > 1 and kept[-1] == 0.0:
        kept.pop()
    return tuple(kept)
