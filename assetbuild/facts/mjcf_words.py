"""Every attribute of an MJCF, as MuJoCo's own parser has it: classes resolved, nothing compiled.

What the vocabulary says is read from the compiled model (`mjcf_model`); these are the words that
only MJCF has. An attribute with MuJoCo's default says nothing, so it is no fact. Whatever
attributes a version of MuJoCo has, all of them are walked: none is named here to be read.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from assetbuild.facts.table import Key, Value

Spec = Any  # mujoco.MjSpec, whose extension module has no types

KINDS: Mapping[str, tuple[str, str]] = {
    "bodies": ("body", "add_body"), "joints": ("joint", "add_joint"),
    "geoms": ("shape", "add_geom"), "sites": ("frame", "add_site"),
    "cameras": ("camera", "add_camera"), "lights": ("light", "add_light"),
    "materials": ("material", "add_material"), "textures": ("texture", "add_texture"),
    "meshes": ("mesh", "add_mesh"), "hfields": ("height field", "add_hfield"),
    "actuators": ("actuator", "add_actuator"), "sensors": ("sensor", "add_sensor"),
    "keys": ("keyframe", "add_key"), "equalities": ("equality", "add_equality"),
    "excludes": ("exclude", "add_exclude"), "pairs": ("contact pair", "add_pair"),
    "tendons": ("tendon", "add_tendon"), "numerics": ("number", "add_numeric"),
    "texts": ("text", "add_text"), "tuples": ("tuple", "add_tuple"),
    "plugins": ("plugin", "add_plugin"), "skins": ("skin", "add_skin"),
    "flexes": ("flex", "add_flex"),
}  # fmt: skip
"""List of the specification -> (kind of subject, how a blank one is made)."""
BELOW_BODY = ("body", "joint", "shape", "frame", "camera", "light")

NO_FACT: Mapping[str, str] = {
    "id": "a number that follows from the order",
    "info": "the place in the file, for messages",
    "signature": "a digest of the rest",
    "name": "the subject's own name",
    "classname": "MuJoCo has put the values of the class into the attributes",
    "childclass": "as above",
    "compiler": "what it does is in the compiled model",
    "frame": "its pose is in that of what it holds",
    "parent": "compared as the body that carries it",
    "authored": "which attributes the file states, whatever they say",
}
"""Attributes of any object that say nothing of the robot, with the reason."""
COVERED: Mapping[str, frozenset[str]] = {
    "body": frozenset({"pos", "quat", "alt", "ialt", "mass", "ipos", "iquat", "inertia",
                       "fullinertia", "explicitinertial"}),
    "joint": frozenset({"type", "pos", "axis", "range", "limited", "damping", "frictionloss",
                        "armature", "stiffness", "springref", "springdamper", "actfrcrange",
                        "actfrclimited"}),
    "shape": frozenset({"type", "size", "pos", "quat", "alt", "fromto", "meshname", "fitscale",
                        "contype", "conaffinity", "group", "material", "rgba"}),
    "frame": frozenset({"pos", "quat", "alt", "fromto"}),
    "camera": frozenset({"pos", "quat", "alt", "fovy", "resolution", "mode"}),
    "material": frozenset({"rgba", "textures"}),
    "texture": frozenset({"file", "content_type", "data", "nchannel"}),
    "mesh": frozenset({"file", "content_type", "scale", "refpos", "refquat", "uservert",
                       "usernormal", "userface", "userfacenormal", "userfacetexcoord",
                       "usertexcoord"}),
    "actuator": frozenset({"target", "trntype", "gear", "gaintype", "gainprm", "biastype",
                           "biasprm", "dyntype", "dynprm", "ctrllimited", "ctrlrange",
                           "forcelimited", "forcerange", "inheritrange", "ctrlspec", "type"}),
    "sensor": frozenset({"type", "objtype", "objname", "reftype", "refname", "cutoff", "noise",
                         "datatype", "needstage", "dim"}),
    "keyframe": frozenset({"qpos", "ctrl"}),
    "equality": frozenset({"type", "name1", "name2", "data", "active", "objtype"}),
    "exclude": frozenset({"bodyname1", "bodyname2"}),
    "simulation": frozenset({"timestep", "gravity", "integrator", "cone", "solver", "iterations",
                             "ls_iterations", "impratio"}),
}  # fmt: skip
"""Attributes whose meaning `mjcf_model` reads from the compiled model, by kind."""
NEVER_ALONE = frozenset({"material", "texture", "mesh", "exclude", "simulation"})
"""Kinds that act through the shapes, bodies or pairs that name them."""
SURFACE = frozenset({"condim", "priority", "friction", "solref", "solimp", "margin", "gap"})
"""Those of a shape that may touch something."""


def words(spec: Spec) -> dict[Key, Value]:
    """Every attribute that is not MuJoCo's default, as `mjcf:<attribute>` of its subject."""
    found: dict[Key, Value] = {Key("model", "", "mjcf:name"): str(spec.modelname)}
    for listed, (kind, _) in KINDS.items():
        unnamed = 0
        for item in getattr(spec, listed, ()):
            name = str(getattr(item, "name", "") or "")
            if kind == "body" and name == "world":
                continue
            if not name:
                name, unnamed = f"#{unnamed}", unnamed + 1
            own = dict(_stated(item, _blank(listed)))
            if kind == "tendon":
                own["path"] = _path(item.path)
            if kind in BELOW_BODY and kind != "body":
                above = str(item.parent.name)
                own["body"] = "" if above == "world" else above
            for attribute, value in own.items():
                found[Key(kind, name, f"mjcf:{attribute}")] = value
            if not own:
                found[Key(kind, name, "mjcf:there")] = True
    for kind, part in (("simulation", "option"), ("picture", "visual"), ("statistic", "stat")):
        for attribute, value in _stated(getattr(spec, part), _section(part)):
            found[Key(kind, "", f"mjcf:{attribute}")] = value
    return found


