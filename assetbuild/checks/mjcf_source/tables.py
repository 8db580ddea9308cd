"""A compiled MJCF as a table in the frame of its root, free of what says nothing of the robot.

The frame of a body is a writer's choice, so every place is told in the root's frame, where the
source's and our bodies agree whatever their own frames are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from assetbuild.facts.mjcf import read_spec
from assetbuild.facts.mjcf_words import COVERED
from assetbuild.facts.reference import pose_value
from assetbuild.facts.surface import Surface
from assetbuild.facts.table import Key, Table, Value
from assetbuild.robot.inertia import move_inertial
from assetbuild.robot.model import Inertial
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.simulators.joint_drives import read_drive
from assetbuild.simulators.mujoco import Model, name_of, passes

Subjects = dict[tuple[str, str], dict[str, Value]]
"""Facts by quantity of each (kind, name)."""

FREE = 0
TOUCH = frozenset({"friction", "condim", "priority", "solref", "solimp", "margin", "gap"})
TOUCHING = TOUCH | {f"mjcf:{name}" for name in (*TOUCH, "solmix")}
LIMITS = frozenset({"mjcf:margin", "mjcf:range", "mjcf:limited", "mjcf:solref_limit",
                    "mjcf:solimp_limit", "mjcf:axis", "mjcf:pos", "mjcf:springref",
                    "mjcf:solref_friction", "mjcf:solimp_friction",
                    "mjcf:actfrcrange", "mjcf:actfrclimited"})  # fmt: skip
SCENE = frozenset({"picture", "statistic", "number", "text", "tuple", "plugin", "skin", "flex",
                   "height field"})  # fmt: skip
"""Kinds that say how a scene is shown, or belong to programs: `mjcf.dropped` tells them."""
ASSETS = frozenset({"mesh", "material", "texture", "exclude"})
"""Kinds that act through the shapes or pairs that use them, where they are compared."""
ACTING = ("trntype", "gear", "dyntype", "dynprm", "gaintype", "gainprm", "biastype", "biasprm",
          "ctrllimited", "ctrlrange", "forcelimited", "forcerange", "actlimited")  # fmt: skip
"""What MuJoCo makes of the words of an actuator, of which there are several for one thing."""
SHARED = ("mesh", "box", "sphere", "capsule", "cylinder")
"""Shapes that every format has; what only MJCF has keeps the colour of its material alone."""
WORDS = {
    "joint": {"mjcf:ref", "mjcf:align"},  # in every position, range and command; how to compile
    "shape": {"mjcf:density", "mjcf:mass", "mjcf:typeinertia", "mjcf:fitscale",  # in the inertia
              "texture", "texture corners"},  # pictures are no input of this check
    "frame": {"mjcf:size", "mjcf:type", "mjcf:rgba", "mjcf:material"},  # told as compiled
    "keyframe": {"mjcf:qvel", "mjcf:act", "mjcf:mpos", "mjcf:mquat", "mjcf:time", "mjcf:there"},
    "light": {"mjcf:pos", "mjcf:dir", "mjcf:texture", "mjcf:there"},  # told as compiled; a picture
    "camera": {"mjcf:there"},
    "actuator": {"mjcf:actlimited", *(f"mjcf:{name}" for name in COVERED["actuator"] - {"target"})},
    "tendon": {"mjcf:material"},
}  # fmt: skip
"""Words that say nothing that is not said elsewhere, or that `mjcf.dropped` tells, by kind."""


@dataclass(frozen=True)
class Side:
    """A model and its facts in the root's frame.

    snapped: shapes and frames that MuJoCo's compiler moved onto a frame less than 1e-6 away.
    """

    model: Model
    facts: Subjects
    snapped: frozenset[tuple[str, str]]

    @property
    def table(self) -> Table:
        """As a table."""
        return table_of(self.facts)


def table_of(facts: Subjects) -> Table:
    """Subjects as a table."""
    return Table(
        {
            Key(*subject, name): value
            for subject, own in facts.items()
            for name, value in own.items()
        }
    )


def read_side(spec: Any) -> Side:  # Any: mujoco.MjSpec
    """Compile and read; MuJoCo's ValueError where it refuses."""
    _fold_gravity(spec.option)
    model, table = read_spec(spec)
    facts: Subjects = {}
    for key, value in table.facts.items():
        facts.setdefault((key.kind, key.name), {})[key.quantity] = value
    # The world's own geoms are scenery; pairs are read again, whatever groups the shapes have.
    facts = {
        subject: own
        for subject, own in facts.items()
        if subject[0] != "pair" and (subject[0] != "shape" or "mask" in own)
    }
    named = {str(model.key(index).name) for index in range(model.nkey)}
    for subject in [s for s in facts if s[0] == "keyframe" and s[1].split("/")[0] not in named]:
        del facts[subject]  # which `<size nkey>` reserves
    _add(model, facts)
    for (kind, name), own in facts.items():
        _without_noise(kind, own, free=_is_free(model, kind, name))
    _in_root_frame(facts)
    facts = {s: own for s, own in facts.items() if own and s[0] not in SCENE | ASSETS}
    snapped = {
        ("shape", name_of(model, "geom", i)) for i in range(model.ngeom) if model.geom_sameframe[i]
    }
    snapped |= {
        ("frame", name_of(model, "site", i)) for i in range(model.nsite) if model.site_sameframe[i]
    }
    return Side(model, facts, frozenset(snapped))


