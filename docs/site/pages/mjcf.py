"""The page of MJCF: what becomes of every element and attribute that MuJoCo's schema knows.

The schema is the library's; which attribute goes where is said by the readers themselves, whose
lists stand in `source/mjcf`, and by `robot.mjcf_only`.
"""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.facts.mjcf_grammar import NEWER_ATTRIBUTES, NEWER_TAGS, OLDEST, Path, schema
from assetbuild.robot import mjcf_only
from assetbuild.source.mjcf import read_mjcf, sections, shapes
from assetbuild.source.mjcf.flatten_mjcf import REFUSED
from assetbuild.source.mjcf.opaque import keys

INTRODUCTION = """\
# MJCF, word by word

Every element and attribute that the schema of MuJoCo {version} knows, and what becomes of it when
an MJCF is the source of a robot.

- **every format**: the robot holds it, so each format has it that can say it ([Facts](facts.md));
  `lost.urdf` and `lost.usd` report what a URDF or a USD goes without. A URDF has no cameras; a USD
  has their place and field of view, and the ratio of their `resolution`.
- **resolved**: it says how the file is to be read (units, classes, folders, copies); its effect
  stands in the numbers.
- **MJCF only**: our MJCF has it exactly; the others are written without it (`mjcf.only`,
  information).
- **MJCF only, moves**: the same, and the robot moves otherwise without it: the warning
  `mjcf.motion`, and the error `usd.motion` where the recipe asks for a USD (springs:
  `mjcf.spring`, `usd.spring`). A fixed tendon over joints that follow one another, with an actuator
  that is a drive of the one that leads, moves alike in every format (`mjcf.own_drive`). An
  equality of fixed tendons is a mimic joint in every format where to MuJoCo it is the same
  constraint: two joints in all, coefficients of 1 or -1, and no mass that both move.
- **left out**: reported as `mjcf.dropped`.
- **refused**: an error with file and line.

A word that MuJoCo {oldest} (mjlab) does not know is marked with `*`. An MJCF with it is refused,
with file and line, unless the recipe says `mjcf: {{grammar: 4.0}}`, which keeps it; `init` writes
that key. The MJCF that is written then has the warning `lint.grammar`: mjlab cannot load it.
"""
HELD, RESOLVED, MJCF = "every format", "resolved", "MJCF only"
MOVES, LEFT_OUT, NO = "MJCF only, moves", "left out", "refused"
FATES = (HELD, RESOLVED, MJCF, MOVES, LEFT_OUT, NO)
_MOVING_JOINT = frozenset(("springref", "stiffness"))
_OF_JOINT = read_mjcf.JOINT | {"name", "class", "damping", "frictionloss", "actuatorfrcrange",
                             "actuatorfrclimited"}  # fmt: skip
_OF_DRIVE = keys(
    "name class joint jointinparent gear ctrllimited ctrlrange forcelimited forcerange "
    "inheritrange kp kv dampratio timeconst gaintype gainprm biastype biasprm dyntype dynprm area "
    "diameter bias"
)
"""Read from the compiled actuator of a joint, whose law is in them."""
_DRIVES = ("general", "motor", "position", "velocity", "damper", "cylinder")


def fate(path: Path, attribute: str) -> str:
    """What becomes of an attribute; KeyError of an element that nobody has thought of."""
    section, tag = (path[1] if len(path) > 1 else "mujoco"), path[-1]
    if REFUSED.keys() & set(path) and path[1:] != ("sensor", "plugin"):
        return LEFT_OUT if section == "extension" else NO
    if section in ("mujoco", "compiler", "default"):
        return RESOLVED
    if path[1:] == ("size",) and attribute == "memory":
        return MJCF
    if section in sections.NOT_READ or (section == "asset" and "skin" in path):
        return LEFT_OUT
    return _SECTIONS[section](path, tag, attribute)


def _option(path: Path, tag: str, attribute: str) -> str:
    if tag == "option" and attribute in ("timestep", "gravity"):
        return HELD
    if tag == "flag" and attribute == "gravity":
        return HELD
    lost = {*mjcf_only.MEDIUM, "actuatorgroupdisable", *mjcf_only.FLAGS}
    return MOVES if attribute in lost else MJCF


