"""Untidy text that readers of URDF take alike becomes the text they mean, each with a finding.

What urdfdom, yourdfpy, PyBullet and MuJoCo take differently stays as it is, and the strict readers
of links and joints refuse it. See docs/reference/readers.md, which says what each of them does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from assetbuild.findings import Data, Finding, Rule
from assetbuild.robot.model import Base
from assetbuild.source.urdf.tidy_parts import (
    MOMENTS,
    tidy_inertial,
    tidy_limit,
    tidy_orientation,
    tidy_shapes,
)
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
    "inertia": MOMENTS,
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
_FAULTS: dict[FaultKind, tuple[str, str]] = {
    "declaration": (
        "`<?xml ...?>` stands twice or not at the start of the file",
        "write it once, as the first bytes of the file",
    ),
    "comment": ("`--` inside of a comment", "write `-` once"),
    "encoding": (
        "the text is not in the encoding that it states; what could not be read is comment",
        "save the file as UTF-8 and state no other encoding",
    ),
    "ampersand": ("`&` stands for itself", "write `&amp;`"),
    "space": ("no blank between two attributes", "put a blank between them"),
    "prefix": (
        "a prefix is declared nowhere; its elements and attributes are left out",
        'declare it at <robot>: `xmlns:NAME="..."`, or remove what has it',
    ),
    "end": (
        "more text follows the end of <robot>; it is not read",
        "remove what follows `</robot>`",
    ),
    "namespace": (
        "`xmlns` puts all elements into a namespace, which readers ignore",
        "remove `xmlns`",
    ),
}
"""Fault of the text -> what it is, and how to mend it."""
_PARTS: Mapping[str, tuple[Callable[[Node], Iterator[Finding]], ...]] = {
    "link": (tidy_inertial, tidy_shapes),
    "material": (tidy_shapes,),
    "joint": (tidy_limit,),
}
"""Element of <robot> -> what makes its parts tidy."""


def read_tidy(data: bytes, file: str, problems: Problems, base: Base) -> tuple[Node, list[Finding]]:
    """The <robot> element of a URDF in tidy text, and what was taken for what."""
    root, faults = parse_untidy(data, file)
    findings = list(_overlooked(faults))
    findings += _same_materials(root)
    findings += _once_and_in_blanks(root)
    findings += tidy_orientation(root, problems)
    for tag, tidied in _PARTS.items():
        for node in root.all(tag):
            about = node.about(f"{tag} {node.get('name')}")
            findings += [finding for part in tidied for finding in part(about)]
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


def _overlooked(faults: tuple[Fault, ...]) -> Iterator[Finding]:
    """The first fault of each kind."""
    for kind in dict.fromkeys(fault.kind for fault in faults):
        fault = next(fault for fault in faults if fault.kind == kind)
        what, remedy = _FAULTS[kind]
        message = f"line {fault.line}: {what}: `{fault.text}`"
        yield FAULT("robot", message, remedy, data={"fault": kind, "line": fault.line})


def _once_and_in_blanks(root: Node) -> Iterator[Finding]:
    """What stands a second time goes; numbers are parted by blanks, and none is without text."""
    separators, blanks = list[_Seen](), list[_Seen]()
    for tag in ("material", "link", "joint"):
        for top in root.all(tag):
            for element in list(top.element.iter("*")):
                node = Node(element, root.file, f"{tag} {top.get('name')}")
                yield from _only_first(node)
                _tidy_numbers(node, separators, blanks)
    if separators:
        message = f"commas or semicolons beside numbers, {_times(separators)}: read as blanks"
        hint = "urdfdom and MuJoCo refuse them: write blanks"
        yield SEPARATORS("robot", message, hint, data=_counted(separators))
    if blanks:
        message = f"attributes without text, {_times(blanks)}: read as if they were absent"
        yield BLANK("robot", message, "remove them", data=_counted(blanks))


_Seen = tuple[int, str]
"""Line and text of an attribute."""


def _times(found: list[_Seen]) -> str:
    times = f"{len(found)} times" if len(found) > 1 else "once"
    return f"{times} (line {found[0][0]}: `{found[0][1]}`)"


def _counted(found: list[_Seen]) -> Data:
    return {"count": len(found), "line": found[0][0]}


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


def _tidy_numbers(node: Node, separators: list[_Seen], blanks: list[_Seen]) -> None:
    """Blanks for commas; no attribute for one without text."""
    counts = dict.fromkeys(_NUMBERS.get(node.tag, ()), 1)
    counts |= {name: n for (tag, name), n in _VECTORS.items() if tag == node.tag}
    for name, count in counts.items():
        stated = node.get(name)
        if stated is None:
            continue
        seen = (node.line, f'{name}="{stated}"')
        if not stated.strip() and (node.tag, name) in _OPTIONAL:
            blanks.append(seen)
            del node.element.attrib[name]
            continue
        words = number_words(stated, count)
        if words != stated.split():
            separators.append(seen)
            node.element.set(name, " ".join(words))