def _fold_gravity(option: Any) -> None:  # Any: MuJoCo's option
    """Gravity that a flag switches off is none: two ways to say one thing."""
    import mujoco

    bit = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    if int(option.disableflags) & bit:
        option.disableflags = int(option.disableflags) & ~bit
        option.gravity = (0.0, 0.0, 0.0)


def _is_free(model: Model, kind: str, name: str) -> bool:
    return kind == "joint" and int(model.jnt_type[model.joint(name).id]) == FREE


def _touches(shape: dict[str, Value]) -> bool:
    return bool(shape["mask"] or shape["partners"])


def _without_noise(kind: str, own: dict[str, Value], *, free: bool) -> None:
    """Removes what says nothing."""
    useless = set(WORDS.get(kind, ()))
    if free:  # a class may give it what belongs to limits, of which it has none
        useless |= LIMITS
    if kind == "shape" and not _touches(own):
        useless |= TOUCHING
    if kind == "tendon" and all(str(w).startswith("joint ") for w in own["mjcf:path"]):  # type: ignore[union-attr] # texts
        useless |= {"mjcf:width", "mjcf:rgba"}  # a fixed tendon is not drawn
    for name in useless & own.keys():
        del own[name]


# --- what only the compiled model knows -----------------------------------------------------


def _add(model: Model, facts: Subjects) -> None:
    """Looks by shape, sites and lights as compiled, polynomials, pairs, commands, the root."""
    import mujoco

    for geom in range(model.ngeom):
        own, material = facts.get(("shape", name_of(model, "geom", geom))), model.geom_matid[geom]
        if own is not None and not _touches(own) and material >= 0 and own["geometry"] in SHARED:
            look = facts.get(("material", str(model.mat(int(material)).name)), {})
            own |= {f"mjcf:material {name.removeprefix('mjcf:')}": v for name, v in look.items()}
    for site in range(model.nsite):
        kind, size = float(model.site_type[site]), _numbers(model.site_size[site])
        more: dict[str, Value] = {"mjcf:kind": kind, "mjcf:extent": size}
        facts["frame", name_of(model, "site", site)] |= more | {
            "mjcf:colour": _numbers(model.site_rgba[site])
        }
    for light in range(model.nlight):
        owner = int(model.light_bodyid[light])
        facts.setdefault(("light", name_of(model, "light", light)), {}).update(
            {
                "body": name_of(model, "body", owner) if owner else "",
                "place": _numbers(model.light_pos[light]),
                "direction": _numbers(model.light_dir[light]),
            }
        )
    for joint in range(model.njnt):
        dof, own = int(model.jnt_dofadr[joint]), facts["joint", name_of(model, "joint", joint)]
        for field, index in (("dof_dampingpoly", dof), ("jnt_stiffnesspoly", joint)):
            if hasattr(model, field) and np.any(getattr(model, field)[index]):
                own[f"mjcf:{field}"] = _numbers(getattr(model, field)[index])
    for first, second in _apart(model):
        facts["pair", f"{first} {second}"] = {"filtered": True}
    for key in (key for key in range(model.nkey) if model.key(key).name):
        for drive in (i for i in range(model.nu) if read_drive(model, i) is None):
            name = f"{name_of(model, 'key', key)}/{name_of(model, 'actuator', drive)}"
            facts["keyframe command", name] = {"command": float(model.key_ctrl[key][drive])}
    for sensor in range(model.nsensor):
        own = facts["sensor", name_of(model, "sensor", sensor)]
        for side in ("object", "reference"):
            kind = int(getattr(model, f"sensor_{side[:3]}type")[sensor])
            if kind == mujoco.mjtObj.mjOBJ_SITE:  # not the frame of a body of that name
                own[side] = str(own[side]).replace("frame ", "site ", 1)
    for drive in range(model.nu):
        own = facts.setdefault(("actuator", name_of(model, "actuator", drive)), {})
        alone = read_drive(model, drive) is None  # what drives a joint is a fact of the joint
        for name in ACTING if alone else ("actlimited",):
            own[f"compiled {name}"] = _numbers(getattr(model, f"actuator_{name}")[drive])
        if int(model.actuator_trntype[drive]) == mujoco.mjtTrn.mjTRN_SITE:
            own["mjcf:target"] = f"site {own['mjcf:target']}"
    _equalities(model, facts)
    _root(model, facts)


def _numbers(values: Any) -> tuple[float, ...]:  # Any: a row of the model
    return tuple(float(v) for v in np.ravel(values))


