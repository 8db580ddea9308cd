"""A compiled MJCF as subjects and their facts, without what says nothing of the robot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from assetbuild.facts.mjcf import read_spec
from assetbuild.facts.mjcf_words import COVERED, Spec
from assetbuild.facts.table import Value, pair_name
from assetbuild.simulators.mujoco import Model, actuators, first_command, name_of, passes
from assetbuild.simulators.mujoco.drives import read_drive
from assetbuild.simulators.mujoco.levers import tendon_coupling

Subjects = dict[tuple[str, str], dict[str, Value]]
"""Facts by quantity of each (kind, name)."""

FREE = 0
SURFACE = frozenset({"friction", "condim", "priority", "solref", "solimp", "margin", "gap"})
LEFT_OUT = frozenset({
    "picture", "statistic", "number", "text", "tuple", "plugin", "skin", "flex", "height field",
    "model",  # how a scene is shown, and what belongs to programs: `mjcf.dropped` tells them
    "mesh", "material", "texture", "exclude", "pair",  # they act through what uses them
})  # fmt: skip
"""Kinds that are not compared as such."""
WORDS = {
    "joint": {"mjcf:ref", "mjcf:align"},  # in every position, range and command; how to compile
    "shape": {"mjcf:density", "mjcf:mass", "mjcf:typeinertia", "mjcf:fitscale",  # in the inertia
              "texture", "texture corners"},  # pictures are no input of this check
    "frame": {"mjcf:material"},  # in its colour
    "keyframe": {"mjcf:qvel", "mjcf:act", "mjcf:mpos", "mjcf:mquat", "mjcf:time"},
    "light": {"mjcf:texture"},
    "tendon": {"mjcf:material"},
    "actuator": {f"mjcf:{name}" for name in COVERED["actuator"] - {"target"}}  # as compiled
                | {"mjcf:lengthrange", "mjcf:userdata"},
}  # fmt: skip
"""Words that another fact covers, or that the build leaves out (`mjcf.dropped`), by kind."""
OF_FREE = frozenset(f"mjcf:{name}" for name in (
    "type", "damping", "armature", "frictionloss", "stiffness", "group", "userdata"))  # fmt: skip
"""What a free joint has; a class may give it what belongs to limits."""
ACTING = ("trntype", "gear", "dyntype", "dynprm", "gaintype", "gainprm", "biastype", "biasprm",
          "ctrllimited", "ctrlrange", "forcelimited", "forcerange", "actlimited")  # fmt: skip
"""What MuJoCo makes of the words of an actuator, of which there are several for one thing."""
SHARED = ("mesh", "box", "sphere", "capsule", "cylinder")
"""Shapes that every format has; what only MJCF has keeps the colour of its material alone."""

GREY = (0.5, 0.5, 0.5, 1.0)
"""What MuJoCo draws a shape in that states no colour."""


@dataclass(frozen=True)
class Side:
    """A model and its facts."""

    model: Model
    facts: Subjects


def read_side(spec: Spec) -> Side:
    """Compile and read; MuJoCo's ValueError where it refuses."""
    _fold_gravity(spec.option)
    model, table = read_spec(spec, by_area=True)
    every: Subjects = {}
    for key, value in table.facts.items():
        every.setdefault((key.kind, key.name), {})[key.quantity] = value
    keys = {str(model.key(index).name) for index in range(model.nkey)}  # unnamed: `<size nkey>`
    facts = {
        (kind, name): {q: v for q, v in own.items() if q not in _noise(model, kind, name, own)}
        for (kind, name), own in every.items()
        if kind not in LEFT_OUT
        and (kind != "shape" or "mask" in own)  # the world's own geoms are scenery
        and (kind != "keyframe" or name.split("/")[0] in keys)
    }
    _looks(model, facts, every)
    _acting(model, facts)
    _couplings(model, facts)
    return Side(model, facts)


def _fold_gravity(option: Any) -> None:  # Any: MuJoCo's option
    """Gravity that a flag switches off is none: two ways to say one thing."""
    import mujoco

    bit = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    if int(option.disableflags) & bit:
        option.disableflags = int(option.disableflags) & ~bit
        option.gravity = (0.0, 0.0, 0.0)


