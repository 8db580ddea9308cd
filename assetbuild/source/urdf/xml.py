"""URDF as XML: hostile bytes in, nodes that know their line and what they speak of out."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, cast

from assetbuild.errors import SourceError, Where, did_you_mean
from assetbuild.findings import Data, Finding, Rule, Severity
from assetbuild.lfs import refuse_pointer
from assetbuild.xml_text import Element, Fault, NotXml, read_tree

MAX_BYTES = 64 * 1024 * 1024
XACRO = ("http://www.ros.org/wiki/xacro", "http://ros.org/wiki/xacro", "http://wiki.ros.org/xacro")

USD = (b"#usda", b"PXR-USDC")
"""How a text and a binary file of USD start."""
_VERSION = re.compile(rb"""\A\s*<\?xml\s+version\s*=\s*["'](?!1\.[01]["'])([0-9.]{1,8})["']""")

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class Node:
    """One element of the description. subject: `link trunk`, put before every complaint.

    findings: what is reported about the whole file, one list for all its nodes.
    """

    element: Element
    file: str
    subject: str = ""
    findings: list[Finding] = field(default_factory=list, compare=False)

    @property
    def tag(self) -> str:
        """Its name, with the prefix if it has one (`xacro:macro`)."""
        return _prefixed(str(self.element.tag), self.element.prefix)

    @property
    def line(self) -> int:
        """Its line, from 1; the XML library forgets those above 65535 in some versions."""
        line = cast(int | None, self.element.sourceline)  # the stubs lack its type
        return line or 0

    def about(self, subject: str) -> Node:
        """The same element, complaints under another subject; its children inherit it."""
        return replace(self, subject=subject)

    def error(self, message: str, hint: str = "") -> SourceError:
        """An error at this line, ready to be raised."""
        text = f"{self.subject}: {message}" if self.subject else message
        return SourceError(text, where=Where(self.file, self.line), hint=hint)

    def report(
        self,
        rule: Rule,
        message: str,
        hint: str = "",
        severity: Severity | None = None,
        data: Data | None = None,
    ) -> None:
        """Add a finding about the subject, or about the robot where there is none."""
        subject = self.subject or "robot"
        self.findings.append(rule(subject, message, hint, severity=severity, data=data))

    def of(self, element: Element) -> Node:
        """Return another element of the same file, under the same subject."""
        return replace(self, element=element)

    def all(self, tag: str) -> list[Node]:
        """The children with that tag, in file order."""
        return [self.of(child) for child in self.element.iterchildren(tag)]

    def only(self, tag: str) -> Node | None:
        """The first child with that tag (`*`: any), or None; `tidy` has removed the others."""
        child = next(self.element.iterchildren(tag), None)
        return None if child is None else self.of(child)

    def need(self, tag: str) -> Node:
        """The first child with that tag."""
        child = self.only(tag)
        if child is None:
            raise self.error(f"<{self.tag}> without <{tag}>", f"add the <{tag}> element")
        return child

    def added(self, tag: str) -> Node:
        """A new last child, on the line of its parent."""
        from lxml import etree

        child = etree.SubElement(self.element, tag)
        child.sourceline = self.element.sourceline
        return self.of(child)

    def remove(self) -> None:
        """Take the element out of its parent."""
        parent = self.element.getparent()
        if parent is not None:
            parent.remove(self.element)

    def get(self, attribute: str) -> str | None:
        """The text of an attribute, or None."""
        return self.element.get(attribute)

    def text(self, attribute: str) -> str:
        """The text of an attribute that must be there and not be blank."""
        value = self.element.get(attribute)
        if value is None:
            known = [str(name) for name in self.element.attrib]
            hint = did_you_mean(attribute, known) if known else ""
            raise self.error(f"<{self.tag}> without `{attribute}`", hint)
        if not value.strip():
            raise self.error(f"{self.tag} {attribute} is empty")
        return value

    def number(self, attribute: str, default: float | None = None) -> float:
        """A finite number; without the attribute the default, or an error when there is none."""
        if default is not None and self.get(attribute) is None:
            return default
        return self._number(attribute, self.text(attribute).strip())

    def optional(self, attribute: str) -> float | None:
        """A finite number, or None without the attribute."""
        return None if self.get(attribute) is None else self.number(attribute)

    def numbers(
        self, attribute: str, count: int, default: Sequence[float] | None = None
    ) -> tuple[float, ...]:
        """`count` finite numbers; without the attribute the default, or an error."""
        if default is not None and self.get(attribute) is None:
            return tuple(default)
        text = self.text(attribute)
        words = text.split()
        if len(words) != count:
            hint = _COMMAS if "," in text else ""
            hint = _EXPAND if _is_macro(text) else hint
            joined = " ".join(words)
            message = f"{self.tag} {attribute} needs {count} numbers, found {len(words)}"
            raise self.error(f"{message}: `{_cut(joined)}`", hint)
        return tuple(self._number(attribute, word) for word in words)

    def not_negative(self, attribute: str) -> float | None:
        """A finite number from zero up, or None without the attribute."""
        value = self.optional(attribute)
        if value is not None and value < 0.0:
            message = f"{self.tag} {attribute} is {value!r}, it cannot be negative"
            raise self.error(message)
        return value

    def positive(self, attribute: str) -> float:
        """A finite number above zero."""
        value = self.number(attribute)
        if not value > 0.0:
            raise self.error(f"{self.tag} {attribute} is {value!r}, it must be positive", SIZE)
        return value

    def _number(self, attribute: str, word: str) -> float:
        value = float(word) if _NUMBER.fullmatch(word) else math.nan
        if math.isfinite(value):
            is_nothing = 0.0 < abs(value) < LEAST.get(attribute, 0.0)
            if is_nothing or (self.tag not in UNBOUNDED and abs(value) > MOST):
                raise self.error(f"{self.tag} {attribute} is {value!r}, which no robot has", _POWER)
            return value
        hint = "give a decimal number, such as 0.0123"
        hint = _COMMAS if "," in word else _EXPAND if _is_macro(word) else hint
        raise self.error(f"{self.tag} {attribute} is `{_cut(word)}`, not a finite number", hint)


UNBOUNDED = frozenset({"limit", "dynamics", "safety_controller"})
"""Some exporters write the largest number there is where they mean none."""
LEAST, MOST = {"value": 1e-100, "multiplier": 1e-9}, 1e15
"""Powers and quotients of what a robot is like must be numbers: masses, mimic's multipliers."""
_POWER = "check its power of ten"
_EXPAND = "expand the xacro file first"
_COMMAS = (
    "a comma may separate numbers or start decimals: write blanks between and `.` for decimals"
)
SIZE = "write its size (a plate needs a thickness, such as 0.001), or remove the shape"


