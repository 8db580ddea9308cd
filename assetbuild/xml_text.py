"""XML as it lies in robots' packages: what every reader of the field overlooks is mended and named.

The readers of URDF stand on tinyxml2 or on a libxml2 that recovers. Both overlook faults of the
text that change no element: those are mended here, each with its line. Everything else is no XML.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast
from xml.parsers import expat

if TYPE_CHECKING:
    from lxml.etree import XMLParser, _Element

    Element = _Element
else:  # lxml itself is imported inside of functions
    Element = object

FaultKind = Literal[
    "declaration", "comment", "encoding", "ampersand", "space", "prefix", "end", "namespace"
]
FAULTS: dict[FaultKind, tuple[str, str]] = {
    "declaration": (
        "`<?xml ...?>` stands twice, not at the start, or states no version of XML",
        'write `<?xml version="1.0"?>` once, as the first bytes of the file',
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
        'declare it at the root element: `xmlns:NAME="..."`, or remove what has it',
    ),
    "end": (
        "more text follows the end of the root element; it is not read",
        "remove what follows it",
    ),
    "namespace": (
        "`xmlns` puts all elements into a namespace, which readers ignore",
        "remove `xmlns`",
    ),
}
"""Fault of the text -> what it is, and how to mend it."""

_UNDECLARED_PREFIX, _ODD_NAMESPACE = 201, 99
"""Types of libxml2's errors after which its tree is whole."""
_COMMENT = re.compile(rb"<!\[CDATA\[.*?(?:\]\]>|\Z)|<!--.*?(?:-->|\Z)", re.DOTALL)
_DECLARATION = re.compile(rb"<\?xml\s[^>]*\?>")
_VERSION = re.compile(rb"""version\s*=\s*["']1\.[01]["']""")
_PROLOGUE = re.compile(rb"(?:\s|\xef\xbb\xbf|<\?.*?\?>)*", re.DOTALL)
_ENCODING = re.compile(rb"""encoding\s*=\s*["']([^"']*)["']""")
_AMPERSAND = re.compile(rb"&(?!(?:#[0-9]+|#x[0-9a-fA-F]+|amp|lt|gt|quot|apos);)")
_NO_SPACE = re.compile(rb"""(=\s*(?:"[^"<>]*"|'[^'<>]*'))(?=[A-Za-z_])""")
_BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class Fault:
    """One fault of the text that was overlooked. line: from 1. text: what stands there."""

    kind: FaultKind
    line: int
    text: str


class NotXml(Exception):  # noqa: N818 # it says what the text is not
    """The text is not XML, or has a DOCTYPE. line: from 1, 0 where the parser knows none."""

    def __init__(self, message: str, line: int, *, doctype: bool = False) -> None:
        super().__init__(message)
        self.message, self.line, self.doctype = message, line, doctype


def read_tree(data: bytes, *, overlook: bool = True) -> tuple[Element, tuple[Fault, ...]]:
    """The root element without comments, and the faults of the text that were overlooked.

    No entity is resolved and nothing is loaded; the parser's own bounds on depth and length hold.
    Raises NotXml. overlook: without it every fault raises.
    """
    from lxml import etree

    refuse_doctype(data)
    try:
        return _checked(etree.fromstring(data, _parser(recover=False))), ()
    except etree.XMLSyntaxError as error:
        strict = NotXml(str(error.msg or "unreadable"), error.lineno or 0)
    if not overlook:
        raise strict
    mended, faults = _mended(data)
    refuse_doctype(mended)
    parser = _parser(recover=True)
    try:
        root = etree.fromstring(mended, parser)
    except etree.XMLSyntaxError:
        raise strict from None
    for entry in parser.error_log:
        if entry.type == _UNDECLARED_PREFIX:
            faults.append(Fault("prefix", entry.line, _line_of(mended, entry.line)))
        elif entry.type != _ODD_NAMESPACE:
            raise NotXml(entry.message, entry.line)
    if root is None or not (faults or parser.error_log):
        raise strict
    _refuse_lost_letters(root)
    return _checked(root), tuple(faults)


def number_words(text: str, count: int) -> list[str]:
    """The words of a list of `count` numbers; commas and semicolons separate as blanks do.

    Only where one meaning is left: `1,5 2 3` stays as it is, since its comma may be a decimal one.
    """
    words = text.split()
    if not any(mark in text for mark in ",;"):
        return words
    parts = [part for part in re.split(r"[\s,;]+", text.strip()) if part]
    joined = [word.strip(",;") for word in words]
    by_commas_alone = not any(mark in word for word in joined for mark in ",;")
    if len(parts) == count and (by_commas_alone or len(words) != count):
        return parts
    return words


def refuse_doctype(data: bytes) -> None:
    """Stop at a DOCTYPE before anything could be expanded; expat reads only the prologue."""
    parser = expat.ParserCreate()

    def at_doctype(*_: object) -> None:
        raise NotXml("a DOCTYPE is not allowed", parser.CurrentLineNumber, doctype=True)

    def at_element(*_: object) -> None:
        raise StopIteration

    parser.StartDoctypeDeclHandler = at_doctype
    parser.StartElementHandler = at_element
    try:
        parser.Parse(data, True)
    except (StopIteration, expat.ExpatError, ValueError, LookupError):
        return  # the real parser reports broken XML, which knows more encodings too


