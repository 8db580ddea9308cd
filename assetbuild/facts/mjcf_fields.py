"""What a simulation feels of a compiled MuJoCo model beyond the vocabulary: words of MJCF alone."""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterable, Iterator
from typing import Any

import numpy as np

from assetbuild.facts.table import Key, Value
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.simulators.mujoco import Model, actuators, mj, name_of

BESIDE = (
    ("body", "body", "gravcomp"),
    ("jnt", "joint", "solref solimp margin actgravcomp stiffnesspoly springyield"),
    ("dof", "joint", "dampingpoly"),
    ("geom", "shape", "solmix fluid adhesion surfacevel"),
    ("site", "frame", "type size"),
    ("cam", "camera", "projection sensorsize intrinsic"),
    ("eq", "equality", "active0 solref solimp"),
    ("actuator", "actuator", "actlimited actrange actearly damping dampingpoly armature delay"),
)
"""Beginning of MuJoCo's arrays, kind of subject, arrays: what stands beside the vocabulary."""
ALONE = (
    ("eq", "equality", "type data"),
    ("actuator", "actuator", "trntype gear cranklength dyntype dynprm gaintype gainprm biastype "
     "biasprm ctrllimited ctrlrange forcelimited forcerange"),
    ("tendon", "tendon", "limited range actfrclimited actfrcrange margin stiffness stiffnesspoly "
     "damping dampingpoly frictionloss armature lengthspring solref_lim solimp_lim solref_fri "
     "solimp_fri springyield"),
    ("pair", "contact pair", "dim solref solreffriction solimp margin gap friction adhesion"),
)  # fmt: skip
"""The same three of elements that the vocabulary does not know."""
OPTION = (
    "density viscosity wind magnetic disableflags enableflags disableactuator noslip_iterations "
    "noslip_tolerance o_margin o_solref o_solimp o_friction ls_tolerance jacobian"
)
FREE = 0
CALLED = {"jnt": "joint", "cam": "camera", "eq": "equality", "tex": "texture", "mat": "material"}
"""Beginning of MuJoCo's arrays -> how it calls the thing, where these differ."""
BLANK = """<mujoco><worldbody><body name="b"><joint name="j"/><geom name="g" size="1"/>
<geom name="h" size="1"/><site name="s"/><camera name="c"/></body></worldbody>
<contact><pair geom1="g" geom2="h"/></contact><equality><joint joint1="j"/></equality>
<tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon>
<actuator><general joint="j"/></actuator></mujoco>"""


def fields(model: Model, elements: Collection[tuple[str, str]]) -> dict[Key, Value]:
    """Words of everything that differs from MuJoCo's defaults.

    elements: (kind, name) of the equalities and actuators that the vocabulary knows.
    """
    facts: dict[Key, Value] = {}
    for rows, known in ((BESIDE, ()), (ALONE, elements)):
        for prefix, kind, words in rows:
            for word in words.split():
                for name, value in _stated(model, prefix, word):
                    if (kind, name) not in known:
                        facts[Key(kind, name, f"mjcf:{word}")] = value
    facts |= {key: v for key, v in _between(model) if (key.kind, key.name) not in elements}
    for word in [one for one in OPTION.split() if ("simulation", one) not in VOCABULARY]:
        value = plain(getattr(model.opt, word))
        if value != plain(getattr(_blank().opt, word)):
            facts[Key("simulation", "", f"mjcf:{word}")] = value
    return facts


@functools.cache
def _blank() -> Model:
    """A model in which everything is as MuJoCo has it by itself."""
    return mj.MjModel.from_xml_string(BLANK)


def _stated(model: Model, prefix: str, word: str) -> Iterator[tuple[str, Value]]:
    """(name, value) of the rows of an array that are not MuJoCo's default.

    Without limits a range says nothing; nor do a camera's intrinsics without a sensor's size.
    """
    field = f"{prefix}_{word}"
    if not hasattr(model, field):  # MuJoCo 3.11 lacks some
        return
    usual, rows = getattr(_blank(), field)[-1], getattr(model, field)
    flag = "cam_sensorsize" if word == "intrinsic" else f"{field.removesuffix('range')}limited"
    limited = getattr(model, flag, rows)
    for index, name in enumerate(subjects(model, prefix)):
        free = prefix == "jnt" and int(model.jnt_type[index]) == FREE  # it has no limits
        limits = not word.endswith(("range", "intrinsic")) or np.any(limited[index])
        if limits and not free and not np.array_equal(rows[index], usual):
            yield name, plain(rows[index])