def _is_macro(text: str) -> bool:
    return "${" in text or "$(" in text


def parse(data: bytes, file: str) -> tuple[Node, tuple[Fault, ...]]:
    """The <robot> element of a URDF, and the faults of the text that all readers overlook."""
    from lxml import etree

    element, faults = _read(data, file, "URDF")
    node = Node(element, file)
    if None in element.nsmap and node.tag == "robot":
        for child in element.iter("*"):
            if child.prefix is None:
                child.tag = str(child.tag).rpartition("}")[2]
        faults = (*faults, Fault("namespace", node.line, str(element.nsmap[None])))
        etree.cleanup_namespaces(element)
    if node.tag != "robot":
        hint = "is this the right file?"
        if node.tag in ("mujoco", "sdf"):
            hint = f"this is {'MJCF' if node.tag == 'mujoco' else 'SDF'}, not URDF"
        raise node.error(f"the root element is <{node.tag}>, not <robot>", hint)
    _refuse_xacro(node)
    return node, faults


def read_xml(data: bytes, file: str, what: str) -> tuple[Element, tuple[Fault, ...]]:
    """The root element, and the faults of the text that tinyxml2, and so MuJoCo, overlooks.

    Whatever version of XML it states: `0.0` and `1` are common. what: `MJCF`, for messages.
    """
    match = _VERSION.match(data)
    text = data[: match.start(1)] + b"1.0" + data[match.end(1) :] if match else data
    return _read(text, file, what)


def _read(data: bytes, file: str, what: str) -> tuple[Element, tuple[Fault, ...]]:
    """Read XML without entity, DTD or network; raise SourceError with the line otherwise.

    The parser's own bounds hold too: 256 levels, 10 MB per text.
    """
    if len(data) > MAX_BYTES:
        size = f"{len(data) / 1e6:.0f} MB"
        raise SourceError(f"{size} of {what}; at most 64 MiB are read", where=Where(file))
    refuse_pointer(data, where=Where(file))
    if data.startswith(USD) or file.lower().endswith(".usdz"):
        hint = "give the URDF, xacro or MJCF that it was made from, or convert it (Isaac Sim has "
        hint += "an exporter to URDF); `assetbuild validate` reads a USD"
        message = "this is USD, which is no source of a robot"
        raise SourceError(message, where=Where(file), hint=hint)
    try:
        return read_tree(data)
    except NotXml as error:
        if error.doctype:
            hint = "a robot needs none: delete the <!DOCTYPE ...> and the entities it defines"
            where = Where(file, error.line)
            raise SourceError("a DOCTYPE is not allowed", where=where, hint=hint) from None
        raise _not_xml(error.message, error.line, file) from None