def _parser(*, recover: bool) -> XMLParser:
    from lxml import etree

    return etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False,
        remove_comments=True, remove_pis=True, recover=recover,
    )  # fmt: skip


def _checked(root: Element) -> Element:
    from lxml import etree

    if etree.ElementTree(root).docinfo.doctype:  # type: ignore[attr-defined] # stubs lack it
        raise NotXml("a DOCTYPE is not allowed", 0, doctype=True)
    return root


def _mended(data: bytes) -> tuple[bytes, list[Fault]]:
    """The same text, line by line, as UTF-8 without declaration and comments."""
    faults: list[Fault] = []

    def note(kind: FaultKind, at: int) -> None:
        if not any(fault.kind == kind for fault in faults):
            line = data.count(b"\n", 0, at) + 1
            faults.append(Fault(kind, line, _line_of(data, line)))

    def comment(match: re.Match[bytes]) -> bytes:
        text = match[0]
        if not (text.startswith(b"<!--") and text.endswith(b"-->")):
            return text
        if b"--" in text[4:-3] or text.endswith(b"--->"):
            note("comment", match.start())
        if _foreign_at(text) is not None:
            note("encoding", match.start())
        return _blank(text)

    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data, []
    text = _COMMENT.sub(comment, data)
    text = _without_declaration(text, note)
    # Both change the length, so the spaces come first: places in `data` and `text` are the same.
    for match in _NO_SPACE.finditer(text):
        note("space", match.start())
    for match in _AMPERSAND.finditer(text):
        note("ampersand", match.start())
    text = _AMPERSAND.sub(b"&amp;", _NO_SPACE.sub(rb"\1 ", text))
    text, line = _up_to_the_end(text)
    if line:
        faults.append(Fault("end", line, _line_of(data, line)))
    return text, faults


def _up_to_the_end(text: bytes) -> tuple[bytes, int]:
    """The text as far as the root element goes, and the line of what follows it; 0 = nothing."""
    parser = expat.ParserCreate("utf-8")
    depth = last = 0

    def at_start(*_: object) -> None:
        nonlocal depth
        depth += 1

    def at_end(*_: object) -> None:
        nonlocal depth, last
        depth, last = depth - 1, parser.CurrentByteIndex
        if depth == 0:
            raise StopIteration

    parser.StartElementHandler, parser.EndElementHandler = at_start, at_end
    try:
        parser.Parse(text, True)
    except expat.ExpatError:
        return text, 0
    except StopIteration:
        end = text.find(b">", last) + 1
        rest = text[end:]
        if rest.strip():
            return text[:end], text.count(b"\n", 0, text.index(rest.split()[0], end)) + 1
    return text, 0


def _without_declaration(text: bytes, note: Callable[[FaultKind, int], None]) -> bytes:
    """The text in UTF-8 with blanks in place of its XML declarations and byte order marks."""
    prologue = _PROLOGUE.match(text)
    end = prologue.end() if prologue else 0
    declarations = list(_DECLARATION.finditer(text, 0, end))
    first = len(_BOM) if text.startswith(_BOM) else 0
    for extra in [d for d in declarations if d.start() != first]:
        note("declaration", extra.start())
    if declarations and not _VERSION.search(declarations[0][0]):
        note("declaration", declarations[0].start())
    stated = _ENCODING.search(declarations[0][0]) if declarations else None
    name = stated[1].decode("latin-1").lower() if stated else "utf-8"
    head = _DECLARATION.sub(lambda d: _blank(d[0]), text[:end]).replace(_BOM, b"   ")
    text = head + text[end:]
    try:
        b"a".decode(name, "replace")  # `zlib` is a codec, but none of text
        codec = codecs.lookup(name).name
    except (LookupError, ValueError):
        codec = ""
    foreign = _foreign_at(text)
    if foreign is None:
        if codec == "" or codec.startswith(("utf-16", "utf-32")):
            note("encoding", declarations[0].start() if declarations else 0)
            return text
        if codec in ("utf-8", "ascii"):
            return text
    elif codec in ("", "utf-8", "ascii"):
        note("encoding", foreign)
        return text.decode("utf-8", "replace").encode()
    return text.decode(codec, "replace").encode("utf-8", "backslashreplace")


def _blank(text: bytes) -> bytes:
    return re.sub(rb"[^\r\n]", b" ", text)


def _foreign_at(text: bytes) -> int | None:
    """Where the text is no UTF-8; None = nowhere."""
    try:
        text.decode("utf-8")
    except UnicodeDecodeError as error:
        return error.start
    return None


def _refuse_lost_letters(root: Element) -> None:
    """What no encoding explains may stand between elements, but in no name and no value."""
    for element in root.iter("*"):
        if any("\ufffd" in word for pair in element.items() for word in map(str, pair)):
            line = cast("int | None", element.sourceline) or 0  # the stubs lack its type
            raise NotXml("Input is not proper UTF-8, indicate encoding !", line)


def _line_of(data: bytes, line: int) -> str:
    lines = data.splitlines()
    text = lines[line - 1] if 0 < line <= len(lines) else b""
    return " ".join(text.decode("utf-8", "replace").split())[:80]


def free_name(wanted: str, taken: set[str]) -> str:
    """`wanted`, or with the first number from 2 that makes it new; it is taken from now on."""
    name, count = wanted, 1
    while name in taken:
        count += 1
        name = f"{wanted}{count}"
    taken.add(name)
    return name
