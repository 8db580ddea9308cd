"""Untidy text that readers of URDF take alike becomes the text they mean, each with a finding.

What urdfdom, yourdfpy, PyBullet and MuJoCo take differently stays as it is, and the strict readers
of links and joints refuse it. See docs/reference/readers.md, which says what each of them does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from assetbuild.findings import Data, Finding, Rule
from assetbuild.robot.model import URDF_UNLIMITED, Base
from assetbuild.source.urdf.orientation import tidy_orientation
from assetbuild.source.urdf.shape_text import tidy_shapes
from assetbuild.source.urdf.xml import Node, Problems, parse_untidy
from assetbuild.xml_text import Fault, FaultKind, number_words

FAULT = Rule(
    "urdf.xml",
    "warning",
    "the text is not quite XML (a late `<?xml ...?>`, bytes after the end, a prefix that is "
    "declared nowhere, ...); readers of URDF overlook it",
    "mend the line",
)
REPEATED = Rule(
    "urdf.repeated",
    "warning",
    "an element occurs twice where one is expected: the first is used, as in urdfdom, yourdfpy and "
    "PyBullet",
    "remove the others",
)
SEPARATORS = Rule(
    "urdf.separators",
    "warning",
    "commas or semicolons separate numbers or follow them; they count as blanks",
    "write blanks alone",
)
BLANK = Rule(
    "urdf.blank",
    "warning",
    "an attribute has no text and counts as absent",
    "remove it, or give its value",
)
INCOMPLETE = Rule(
    "urdf.inertial.incomplete",
    "warning",
    "`<inertial>` lacks a mass or a part of its tensor; without a mass it counts as absent, "
    "without a moment the tensor counts as 0, a missing product counts as 0",
    "state the mass and all six numbers",
)
NO_LIMIT = Rule(
    "urdf.limit.none",
    "warning",
    "an effort or velocity limit is negative or infinite, or a revolute joint's range is infinite: "
    "it counts as not stated",
    "state the limit, or give effort and velocity in the recipe's actuator table",
)
WORLD_JOINT = Rule(
    "urdf.world.floating",
    "info",
    "a floating joint holds the robot to an empty root link: the link below is the floating base",
    "nothing; where it starts stands in the recipe's keyframes",
)

_ONCE = {
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "visual": ("origin", "geometry", "material"),
    "collision": ("origin", "geometry"),
    "joint": ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"),
    "material": ("color", "texture"),
}
_VECTORS = {
    ("origin", "xyz"): 3, ("origin", "rpy"): 3, ("origin", "quat_xyzw"): 4, ("axis", "xyz"): 3,
    ("box", "size"): 3, ("mesh", "scale"): 3, ("color", "rgba"): 4,
}  # fmt: skip
_NUMBERS = {
    "mass": ("value",),
    "inertia": ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "limit": ("lower", "upper", "effort", "velocity"),
    "dynamics": ("damping", "friction"),
    "mimic": ("multiplier", "offset"),
}
_OPTIONAL = frozenset(
    [("origin", "xyz"), ("origin", "rpy"), ("origin", "quat_xyzw"), ("mass", "value")]
    + [(tag, name) for tag in ("limit", "dynamics", "mimic", "inertia") for name in _NUMBERS[tag]]
)
"""What counts as absent when it has no text."""
_SAID: dict[FaultKind, str] = {
    "declaration": "`<?xml ...?>` stands twice or not at the start of the file",
    "comment": "`--` inside of a comment",
    "encoding": "the text is not in the encoding that it states; what could not be read is comment",
    "ampersand": "`&` stands for itself",
    "space": "no blank between two attributes",
    "prefix": "a prefix is declared nowhere; its elements and attributes are left out",
    "end": "more text follows the end of <robot>; it is not read",
    "namespace": "`xmlns` puts all elements into a namespace, which readers ignore",
}
_MEND: dict[FaultKind, str] = {
    "declaration": "write it once, as the first bytes of the file",
    "comment": "write `-` once",
    "encoding": "save the file as UTF-8 and state no other encoding",
    "ampersand": "write `&amp;`",
    "space": "put a blank between them",
    "prefix": 'declare it at <robot>: `xmlns:NAME="..."`, or remove what has it',
    "end": "remove what follows `</robot>`",
    "namespace": "remove `xmlns`",
}


@dataclass
class _Count:
    """How often something was found, and where first."""

    count: int = 0
    line: int = 0
    first: str = ""

    def add(self, node: Node, attribute: str) -> None:
        if not self.count:
            self.line, self.first = node.line, f'{attribute}="{node.get(attribute)}"'
        self.count += 1

    def data(self) -> Data:
        return {"count": self.count, "line": self.line}


@dataclass
class _Text:
    """What the numbers of the whole file have in common."""

    separators: _Count = field(default_factory=_Count)
    blanks: _Count = field(default_factory=_Count)

    def findings(self) -> Iterator[Finding]:
        if self.separators.count:
            message = (
                f"commas or semicolons beside numbers, {_times(self.separators)}: read as blanks"
            )
            hint = "urdfdom and MuJoCo refuse them: write blanks"
            yield SEPARATORS("robot", message, hint, data=self.separators.data())
        if self.blanks.count:
            message = f"attributes without text, {_times(self.blanks)}: read as if they were absent"
            yield BLANK("robot", message, "remove them", data=self.blanks.data())


def read_tidy(data: bytes, file: str, problems: Problems, base: Base) -> tuple[Node, list[Finding]]:
    """The <robot> element of a URDF in tidy text, and what was taken for what."""
    root, faults = parse_untidy(data, file)
    findings = [_overlooked(fault) for fault in _first_of_each(faults)]
    text = _Text()
    findings += _same_materials(root)
    for node in _known(root):
        findings += _only_first(node)
        _tidy_numbers(node, text)
    findings += text.findings()
    findings += tidy_orientation(root, problems)
    for link in root.all("link"):
        about = link.about(f"link {link.get('name')}")
        findings += _tidy_inertial(about)
        findings += tidy_shapes(about)
    for material in root.all("material"):
        findings += tidy_shapes(material.about(f"material {material.get('name')}"))
    for joint in root.all("joint"):
        findings += _tidy_limit(joint.about(f"joint {joint.get('name')}"))
    if base == "floating":
        findings += _without_world(root)
    return root, findings


def _without_world(root: Node) -> Iterator[Finding]:
    """Take out an empty root link with the floating joint below it, which a floating base is."""
    joints = root.all("joint")
    children = {child.get("link") for joint in joints if (child := joint.only("child"))}
    roots = [link for link in root.all("link") if link.get("name") not in children]
    if len(roots) != 1 or roots[0].first() is not None:
        return
    world = roots[0].get("name")
    held = [j for j in joints if (p := j.only("parent")) is not None and p.get("link") == world]
    if len(held) != 1 or held[0].get("type") != "floating":
        return
    message = f"joint {held[0].get('name')} on line {held[0].line} floats from the empty link "
    message += f"`{world}`: both are left out, and the link below is the floating base"
    hint = "where it starts stands in the recipe's keyframes"
    yield WORLD_JOINT("robot", message, hint, data={"line": held[0].line})
    held[0].remove()
    roots[0].remove()


def _known(root: Node) -> Iterator[Node]:
    """The links, joints and materials with all that is in them, under the name of each."""
    for tag in ("material", "link", "joint"):
        for top in root.all(tag):
            subject = f"{tag} {top.get('name')}"
            for element in list(top.element.iter("*")):
                yield Node(element, root.file, subject)


def _first_of_each(faults: tuple[Fault, ...]) -> list[Fault]:
    return [f for i, f in enumerate(faults) if f.kind not in {g.kind for g in faults[:i]}]


def _overlooked(fault: Fault) -> Finding:
    return FAULT(
        "robot",
        f"line {fault.line}: {_SAID[fault.kind]}: `{fault.text}`",
        _MEND[fault.kind],
        data={"fault": fault.kind, "line": fault.line},
    )


def _only_first(node: Node) -> Iterator[Finding]:
    """Remove what stands a second time."""
    for tag in _ONCE.get(node.tag, ()):
        for extra in node.all(tag)[1:]:
            extra.remove()
            yield _repeated(node, extra)
    if node.tag == "geometry":
        for extra in node.all("*")[1:]:
            extra.remove()
            yield _repeated(node, extra)


def _same_materials(root: Node) -> Iterator[Finding]:
    """A material that is defined again with the same look is one material."""
    seen: dict[str, list[tuple[str, dict[str, str]]]] = {}
    for material in root.all("material"):
        name = material.get("name") or ""
        look = [(child.tag, _words(child)) for child in material.all("*")]
        if name in seen and seen[name] == look:
            material.remove()
            yield _repeated(root.about(f"material {name}"), material)
        seen.setdefault(name, look)


def _words(node: Node) -> dict[str, str]:
    return {str(key): " ".join(str(value).split()) for key, value in node.element.items()}


def _repeated(parent: Node, extra: Node) -> Finding:
    what = f"another <{extra.tag}>" if parent.tag == "geometry" else f"a second <{extra.tag}>"
    return REPEATED(
        parent.subject,
        f"{what} in one <{parent.tag}> on line {extra.line}: it is not read, the first counts",
        hint="MuJoCo refuses it: remove one of the two",
        data={"element": extra.tag, "line": extra.line},
    )


def _tidy_numbers(node: Node, text: _Text) -> None:
    """Blanks for commas; no attribute for one without text."""
    counts = dict.fromkeys(_NUMBERS.get(node.tag, ()), 1)
    counts |= {name: n for (tag, name), n in _VECTORS.items() if tag == node.tag}
    for name, count in counts.items():
        stated = node.get(name)
        if stated is None:
            continue
        if not stated.strip() and (node.tag, name) in _OPTIONAL:
            text.blanks.add(node, name)
            del node.element.attrib[name]
            continue
        words = number_words(stated, count)
        if words != stated.split():
            text.separators.add(node, name)
            node.element.set(name, " ".join(words))


def _times(found: _Count) -> str:
    times = f"{found.count} times" if found.count > 1 else "once"
    return f"{times} (line {found.line}: `{found.first}`)"


def _tidy_inertial(link: Node) -> Iterator[Finding]:
    """Without a mass there is no <inertial>; without a moment the tensor is 0."""
    inertial = link.only("inertial")
    if inertial is None:
        return
    mass, tensor = inertial.only("mass"), inertial.only("inertia")
    if mass is None or mass.get("value") is None:
        inertial.remove()
        yield _incomplete(inertial, "it states no mass and counts as absent", "mass", "inertia")
        return
    if tensor is None:
        tensor = inertial.added("inertia")
    missing = [name for name in _NUMBERS["inertia"] if tensor.get(name) is None]
    if not missing:
        return
    if any(name in missing for name in ("ixx", "iyy", "izz")):
        for name in _NUMBERS["inertia"]:
            tensor.element.set(name, "0")
        what = "it states no tensor (`ixx`, `iyy`, `izz`), which counts as 0"
        yield _incomplete(inertial, what, "inertia")
    else:
        for name in missing:
            tensor.element.set(name, "0")
        words = ", ".join(f"`{name}`" for name in missing)
        yield _incomplete(inertial, f"<inertia> lacks {words}: taken as 0", "inertia")


def _incomplete(inertial: Node, what: str, *missing: str) -> Finding:
    return INCOMPLETE(
        inertial.subject,
        f"<inertial> on line {inertial.line}: {what}",
        hint="state the mass and all six numbers, or use the edit `inertia_from_geometry`",
        data={"line": inertial.line, "missing": missing},
    )


def _tidy_limit(joint: Node) -> Iterator[Finding]:
    """A limit below zero or without end is none."""
    limit = joint.only("limit")
    if limit is None or joint.get("type") not in ("revolute", "continuous", "prismatic"):
        return
    for name in ("effort", "velocity"):
        value = _float(limit.get(name))
        if value < 0.0 or value == math.inf:
            yield _not_stated(limit, name, "counts as not stated")
            del limit.element.attrib[name]
    ends = [_float(limit.get(name)) for name in ("lower", "upper")]
    endless = ends[0] <= -URDF_UNLIMITED and ends[1] >= URDF_UNLIMITED
    if endless and joint.get("type") == "revolute":
        yield _not_stated(limit, "lower", "has no end: the joint counts as continuous")
        joint.element.set("type", "continuous")
        for name in ("lower", "upper"):
            del limit.element.attrib[name]


def _not_stated(limit: Node, name: str, what: str) -> Finding:
    return NO_LIMIT(
        limit.subject,
        f"limit {name} `{limit.get(name)}` on line {limit.line} {what}",
        hint="readers take it differently: state it in the URDF, or in the recipe's actuator table",
        data={
            "limit": name,
            "stated": limit.get(name),
            "line": limit.line,
            "missing": (name,),
        },
    )


def _float(text: str | None) -> float:
    """The number, infinite ones included; not a number where there is none."""
    try:
        return math.nan if text is None or "_" in text else float(text)
    except ValueError:
        return math.nan