def _not_xml(message: str, line: int, file: str) -> SourceError:
    hint = "the file must be XML"
    if "Premature end" in message or "unclosed" in message or "not found" in message:
        hint = "is the file cut off?"
    if "Excessive depth" in message or "excessive depth" in message:
        hint = "elements nested this deep are no robot"
    if "allowed only at the start" in message:
        hint = "delete everything before `<?xml`, including blank lines"
    if "encoding" in message:
        hint = 'save it as UTF-8, or state its encoding: `<?xml version="1.0" encoding=...?>`'
    return SourceError(f"not readable as XML: {message}", where=Where(file, line), hint=hint)


def _refuse_xacro(root: Node) -> None:
    """A xacro file is a program; its elements would be dropped as unknown, silently wrong."""
    undeclared = (e for e in root.element.iter("*") if str(e.tag).startswith("xacro:"))
    declared = (e for uri in XACRO for e in root.element.iter(f"{{{uri}}}*"))
    for element in (next(declared, None), next(undeclared, None)):
        if element is not None:
            node = root.of(element)
            raise node.error(f"<{node.tag}> in a URDF", "this is a xacro file: expand it first")


class Home(NamedTuple):
    """What the robot model has a place for in an element."""

    attributes: frozenset[str]
    children: frozenset[str]


HOME: Mapping[str, Home] = {
    tag: Home(frozenset(attributes.split()), frozenset(children.split()))
    for tag, attributes, children in (
        ("robot", "name version", "link joint material"),
        ("link", "name", "inertial visual collision"),
        ("inertial", "", "origin mass inertia"),
        ("mass", "value", ""),
        ("inertia", "ixx ixy ixz iyy iyz izz", ""),
        ("origin", "xyz rpy quat_xyzw", ""),
        ("visual", "", "origin geometry material"),
        ("collision", "", "origin geometry"),
        ("geometry", "", "box sphere cylinder capsule mesh"),
        ("box", "size", ""),
        ("sphere", "radius", ""),
        ("cylinder", "radius length", ""),
        ("capsule", "radius length", ""),
        ("mesh", "filename scale", ""),
        ("material", "name", "color texture"),
        ("color", "rgba", ""),
        ("texture", "filename", ""),
        ("joint", "name type", "origin parent child axis limit dynamics mimic"),
        ("parent", "link", ""),
        ("child", "link", ""),
        ("axis", "xyz", ""),
        ("limit", "lower upper effort velocity", ""),
        ("dynamics", "damping friction", ""),
        ("mimic", "joint multiplier offset", ""),
    )
}
"""The format, by element."""


def unread(root: Node) -> tuple[dict[str, list[Node]], list[Node]]:
    """Return (what the model has no place for, by kind; elements that are misplaced).

    Kinds: `transmission`, `name of visual` for an attribute. Nothing below such an element is
    looked at. An element of the format is misplaced where the format has none of it: an
    <inertial> in the <robot>.
    """
    homeless: dict[str, list[Node]] = {}
    strays: list[Node] = []
    stack = [root]
    while stack:
        node = stack.pop()
        home = HOME[node.tag]
        for name in map(str, node.element.attrib):
            if name not in home.attributes:
                homeless.setdefault(f"{_prefixed(name, None)} of {node.tag}", []).append(node)
        inside = node.all("*")
        for child in inside:
            if child.tag not in HOME:
                homeless.setdefault(child.tag, []).append(child)
            elif child.tag not in home.children:
                strays.append(child)
        stack += [child for child in inside if child.tag in home.children][::-1]
    return dict(sorted(homeless.items())), strays


def _prefixed(tag: str, prefix: str | None) -> str:
    local = tag.rpartition("}")[2]
    return f"{prefix}:{local}" if prefix else local


def _cut(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


def canonical(root: Node) -> bytes:
    """The elements without comments and indentation, in canonical form (W3C C14N).

    A prefix that is declared nowhere stands for a namespace of its own name.
    """
    from lxml import etree

    names = {str(name) for e in root.element.iter("*") for name in (e.tag, *e.attrib)}
    prefixes = sorted({name.partition(":")[0] for name in names if ":" in name and name[0] != "{"})
    text = etree.tostring(root.element)
    head = "".join(f' xmlns:{prefix}="urn:{prefix}"' for prefix in prefixes)
    text = text.replace(b"<robot", b"<robot" + head.encode(), 1)
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_blank_text=True)
    # Not `method="c14n"`: libxml2's refuses a relative namespace, such as `drake`.
    return str(etree.canonicalize(etree.fromstring(text, parser))).encode()