def _asset(path: Path, tag: str, attribute: str) -> str:
    if tag == "mesh":
        return LEFT_OUT if attribute in shapes.LOST_OF_MESH | {"material"} else HELD
    if tag == "model":
        return RESOLVED
    if tag == "hfield" or tag == "layer":
        return LEFT_OUT
    if tag == "texture":
        return HELD if attribute in ("name", "file", "content_type", "class") else LEFT_OUT
    return HELD if attribute in ("name", "class", "rgba", "texture") else MJCF


def _body(path: Path, tag: str, attribute: str) -> str:
    held = {
        "joint": _OF_JOINT,
        "geom": shapes.SAID,
        "site": read_mjcf.SITE | {"name", "class"},
        "camera": read_mjcf.CAMERA - {"target"} | {"name", "class"},
        "light": frozenset(("class",)),
        "inertial": read_mjcf.BODY | keys("mass diaginertia fullinertia"),
        "(world)body": read_mjcf.BODY | {"name"},
    }
    if tag == "attach":
        return RESOLVED
    if tag == "freejoint":
        return RESOLVED if attribute == "align" else MJCF
    if attribute in held[tag]:
        return HELD
    moves = {"joint": _MOVING_JOINT, "(world)body": frozenset(("gravcomp",)),
             "geom": frozenset(("surfacevel",))}  # fmt: skip
    return MOVES if attribute in moves.get(tag, ()) else MJCF


def _contact(path: Path, tag: str, attribute: str) -> str:
    return HELD if tag == "exclude" else MJCF


def _equality(path: Path, tag: str, attribute: str) -> str:
    """A linear coupling of joints is a mimic joint, whose softness is MuJoCo's own; `connect` and
    `weld` are loops.
    """
    if tag in ("connect", "weld"):
        return HELD if attribute in sections.LOOP_WORDS else MOVES
    if tag == "joint":
        return MJCF if attribute in ("solref", "solimp", "active") else HELD
    return MOVES


def _tendon(path: Path, tag: str, attribute: str) -> str:
    if attribute == "material":
        return LEFT_OUT
    return MOVES if attribute in mjcf_only.TENDON else MJCF


def _actuator(path: Path, tag: str, attribute: str) -> str:
    if attribute == "user":
        return LEFT_OUT
    if tag in _DRIVES and attribute in _OF_DRIVE:
        return HELD
    return MJCF if attribute == "group" else MOVES


def _sensor(path: Path, tag: str, attribute: str) -> str:
    return LEFT_OUT if tag == "plugin" or attribute == "key" else MJCF


def _keyframe(path: Path, tag: str, attribute: str) -> str:
    if attribute in sections.AT_REST | {"plastic"}:
        return LEFT_OUT
    return HELD


_SECTIONS = {
    "option": _option, "asset": _asset, "(world)body": _body, "contact": _contact,
    "tendon": _tendon, "equality": _equality, "actuator": _actuator, "sensor": _sensor,
    "keyframe": _keyframe,
}  # fmt: skip


def mjcf_page() -> str:
    """One table for each section, a row for each element."""
    import mujoco

    parts = [INTRODUCTION.format(version=mujoco.__version__, oldest=OLDEST)]
    last = ""
    for path, attributes in schema():
        section = path[1] if len(path) > 1 else "mujoco"
        if section != last:
            heads = " | ".join(FATES)
            parts.append(f"\n## {section}\n\n| element | {heads} |\n|{' --- |' * 7}\n")
            last = section
        parts.append("".join(_row(path, attributes)))
    return "".join(parts)


def _row(path: Path, attributes: tuple[str, ...]) -> Iterator[str]:
    cells: dict[str, list[str]] = {name: [] for name in FATES}
    for attribute in attributes:
        newer = path[-1] in NEWER_TAGS or attribute in NEWER_ATTRIBUTES.get(path[-1], ())
        cells[fate(path, attribute)].append(f"`{attribute}`" + ("*" if newer else ""))
    if not attributes:
        cells[fate(path, "")].append("the element")
    element = " / ".join(path[1:]) or path[0]
    yield f"| {element} | {' | '.join(' '.join(cells[name]) for name in FATES)} |\n"
