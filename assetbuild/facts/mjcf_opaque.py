"""What only MJCF says of a robot, read by MuJoCo's own parser: the words to expect of an MJCF."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from assetbuild.facts.mjcf_model import simulation_facts
from assetbuild.facts.mjcf_words import is_covered, words
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Key, Value
from assetbuild.robot.model import MjcfOnly, Tree

OWNERS = {"joint": "joint", "shape": "shape", "frame": "frame", "camera": "camera",
          "material": "material", "body": "body", "root": "body", "drive": "actuator",
          "mimic": "equality"}  # fmt: skip
"""Place of `MjcfOnly` whose attributes belong on an element of the robot -> its kind."""
TAGS = {"frame": "site", "shape": "geom", "actuator": "general", "equality": "joint"}
MEANS: Mapping[str, tuple[str, ...]] = {
    "ctrlrange": ("command range",), "inheritrange": ("command range",),
    "ctrllimited": ("command range",),
    "resolution": ("resolution",), "polycoef": ("mimic multiplier", "mimic offset"),
    "stiffness": ("stiffness", "spring reference"),
    "damping": ("damping",), "frictionloss": ("friction",), "armature": ("armature",),
    "range": ("lower", "upper"), "springref": ("spring reference",),
    "group": ("role", "mjcf:group"),
    "rgba": ("rgba",), "mode": ("tracking",), "gear": ("gear", "kp", "kd", "effort"),
}  # fmt: skip
"""Attribute that only MJCF says -> quantities of the owner that it changes."""

WORDS = {"mjcf:actfrcrange": "mjcf:actuatorfrcrange"}
"""Word of MuJoCo's specification -> the quantity as the compiled model is read."""


@dataclass(frozen=True)
class Opaque:
    """What only MJCF says: subjects of its own, and attributes of the robot's.

    subjects: (kind, name). words: every word expected. touched: quantities that these attributes
    change, so that the robot does not know them.
    """

    subjects: frozenset[tuple[str, str]]
    words: Mapping[Key, Value]
    touched: frozenset[Key]


def opaque_of(items: tuple[MjcfOnly, ...], reference: Reference) -> Opaque:
    """Read by MuJoCo's own parser, each element in a document of its own."""
    subjects: dict[tuple[str, str], None] = {}
    found: dict[Key, Value] = {}
    touched: set[Key] = set()
    names = mjcf_names(reference.tree)
    for item in items:
        kind = OWNERS.get(item.place)
        if item.place in ("option", "size", "keyframe", "freejoint"):
            continue
        if kind is None or (item.place == "body" and not item.element.startswith("<body")):
            own = _parsed(_document(item, names))
            own = {key: value for key, value in own.items() if key.kind != "body"}
            for key, value in _numbered(own, subjects).items():
                subjects[key.kind, key.name] = None
                found[key] = value
            if item.place == "tendon":  # whose path names nothing in a document of its own
                found |= _path(item.element)
            continue
        owner = names.get(item.owner, item.owner) if kind == "body" else item.owner
        stated = attributes_of(item.element)
        of = "joint" if kind in ("actuator", "equality") else kind
        touched |= {Key(of, owner, q) for name in stated for q in MEANS.get(name, ())}
        named = stated.get("name", owner) if kind == "equality" else owner
        if named != owner:  # the equality of a joint is called as the joint, unless it says else
            found[Key("joint", owner, "mjcf:equality")] = named
        if stated.get("actuatorfrclimited") == "false":
            stated.pop("actuatorfrcrange", None)
        if item.place == "drive":
            # The joint's own range, which is narrower, is the robot's effort.
            if ends := stated.pop("forcerange", ""):
                found[Key("joint", owner, "mjcf:effort range")] = _on_joint(ends, owner, reference)
            stated = {k: v for k, v in stated.items() if not k.endswith("limited")}  # as compiled
        plain = " ".join(f'{name}="{value}"' for name, value in stated.items() if value)
        for key, value in _owned(kind, plain).items() if plain else ():
            found[Key(kind, named, WORDS.get(key.quantity, key.quantity))] = value
    return Opaque(frozenset(subjects), found, frozenset(touched))


def _on_joint(ends: str, joint: str, reference: Reference) -> tuple[float, ...]:
    row = reference.control.by_joint.get(joint)
    return tuple((abs(row.gear) if row else 1.0) * float(end) for end in ends.split())


def _document(item: MjcfOnly, names: Mapping[str, str]) -> str:
    """The sections of a document with one whole element, where it stands."""
    if item.place != "body":
        return f"<{item.place}>{item.element}</{item.place}>"
    if not item.owner:
        return f"<worldbody>{item.element}</worldbody>"
    body = names.get(item.owner, item.owner)
    return f'<worldbody><body name="{body}">{item.element}</body></worldbody>'


def _numbered(own: Mapping[Key, Value], known: Mapping[tuple[str, str], None]) -> dict[Key, Value]:
    """Subjects without a name are counted through the whole file."""
    count: dict[str, int] = {}
    for kind, name in known:
        count[kind] = count.get(kind, 0) + name.startswith("#")
    return {
        key._replace(name=f"#{count.get(key.kind, 0) + int(key.name[1:])}")
        if key.name.startswith("#")
        else key: value
        for key, value in own.items()
    }