def subjects(model: Model, prefix: str) -> list[str]:
    """The names of what the rows of an array are about; degrees of freedom are joints'."""
    if prefix == "dof":
        return [name_of(model, "joint", int(joint)) for joint in model.dof_jntid]
    count = len(actuators(model)) if prefix == "actuator" else getattr(model, f"n{prefix}", 0)
    return [name_of(model, CALLED.get(prefix, prefix), index) for index in range(count)]


def numbers(values: Any) -> tuple[float, ...]:  # Any: a number or an array of MuJoCo's
    """All of them in a row."""
    return tuple(float(v) for v in np.ravel(values))


def plain(value: Any) -> Value:  # Any: as above
    """A fact's value."""
    row = numbers(value)
    return row[0] if len(row) == 1 else row


def body_name(model: Model, index: int) -> str:
    """ "" of the world."""
    return name_of(model, "body", index) if index else ""


class Bodies:
    """The names of bodies, and the frames in which what they carry is given: their own."""

    def __init__(self, model: Model) -> None:
        self.model = model

    def name(self, body: int) -> str:
        """The body's name; "" of the world."""
        return body_name(self.model, body)

    def placed(self, body: int) -> Pose:
        """X_frame_body of the frame in which facts are given."""
        return IDENTITY

    def is_own_frame(self, body: int, site: str, X_body_site: Pose) -> bool:
        """Whether a site is the body's frame: in its origin, under its name."""
        return (site, X_body_site) == (body_name(self.model, body), IDENTITY)


# --- what they act between ----------------------------------------------------------------------


def _between(model: Model) -> Iterator[tuple[Key, Value]]:
    """Names of what an equality holds, an actuator drives, a tendon runs over, a pair joins."""
    kinds = mj.mjtObj
    of_trn = {0: kinds.mjOBJ_JOINT, 1: kinds.mjOBJ_JOINT, 2: kinds.mjOBJ_SITE,
              3: kinds.mjOBJ_TENDON, 4: kinds.mjOBJ_SITE, 5: kinds.mjOBJ_BODY}  # fmt: skip
    of_eq = {2: kinds.mjOBJ_JOINT, 3: kinds.mjOBJ_TENDON}
    for index, name in enumerate(subjects(model, "eq")):
        kind = of_eq.get(int(model.eq_type[index]), int(model.eq_objtype[index]))
        ends = (model.eq_obj1id[index], model.eq_obj2id[index])
        yield Key("equality", name, "mjcf:between"), _named(model, kind, ends)
    for index, name in enumerate(subjects(model, "actuator")):
        kind = of_trn.get(int(model.actuator_trntype[index]), kinds.mjOBJ_UNKNOWN)
        ends = model.actuator_trnid[index]
        yield Key("actuator", name, "mjcf:between"), _named(model, kind, ends)
    for index, name in enumerate(subjects(model, "pair")):
        ends = (model.pair_geom1[index], model.pair_geom2[index])
        yield Key("contact pair", name, "mjcf:between"), _named(model, kinds.mjOBJ_GEOM, ends)
    for index, name in enumerate(subjects(model, "cam")):
        if target := int(model.cam_targetbodyid[index]) + 1:
            yield Key("camera", name, "mjcf:target"), body_name(model, target - 1)
    for index, name in enumerate(subjects(model, "tendon")):
        first = int(model.tendon_adr[index])
        wraps = range(first, first + int(model.tendon_num[index]))
        yield Key("tendon", name, "mjcf:path"), tuple(_wrap(model, wrap) for wrap in wraps)


def _wrap(model: Model, wrap: int) -> str:
    """`joint knee 2.0`, `site hook`, `geom drum beside`."""
    kind = mj.mjtWrap(int(model.wrap_type[wrap])).name.removeprefix("mjWRAP_").lower()
    number, index = float(model.wrap_prm[wrap]), int(model.wrap_objid[wrap])
    match kind:
        case "joint":
            return f"joint {name_of(model, 'joint', index)} {number!r}"
        case "site":
            return f"site {name_of(model, 'site', index)}"
        case "sphere" | "cylinder":
            beside = _named(model, mj.mjtObj.mjOBJ_SITE, [number])
            return " ".join([f"geom {name_of(model, 'geom', index)}", *beside])
    return f"{kind} {number!r}"


def _named(model: Model, kind: int, ends: Iterable[float]) -> tuple[str, ...]:
    """`site hook` of each; what is not there is left out. kind: MuJoCo's number of it."""
    word = mj.mjtObj(int(kind)).name.removeprefix("mjOBJ_").lower()
    there = [int(index) for index in ends if index >= 0]
    return tuple(f"{word} {mj.mj_id2name(model, int(kind), index) or index}" for index in there)