def _apart(model: Model) -> Iterator[tuple[str, str]]:
    """Pairs of bodies (sorted names) that the file excludes, or that MuJoCo lets pass.

    Those that masks keep apart follow from the shapes.
    """
    solid = sorted(
        {int(b) for b in model.geom_bodyid[(model.geom_contype | model.geom_conaffinity) != 0]}
    )
    said = {
        tuple(sorted((int(pair) >> 16, int(pair) & 0xFFFF))) for pair in model.exclude_signature
    }
    for n, a in enumerate(solid):
        for b in solid[n + 1 :]:
            if a and ((a, b) in said or passes(model, a, b)):
                first, second = sorted(name_of(model, "body", i) for i in (a, b))
                yield first, second


def _equalities(model: Model, facts: Subjects) -> None:
    """Where the two anchors of `connect` stand, each in its body: a body's frame may differ."""
    import mujoco

    for index in range(model.neq):
        own = facts.get(("equality", name_of(model, "eq", index)))
        if own and int(model.eq_objtype[index]) == mujoco.mjtObj.mjOBJ_SITE:
            own |= {name: f"site {own[name]}" for name in ("mjcf:name1", "mjcf:name2")}
        connects = int(model.eq_type[index]) == mujoco.mjtEq.mjEQ_CONNECT
        if own is None or not connects or int(model.eq_objtype[index]) != mujoco.mjtObj.mjOBJ_BODY:
            continue
        own.pop("mjcf:data", None)
        for side, (at, first) in {"1": (model.eq_obj1id, 0), "2": (model.eq_obj2id, 3)}.items():
            own[f"body{side}"] = name_of(model, "body", int(at[index])) if at[index] else ""
            own[f"anchor{side}"] = _numbers(model.eq_data[index][first : first + 3])


def _root(model: Model, facts: Subjects) -> None:
    """Of the robot, not of the first mocap body of its scene."""
    root = next(b for b in range(1, model.nbody) if model.body_mocapid[b] < 0)
    first = int(model.body_jntadr[root])
    floats = first >= 0 and int(model.jnt_type[first]) == FREE
    pose = (*_numbers(model.body_pos[root]), *_numbers(model.body_quat[root]))
    facts["robot", ""] = {"base": "floating"} if floats else {"base": "fixed", "base pose": pose}


# --- the root's frame -----------------------------------------------------------------------


def _in_root_frame(facts: Subjects) -> None:
    at = {"": IDENTITY}
    for (kind, name), own in facts.items():
        if kind == "body":  # after its parent
            local = _pose(own["pose"]) if own["parent"] else IDENTITY
            at[name] = at[str(own["parent"])] @ local
            own |= {"pose": pose_value(at[name])} | moved_inertia(own, at[name])
    for (kind, _), own in facts.items():
        X = at[str(own.get("body", ""))]
        if kind == "joint" and "anchor" in own:
            own["anchor"] = _numbers(X.apply(own["anchor"]))  # type: ignore[arg-type] # three numbers
            own["axis"] = _numbers(X.rotation @ np.array(own["axis"]))
        elif kind == "light":
            own["place"] = _numbers(X.apply(own["place"]))  # type: ignore[arg-type] # as above
            own["direction"] = _numbers(X.rotation @ np.array(own["direction"]))
        elif kind == "equality" and "body1" in own:
            for side in "12":
                X_root_body = at[str(own[f"body{side}"])]
                own[f"anchor{side}"] = _numbers(X_root_body.apply(own[f"anchor{side}"]))  # type: ignore[arg-type] # as above
        elif kind in ("shape", "frame", "camera"):
            if "pose" in own:
                own["pose"] = pose_value(X @ _pose(own["pose"]))
            if "corner moments" in own:
                own |= _moved_surface(own, X)


def _pose(value: Value) -> Pose:
    x, y, z, *quat = value  # type: ignore[misc, str-unpack] # seven numbers
    return Pose((x, y, z), tuple(quat))  # type: ignore[arg-type] # as above


def moved_inertia(own: dict[str, Value], X: Pose) -> dict[str, Value]:
    """Mass, centre and tensor of a body in another frame; nothing of a massless one."""
    if "inertia" not in own:
        return {}
    said = Inertial(own["mass"], own["centre of mass"], own["inertia"])  # type: ignore[arg-type] # numbers
    there = move_inertial(said, X)
    return {"centre of mass": there.com_m, "inertia": there.inertia_com_kg_m2}


def _moved_surface(own: dict[str, Value], X: Pose) -> dict[str, Value]:
    xx, yy, zz, xy, xz, yz = own["corner moments"]  # type: ignore[misc, str-unpack] # six numbers
    moments = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    here = Surface(0, 0.0, 0.0, own["mean corner"], moments)  # type: ignore[arg-type] # numbers
    there = here.moved(X).facts()
    return {name: there[name] for name in ("mean corner", "corner moments")}