def _path(path: Any) -> tuple[str, ...]:  # Any: MuJoCo's MjsTendonPath
    """What a tendon runs over, in order: `joint knee 2.0`, `site hook`, `geom drum beside`."""
    found = []
    for wrap in (path[i] for i in range(len(path))):
        kind = wrap.type.name.removeprefix("mjWRAP_").lower()
        said = (wrap.target, wrap.sidesite, wrap.coef, wrap.divisor)
        shown = [str(getattr(v, "name", v)) for v in said if v is not None]
        found.append(" ".join(["geom" if kind in ("sphere", "cylinder") else kind, *shown]))
    return tuple(found)


def is_covered(key: Key, *, shown: bool = False) -> bool:
    """Whether the vocabulary says the same of a robot's own subject.

    shown: the key is of a shape that is drawn and touches nothing.
    """
    attribute = key.quantity.removeprefix("mjcf:").split(".")[0]
    if attribute in ("there", "body") or attribute in COVERED.get(key.kind, ()):
        return True
    return key.kind == "shape" and not shown and attribute in SURFACE


@dataclass(frozen=True)
class _Usual:
    """An attribute of a kind of object, and its default.

    default: as `_plain` has it, by `repr`; at_once: as the attribute itself tells it, to compare
    most values without turning them into facts. parts: of a struct of attributes, these.
    """

    attribute: str
    default: str
    at_once: object
    parts: tuple[_Usual, ...] = ()


@functools.cache
def _section(name: str) -> tuple[_Usual, ...]:
    """The attributes of a section of the specification: `option`."""
    import mujoco

    spec = mujoco.MjSpec()
    return _usual(getattr(spec, name))


@functools.cache
def _blank(listed: str) -> tuple[_Usual, ...]:
    """The attributes of the objects of a list of the specification."""
    import mujoco

    kind, make = KINDS[listed]
    spec = mujoco.MjSpec()
    return _usual(getattr(spec.worldbody if kind in BELOW_BODY else spec, make)())


def _usual(blank: Any) -> tuple[_Usual, ...]:  # Any: an object of the specification
    found = []
    for attribute in dir(type(blank)):
        if attribute.startswith("_") or attribute in NO_FACT or attribute == "global_":
            continue  # `global_` is `global` again
        if not isinstance(getattr(type(blank), attribute, None), property):
            continue
        try:
            value = getattr(blank, attribute)
        except (AttributeError, TypeError, ValueError):
            continue
        if not callable(value):
            parts = _usual(value) if _is_part(value) else ()
            found.append(_Usual(attribute, repr(_plain(value)), _at_once(value), parts))
    return tuple(found)


def _at_once(value: Any) -> object:  # Any: whatever an attribute holds
    if isinstance(value, bool | int | float | str | bytes) or _is_enum(value):
        return value
    if isinstance(value, np.ndarray):
        return value.tobytes()
    return () if hasattr(value, "__len__") and not len(value) else object()


def _stated(item: Any, usual: tuple[_Usual, ...], before: str = "") -> Iterator[tuple[str, Value]]:
    """(attribute, value) that differ from the defaults; nested ones with their path."""
    for known in usual:
        try:
            value = getattr(item, known.attribute)
        except (AttributeError, TypeError, ValueError):
            continue
        if known.parts:
            yield from _stated(value, known.parts, f"{before}{known.attribute}.")
        elif _at_once(value) != known.at_once:
            plain = _plain(value)
            if plain is not None and repr(plain) != known.default:
                yield f"{before}{known.attribute}", plain


def _is_part(value: object) -> bool:
    """Whether it is a struct of attributes, such as `visual.headlight`, and no other object."""
    return type(value).__qualname__.startswith(("MjVisual", "MjsOrientation", "MjLROpt"))


def _is_enum(value: object) -> bool:
    return type(value).__name__.startswith("mjt")


def _plain(value: Any) -> Value:  # Any: whatever an attribute holds
    """Numbers, texts and lists of these; None for other objects of the specification."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, str):
        return value
    if isinstance(value, int | float | np.number):
        return float(value)
    if _is_enum(value):
        return str(value.name)
    if isinstance(value, bytes):
        return value.hex()
    try:
        items = list(value)
    except TypeError:
        return None
    if all(isinstance(item, str) for item in items):
        return tuple(items)
    try:
        return tuple(float(item) for item in np.ravel(np.asarray(items, dtype=np.float64)))
    except (TypeError, ValueError):
        return None
