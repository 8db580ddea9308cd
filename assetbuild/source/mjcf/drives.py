"""Actuators of a compiled MJCF: the Robot's own where it has the words, else left as they are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from assetbuild.robot.model import Actuator, General, Joint, Limits, MjcfOnly
from assetbuild.source.mjcf.links import Links, Model
from assetbuild.source.mjcf.opaque import element_text, words
from assetbuild.source.mjcf.text import error_at

if TYPE_CHECKING:
    from lxml.etree import _Element

DYN = ("none", "integrator", "filter", "filterexact", "muscle", "user")
GAIN = ("fixed", "affine", "muscle", "user")
BIAS = ("none", "affine", "muscle", "user")
JOINT = 0
"""Transmission straight to a joint."""
_TRANSMISSION = ("joint", "jointinparent", "slidersite", "tendon", "site", "body")
_REFS = ("joint", "jointinparent", "tendon", "site", "refsite", "body", "cranksite", "slidersite")


@dataclass
class Drives:
    """actuators: one for each moving joint, in the order of the joints.

    names: of the actuators, in the order of the source, with the joint that the Robot drives or "".
    """

    actuators: list[Actuator] = field(default_factory=list)
    mjcf_only: list[MjcfOnly] = field(default_factory=list)
    names: list[tuple[str, str]] = field(default_factory=list)
    limits: dict[str, Limits] = field(default_factory=dict)


def read_drives(root: _Element, links: Links, model: Model) -> Drives:
    """Every actuator of the source; joints without one are passive."""
    found = Drives()
    driven: dict[str, Actuator] = {}
    moving = {joint.name: joint for joint in links.joints if joint.kind != "fixed"}
    for element in root.iterfind("actuator/*"):
        name = str(element.get("name"))
        index = int(model.actuator(name).id)
        joint = _joint_of(model, index)
        taken = _taken(model, index) if joint in moving and joint not in driven else None
        if taken is None:
            found.mjcf_only.append(_whole(element, links, model, index))
            found.names.append((name, ""))
            continue
        driven[joint] = replace(_at_rest(taken, links.rest.get(joint, 0.0)), joint=joint, name=name)
        found.mjcf_only += _unlimited(driven[joint], moving[joint])
        found.names.append((name, joint))
    for name, moved in moving.items():
        own = driven.get(name, Actuator(name, "passive"))
        found.actuators.append(_of_joint(own, moved, model))
        if own.effort is not None:
            found.limits[name] = replace(moved.limits, effort=own.effort)
    return found


def _of_joint(actuator: Actuator, joint: Joint, model: Model) -> Actuator:
    dof = int(model.jnt_dofadr[int(model.joint(joint.name).id)])
    return replace(
        actuator,
        damping=joint.damping or 0.0,
        friction=joint.friction or 0.0,
        armature=float(model.dof_armature[dof]),
        source="the source's MJCF" if actuator.model != "passive" else "",
    )


def _joint_of(model: Model, index: int) -> str:
    if int(model.actuator_trntype[index]) != JOINT:
        return ""
    return str(model.joint(int(model.actuator_trnid[index][0])).name)


def _taken(model: Model, index: int) -> Actuator | None:
    """The actuator in the Robot's words; None when they do not say all of it."""
    gear = [float(v) for v in model.actuator_gear[index]]
    plain = gear[0] == 1.0 and not any(gear[1:]) and not int(model.actuator_group[index])
    plain = plain and not int(model.actuator_actlimited[index]) and not _newer(model, index)
    if not plain or int(model.actuator_plugin[index]) >= 0:
        return None
    force = _range(model.actuator_forcelimited[index], model.actuator_forcerange[index])
    if force is not None and force[0] != -force[1]:
        return None
    kinds = [
        int(v[index])
        for v in (model.actuator_dyntype, model.actuator_gaintype, model.actuator_biastype)
    ]
    if any(kind >= len(known) - 1 for kind, known in zip(kinds, (DYN, GAIN, BIAS), strict=True)):
        return None
    effort = force[1] if force else None
    ctrl = _range(model.actuator_ctrllimited[index], model.actuator_ctrlrange[index])
    return _simple(model, index, kinds, effort, ctrl)