def _path(element: str) -> dict[Key, Value]:
    """What a tendon runs over, as `mjcf_words` tells it."""
    from defusedxml.ElementTree import fromstring

    tendon, found = fromstring(element), []
    for part in tendon:
        numbers = [str(float(part.attrib[n])) for n in ("coef", "divisor") if n in part.attrib]
        names = [part.get(part.tag), part.get("sidesite")]
        found.append(" ".join([part.tag, *filter(None, names), *numbers]))
    return {Key("tendon", str(tendon.get("name")), "mjcf:path"): tuple(found)}


def _owned(kind: str, attributes: str) -> dict[Key, Value]:
    """Words of one element that has nothing but these attributes."""
    needed = {"actuator": ' joint="j"', "equality": ' joint1="j"', "material": ' name="m"',
              "shape": "", "body": "", "joint": "", "frame": "", "camera": ""}[kind]  # fmt: skip
    text = f"<{TAGS.get(kind, kind)}{needed} {attributes}/>"
    section = {"actuator": "actuator", "equality": "equality", "material": "asset"}.get(kind)
    if section:
        parsed = _parsed(f"<{section}>{text}</{section}>")
    elif kind == "body":
        parsed = _parsed(f"<worldbody>{text}</worldbody>")
    else:
        parsed = _parsed(f"<worldbody><body>{text}</body></worldbody>")
    return {
        key: value
        for key, value in parsed.items()
        if key.kind == kind and not (attributes and _blank(kind).get(key.quantity) == value)
    }


@functools.cache
def _blank(kind: str) -> Mapping[str, Value]:
    """Words of an element that states nothing, by quantity."""
    return {key.quantity: value for key, value in _owned(kind, "").items()}


def sensor_words(kind: str) -> dict[Key, Value]:
    """Words that MuJoCo gives to a sensor of a site by itself: a rangefinder measures distance."""
    parsed = _parsed(f'<sensor><{kind} name="s" site="s"/></sensor>')
    return {key: value for key, value in parsed.items() if key.quantity == "mjcf:intprm"}


def attributes_of(element: str) -> dict[str, str]:
    """Return the attributes of an element, which is given as text."""
    from defusedxml.ElementTree import fromstring

    return dict(fromstring(element).attrib)


def _parsed(inside: str) -> dict[Key, Value]:
    """Words of a document; the angles of the build's MJCFs are radians."""
    import mujoco

    text = f'<mujoco><compiler angle="radian" autolimits="true"/>{inside}</mujoco>'
    found = words(mujoco.MjSpec.from_string(text))
    return {key: value for key, value in found.items() if key.kind != "model"}


def mjcf_names(tree: Tree) -> dict[str, str]:
    """Name in MJCF by name of a body: `world` is MuJoCo's own."""
    taken, written = {body.name for body in tree.bodies}, "world_body"
    while written in taken:
        written += "_"
    return {name: written if name == "world" else name for name in taken}


def source_commands(items: tuple[MjcfOnly, ...]) -> Iterator[tuple[tuple[str, str], float]]:
    """((keyframe, actuator), command) that the source's MJCF states."""
    from defusedxml.ElementTree import fromstring

    for item in items:
        for said in fromstring(item.element) if item.place == "keyframe" else ():
            yield (item.owner, said.attrib["actuator"]), float(said.attrib["value"])


ATTRIBUTE_OF = {
    "integrator": "integrator", "cone": "cone", "solver": "solver", "iterations": "iterations",
    "ls_iterations": "line search iterations", "impratio": "impratio",
}  # fmt: skip


def opaque_option(reference: Reference) -> tuple[dict[str, Value], dict[Key, Value]]:
    """(solver facts, words of the section `option`) that the source's MJCF states."""
    import mujoco

    found: dict[str, Value] = {}
    other: dict[Key, Value] = {}
    for item in reference.control.mjcf_only:
        if item.place == "option":
            spec = mujoco.MjSpec.from_string(f"<mujoco>{item.element}</mujoco>")
            facts, stated = simulation_facts(spec.option), attributes_of(item.element)
            found |= {q: facts[q] for name, q in ATTRIBUTE_OF.items() if name in stated}
            said = {k: v for k, v in words(spec).items() if k.kind == "simulation"}
            other |= {k: v for k, v in said.items() if not is_covered(k)}
    return found, other


def free_joint(reference: Reference) -> dict[Key, Value]:
    """Words of the joint of a floating base, and what the source's MJCF says of it."""
    tree = reference.tree
    if tree.base != "floating":
        return {}
    stated: dict[str, str] = {}
    for item in reference.control.mjcf_only:
        if item.place == "freejoint":
            stated |= attributes_of(item.element)
    name = stated.pop("name", "floating_base_joint")
    root = mjcf_names(tree)[tree.root]
    said = " ".join(f'{word}="{value}"' for word, value in stated.items() if value)
    text = f'<worldbody><body name="{root}"><joint name="{name}" type="free" {said}/></body>'
    parsed = _parsed(f"{text}</worldbody>")
    return {key: value for key, value in parsed.items() if key.kind == "joint"}