def _noise(model: Model, kind: str, name: str, own: dict[str, Value]) -> set[str]:
    """Quantities that say nothing."""
    useless = WORDS.get(kind, set()) | {"mjcf:there", "mjcf:body"}
    if kind == "joint" and int(model.jnt_type[model.joint(name).id]) == FREE:
        useless |= own.keys() - OF_FREE
    if kind == "shape" and not touches(own):
        useless |= SURFACE | {f"mjcf:{word}" for word in (*SURFACE, "solmix")}
    if kind == "tendon" and all(str(w).startswith("joint ") for w in own["mjcf:path"]):  # type: ignore[union-attr] # texts
        useless |= {"mjcf:width", "mjcf:rgba"}  # a fixed tendon is not drawn
    return useless


def touches(shape: dict[str, Value]) -> bool:
    """Whether the masks of a shape let it touch anything."""
    return bool(shape.get("mask") or shape.get("partners"))


# --- what only the compiled model knows -----------------------------------------------------


def _numbers(values: Any) -> tuple[float, ...]:  # Any: a row of the model
    return tuple(float(v) for v in np.ravel(values))


def _body(model: Model, index: int) -> str:
    return name_of(model, "body", index) if index else ""


def _looks(model: Model, facts: Subjects, every: Subjects) -> None:
    """Materials by the shapes that wear them; sites and lights as compiled."""
    for geom in range(model.ngeom):
        own, material = facts.get(("shape", name_of(model, "geom", geom))), model.geom_matid[geom]
        if own is not None and not touches(own) and material >= 0 and own["geometry"] in SHARED:
            look = every.get(("material", str(model.mat(int(material)).name)), {})
            own |= {f"mjcf:material {name.removeprefix('mjcf:')}": v for name, v in look.items()}
        if own is not None:
            own.setdefault("rgba", GREY)
    for site in range(model.nsite):
        own = facts["frame", name_of(model, "site", site)]
        own |= {f"mjcf:{word}": _numbers(getattr(model, f"site_{word}")[site])
                for word in ("type", "size", "rgba")}  # fmt: skip
    for light in range(model.nlight):
        own = facts.setdefault(("light", name_of(model, "light", light)), {})
        own["body"] = _body(model, int(model.light_bodyid[light]))
        own |= {f"mjcf:{word}": _numbers(getattr(model, f"light_{word}")[light])
                for word in ("pos", "dir")}  # fmt: skip


def _acting(model: Model, facts: Subjects) -> None:
    """Actuators that drive no joint, their commands; polynomials of joints."""
    import mujoco

    for drive in actuators(model):
        name = name_of(model, "actuator", drive)
        own = facts.setdefault(("actuator", name), {})
        alone = read_drive(model, drive) is None  # what drives a joint is a fact of the joint
        pulls = int(model.actuator_gaintype[drive]) == mujoco.mjtGain.mjGAIN_MUSCLE
        if pulls:  # MuJoCo measures it where the file states none
            own["mjcf:lengths"] = _numbers(model.actuator_lengthrange[drive])
        for word in ACTING if alone else ("actlimited",):
            own[f"mjcf:{word}"] = _numbers(getattr(model, f"actuator_{word}")[drive])
        if int(model.actuator_trntype[drive]) == mujoco.mjtTrn.mjTRN_SITE:
            own["mjcf:target"] = f"site {own['mjcf:target']}"
        for kind in ("ctrl", "force"):
            if not getattr(model, f"actuator_{kind}limited")[drive]:
                own.pop(f"mjcf:{kind}range", None)  # it limits nothing
        named = [key for key in range(model.nkey) if str(model.key(key).name)]  # `<size nkey>`
        for key in named if alone else ():
            command = {"mjcf:command": float(model.key_ctrl[key][first_command(model, drive)])}
            facts["keyframe", f"{name_of(model, 'key', key)}/{name}"] = {**command}
    for tendon in range(model.ntendon):  # MuJoCo measures the length where the file states none
        own = facts["tendon", name_of(model, "tendon", tendon)]
        own.pop("mjcf:springlength", None)
        if model.tendon_stiffness[tendon]:
            own["mjcf:springlength"] = _numbers(model.tendon_lengthspring[tendon])
    for joint in range(model.njnt):
        own, dof = facts["joint", name_of(model, "joint", joint)], int(model.jnt_dofadr[joint])
        for field, index in (("dof_dampingpoly", dof), ("jnt_stiffnesspoly", joint)):
            if hasattr(model, field) and np.any(getattr(model, field)[index]):
                own[f"mjcf:{field}"] = _numbers(getattr(model, field)[index])