def _simple(
    model: Model,
    index: int,
    kinds: list[int],
    effort: float | None,
    ctrl: tuple[float, float] | None,
) -> Actuator:
    gain = [float(v) for v in model.actuator_gainprm[index]]
    bias = [float(v) for v in model.actuator_biasprm[index]]
    dyn = [float(v) for v in model.actuator_dynprm[index]]
    kp, kd = gain[0], 0.0 - bias[2]
    if kinds[:2] == [0, 0] and not any(gain[1:]):
        if kinds[2] == 0 and kp == 1.0 and effort is None and (not ctrl or ctrl[0] == -ctrl[1]):
            return Actuator("", "motor", effort=ctrl[1] if ctrl else None, ctrl=ctrl)
        if (
            kinds[2] == 1
            and bias[:2] == [0.0, -kp]
            and kp > 0.0
            and kd >= 0.0
            and not any(bias[3:])
        ):
            return Actuator("", "pd", kp=kp, kd=kd, effort=effort, ctrl=ctrl)
        if kinds[2] == 1 and bias[:3] == [0.0, 0.0, -kp] and kp > 0.0 and not any(bias[3:]):
            return Actuator("", "velocity", kd=kp, effort=effort, ctrl=ctrl)
    said: dict[str, Any] = {  # Any: the tables' words are those of the model
        "dyntype": DYN[kinds[0]],
        "gaintype": GAIN[kinds[1]],
        "biastype": BIAS[kinds[2]],
        "dynprm": _trimmed(dyn),
        "gainprm": _trimmed(gain),
        "biasprm": _trimmed(bias),
    }
    general = General.model_construct(**said)
    return Actuator("", "general", effort=effort, ctrl=ctrl, general=general)


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
    assert actuator.general is not None  # noqa: S101 # `_simple` made it
    general = actuator.general
    if general.gaintype == "affine":
        general = general.model_copy(update={"gainprm": _moved(general.gainprm, ref)})
    if general.biastype == "affine":
        general = general.model_copy(update={"biasprm": _moved(general.biasprm, ref)})
    return replace(actuator, general=general)


def _moved(prm: tuple[float, ...], ref: float) -> tuple[float, ...]:
    return (prm[0] + prm[1] * ref, *prm[1:]) if len(prm) > 1 else prm


def _unlimited(actuator: Actuator, joint: Joint) -> Iterator[MjcfOnly]:
    """A position drive that may be sent beyond the joint's range; a target would clip it."""
    if actuator.model == "pd" and actuator.ctrl is None and joint.kind != "continuous":
        yield MjcfOnly("drive", element_text("position", {"inheritrange": "0"}), joint.name)


def _whole(element: _Element, links: Links, model: Model, index: int) -> MjcfOnly:
    """The actuator as `<general>` with all its compiled numbers."""
    dyn = int(model.actuator_dyntype[index])
    gain, bias = int(model.actuator_gaintype[index]), int(model.actuator_biastype[index])
    if (
        int(model.actuator_plugin[index]) >= 0
        or dyn >= len(DYN)
        or gain >= len(GAIN)
        or bias >= len(BIAS)
    ):
        raise error_at(
            element,
            f"actuator `{element.get('name')}` of a kind that is not read",
            "use motor, position, velocity, general, muscle or cylinder",
        )
    said = {"name": str(element.get("name"))}
    for ref in _REFS:
        if element.get(ref):
            name = str(element.get(ref))
            said[ref] = links.sites.get(name, name) if "site" in ref else name
    joint = said.get("joint") or said.get("jointinparent")
    if joint in links.rest:
        hint = "give the joint no `ref`, and move its range and body instead"
        raise error_at(element, f"actuator `{said['name']}` on a joint with `ref`", hint)
    said |= {
        "dyntype": DYN[dyn],
        "gaintype": GAIN[gain],
        "biastype": BIAS[bias],
        "dynprm": words(_trimmed(model.actuator_dynprm[index])),
        "gainprm": words(_trimmed(model.actuator_gainprm[index])),
        "biasprm": words(_trimmed(model.actuator_biasprm[index])),
        "gear": words(tuple(float(v) for v in model.actuator_gear[index])),
    }
    if element.get("cranksite"):
        said["cranklength"] = words((float(model.actuator_cranklength[index]),))
    if gain == GAIN.index("muscle"):
        said["lengthrange"] = words(tuple(float(v) for v in model.actuator_lengthrange[index]))
    if int(model.actuator_group[index]):
        said["group"] = str(int(model.actuator_group[index]))
    for kind in ("ctrl", "force", "act"):
        limited = bool(getattr(model, f"actuator_{kind}limited")[index])
        said[f"{kind}limited"] = "true" if limited else "false"
        if limited:
            said[f"{kind}range"] = words(getattr(model, f"actuator_{kind}range")[index])
    return MjcfOnly("actuator", element_text("general", said))


def _newer(model: Model, index: int) -> bool:
    """Whether it uses what MuJoCo learned after 3.11: a delay, its own damping or armature."""
    return any(
        bool(float(getattr(model, f"actuator_{name}")[index].max()))
        for name in ("damping", "armature", "delay")
        if hasattr(model, f"actuator_{name}")
    )


def _range(limited: Any, values: Any) -> tuple[float, float] | None:  # Any: entries of the model
    return (float(values[0]), float(values[1])) if limited else None


def _trimmed(values: Any) -> tuple[float, ...]:  # Any: a row of the model
    """Without the zeros at its end, at least one number."""
    kept = [float(v) for v in values]
    while len(kept) > 1 and kept[-1] == 0.0:
        kept.pop()
    return tuple(kept)