def _couplings(model: Model, facts: Subjects) -> None:
    """Pairs, equalities and sensors with the kind of what they name; the root of the robot."""
    import mujoco

    for first, second in _apart(model):
        facts["pair", pair_name(first, second)] = {"filtered": True}
    for index in range(model.neq):
        name = name_of(model, "eq", index)
        if ("loop", name) in facts:
            continue
        own = facts.get(("equality", name), {})
        kind, connects = int(model.eq_objtype[index]), mujoco.mjtEq.mjEQ_CONNECT
        welds = mujoco.mjtEq.mjEQ_WELD
        if tendon_coupling(model, index):  # told as a mimic
            for word in ("type", "name1", "name2", "data"):
                own.pop(f"mjcf:{word}", None)
        elif own and kind == mujoco.mjtObj.mjOBJ_SITE:
            own |= {name: f"site {own[name]}" for name in ("mjcf:name1", "mjcf:name2")}
        elif own and int(model.eq_type[index]) == welds and kind == mujoco.mjtObj.mjOBJ_BODY:
            own.pop("mjcf:data", None)  # the relative pose as compiled
            data = _numbers(model.eq_data[index])
            own |= {"body1": _body(model, int(model.eq_obj1id[index])),
                    "body2": _body(model, int(model.eq_obj2id[index])),
                    "mjcf:anchor2": data[:3], "mjcf:weld pose": data[3:10],
                    "mjcf:torquescale": data[10]}  # fmt: skip
        elif own and int(model.eq_type[index]) == connects and kind == mujoco.mjtObj.mjOBJ_BODY:
            own.pop("mjcf:data", None)  # the anchors as compiled, each in its body
            for end, at, start in ("1", model.eq_obj1id, 0), ("2", model.eq_obj2id, 3):
                own[f"body{end}"] = _body(model, int(at[index]))
                own[f"mjcf:anchor{end}"] = _numbers(model.eq_data[index][start : start + 3])
    for sensor in range(model.nsensor):
        own = facts["sensor", name_of(model, "sensor", sensor)]
        for word, kinds in ("object", model.sensor_objtype), ("reference", model.sensor_reftype):
            if int(kinds[sensor]) == mujoco.mjtObj.mjOBJ_SITE:  # no body of that name
                own[word] = str(own[word]).replace("frame ", "site ", 1)
    root = 1
    joint = int(model.body_jntadr[root])
    floats = joint >= 0 and int(model.jnt_type[joint]) == FREE
    pose = (*_numbers(model.body_pos[root]), *_numbers(model.body_quat[root]))
    facts["robot", ""] = {"base": "floating"} if floats else {"base": "fixed", "base pose": pose}


def _apart(model: Model) -> Iterator[tuple[str, str]]:
    """Pairs of bodies (sorted names) that the file excludes, or that MuJoCo lets pass.

    Those that masks keep apart follow from the shapes.
    """
    solid = model.geom_bodyid[(model.geom_contype | model.geom_conaffinity) != 0]
    said = {(int(pair) >> 16, int(pair) & 0xFFFF) for pair in model.exclude_signature}
    for a, b in combinations(sorted({int(body) for body in solid} - {0}), 2):
        if (a, b) in said or (b, a) in said or passes(model, a, b):
            first, second = sorted((_body(model, a), _body(model, b)))
            yield first, second
