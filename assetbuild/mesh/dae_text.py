"""COLLADA text as a document of pycollada; sloppy text that other readers take is taken."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from assetbuild.errors import StepError, Where, one_line
from assetbuild.findings import Finding, Rule
from assetbuild.mesh.material import STRAY

REPEATED = Rule(
    "mesh.repeated_ids",
    "info",
    "ids are used more than once in a COLLADA file; each part uses its own",
    "give each `<source>` and `<vertices>` an id of its own",
)

# Any below: pycollada and lxml's trees have no complete type hints.

GEOMETRIES = "{*}library_geometries/{*}geometry"
NOT_SURFACES = ("linestrips", "spline", "convex_mesh")
"""Geometry that nothing draws as a surface: assimp and pycollada leave it out, or fail on it."""


def load(data: bytes, subject: str) -> tuple[Any, list[Finding], dict[str, int]]:
    """The document, what was said of its text, and counts of what was left out.

    StepError with the line of a cut-off or broken file, and for one with two meanings.
    """
    from collada.common import DaeBrokenRefError

    _refuse_foreign(data, subject)
    root, findings = _root(data, subject)
    for element, message, hint in _unread(root):
        raise StepError(message, where=Where(subject, element.sourceline), hint=hint)
    lines = {g.get("id"): g.sourceline for g in root.iterfind(GEOMETRIES)}
    skipped, gone = _without_curves(root)
    text = _bytes(root) if findings or skipped or gone or b"<!--" in data else data
    document = _document(text, subject)
    for mend in (_mend_samplers, _drop_lost_materials):
        if mend(document):  # read it again, as its mended tree says
            errors = document.errors
            document = _document(_bytes(document.xmlnode.getroot()), subject)
            document.errors = errors
    if document.scene is None:
        raise StepError(f"{subject}: the file has no scene, so nothing says where its parts are")
    _refuse_lost_geometry(document, lines, subject)
    broken = [e for e in document.errors if isinstance(e, DaeBrokenRefError)]
    if absent := [e for e in broken if e.msg.startswith("Geometry ")]:
        skipped["instances of geometry that the file lacks"] = len(absent)
    unseen = [e for e in broken if e.msg.startswith(("Camera ", "Light "))]
    document.errors = [e for e in document.errors if e not in absent + unseen]
    return document, [*findings, *_repeated(root, subject)], skipped


def _document(data: bytes, subject: str) -> Any:
    import collada
    from collada.common import DaeError

    try:
        return collada.Collada(io.BytesIO(data), ignore=[DaeError])
    except (DaeError, ValueError, KeyError, AttributeError, TypeError, IndexError) as error:
        raise StepError(f"{subject}: not readable as COLLADA: {one_line(error)}") from error


def _bytes(root: Any) -> bytes:
    from lxml import etree

    return etree.tostring(root, encoding="utf-8")


# --- text that is no XML -----------------------------------------------------------------------


def _refuse_foreign(data: bytes, subject: str) -> None:
    if data[:2] == b"PK":
        raise StepError(f"{subject}: a zip archive, not COLLADA text", hint="unpack it first")
    plain = data.replace(b"\0", b"")  # UTF-16 would hide the words
    if b"<!ENTITY" in plain or b"<!DOCTYPE" in plain:
        raise StepError(f"{subject}: declares XML entities, which no exporter does")


def _root(data: bytes, subject: str) -> tuple[Any, list[Finding]]:
    """The root element; of text that is nearly XML, what assimp reads of it."""
    from lxml import etree

    try:
        return _parsed(data), []
    except etree.XMLSyntaxError as error:
        mended, changes = _mended(data)
        try:
            if not changes:
                raise error
            root = _parsed(mended)
        except etree.XMLSyntaxError:
            line = error.position[0] or data.count(b"\n") + 1
            raise StepError(
                f"broken XML: {one_line(error.msg)}",
                where=Where(subject, line),
                hint="is the file cut off?",
            ) from error
    message = f"the text is not quite XML and is read as other readers do: {', '.join(changes)}"
    return root, [STRAY(subject, message, hint="save the file again")]


def _parsed(data: bytes) -> Any:
    from lxml import etree

    parser = etree.XMLParser(  # pycollada takes a comment among nodes for an unknown node
        resolve_entities=False, no_network=True, huge_tree=True, remove_comments=True
    )
    return etree.fromstring(data, parser)


def _mended(data: bytes) -> tuple[bytes, list[str]]:
    """The text without what only people read, and what was changed; geometry stays as it is."""
    changes = []
    end = data.find(b"</COLLADA>") + len(b"</COLLADA>")
    if end >= len(b"</COLLADA>") and data[end:].strip():
        data = data[:end]
        changes.append("bytes after the end are left out")
    if data[:1].isspace():
        data = data.lstrip()
        changes.append("blanks before the XML declaration are left out")
    text, lost = re.subn(rb"[\x00-\x08\x0b\x0c\x0e-\x1f]", b"", data)
    if lost:
        changes.append(f"{lost} control characters are left out")
    text, bare = re.subn(rb"&(?!#?\w{1,16};)", b"&amp;", text)
    if bare:
        changes.append(f"{bare} `&` stand for themselves")
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        text = re.sub(rb'(<\?xml[^>]*?)encoding=["\'][\w-]*["\']', rb"\1", text, count=1)
        text = text.decode("cp1252", "replace").encode("utf-8")
        changes.append("letters that are not UTF-8 are taken for Windows-1252")
    return text, changes


# --- what has no meaning, or two ---------------------------------------------------------------


def _without_curves(root: Any) -> tuple[dict[str, int], set[str]]:
    """Take out what is no surface, on which pycollada would lose the whole geometry.

    Returns counts of lines and of what the scene shows, and the ids of geometries that are gone:
    a convex mesh that only a physics library names is not missed.
    """
    counts: dict[str, int] = {}
    gone: set[str] = set()
    for name in NOT_SURFACES:
        for element in list(root.iterfind(f"{GEOMETRIES}//{{*}}{name}")):
            parent = element.getparent()
            if parent.tag.endswith("}geometry"):
                gone.add("#" + parent.get("id", ""))
                element = parent
            else:
                counts[name] = counts.get(name, 0) + 1
            element.getparent().remove(element)
    for shown in list(root.iter("{*}instance_geometry")) if gone else ():
        if shown.get("url") in gone:
            if shown.getparent().tag.endswith("}node"):
                counts["splines or hulls"] = counts.get("splines or hulls", 0) + 1
            shown.getparent().remove(shown)
    return counts, gone


def _repeated(root: Any, subject: str) -> list[Finding]:
    """What is said of sources' ids that are used twice."""
    sources = root.iterfind(f"{GEOMETRIES}/{{*}}mesh/{{*}}source")
    names = [source.get("id") for source in _second(sources)]
    if not names:
        return []
    problem = f"{len(names)} ids of sources are used more than once, as `{names[0]}`"
    hint = "nothing to do here, but some other readers mix such parts up"
    message = f"{problem}: each geometry takes its own"
    return [REPEATED(subject, message, hint=hint, data={"ids": len(names)})]


def _second(elements: Iterable[Any]) -> Iterator[Any]:
    """Elements whose id an earlier one has."""
    seen: set[str] = set()
    for element in elements:
        name = element.get("id")
        if name in seen:
            yield element
        seen.add(name)


def _unread(root: Any) -> Iterator[tuple[Any, str, str]]:
    """(element, what is wrong, hint) of what readers take in different ways, or leave out without
    a word."""
    for geometry in _second(root.iterfind(GEOMETRIES)):
        message = f"a second geometry has the id `{geometry.get('id')}`, and readers differ in "
        message += "which one they show"
        hint = "give each `<geometry>` an id of its own, or delete what is not meant"
        yield geometry, message, hint
    for hole in root.iterfind(f"{GEOMETRIES}//{{*}}ph"):
        message = "polygons with holes (`<ph>`) are not read"
        yield hole, message, "triangulate the mesh before it is exported"
    for accessor in root.iterfind(f"{GEOMETRIES}//{{*}}accessor"):
        width = str(len(accessor.findall("{*}param")))
        stride, offset = accessor.get("stride", width), accessor.get("offset", "0")
        if (stride, offset) != (width, "0"):
            message = f"an accessor of {width} values has stride {stride} and offset {offset}, "
            yield accessor, message + "which is not read", "export the mesh again"
    # pycollada takes 1 m for what it cannot read; assimp reads `0,01` as a centimetre.
    unit = root.find("{*}asset/{*}unit")
    stated = "1" if unit is None else unit.get("meter", "1")
    try:
        is_usable = 0.0 < float(stated) < float("inf")
    except ValueError:
        is_usable = False
    if not is_usable:
        hint = 'write the metres of one unit of the file, as `meter="0.001"` for millimetres'
        yield unit, f'the unit is `meter="{stated}"`, which is no positive number', hint


# --- what pycollada loses ------------------------------------------------------------------------


def _mend_samplers(document: Any) -> bool:
    """Mend samplers whose picture the material itself names; False where there are none.

    `<texture texture="...">` should name a sampler; where it names a picture and the sampler
    leads nowhere, what is meant is certain. pycollada would leave out the material.
    """
    if not document.errors:
        return False
    root = document.xmlnode.getroot()
    pictures = {image.id for image in document.images}
    broken = False
    for profile in root.iter(document.tag("profile_COMMON")):
        params = {param.get("sid"): param for param in profile.findall(document.tag("newparam"))}
        named = {texture.get("texture") for texture in profile.iter(document.tag("texture"))}
        for param in params.values():
            source = param.find(f"{document.tag('sampler2D')}/{document.tag('source')}")
            if source is None or (source.text or "").strip() in params or len(named) != 1:
                continue
            for other in params.values():
                start = other.find(f"{document.tag('surface')}/{document.tag('init_from')}")
                if start is not None and (start.text or "").strip() in named & pictures:
                    source.text = other.get("sid")
                    broken = True
    return broken


def _drop_lost_materials(document: Any) -> bool:
    """Drop uses of materials that the file does not hold, or that are broken themselves.

    pycollada leaves out a whole geometry when one of its materials is missing; its triangles
    matter more than their colour, whose loss `mesh.ignored` tells.
    """
    known = {material.id for material in document.materials}
    root = document.xmlnode.getroot()
    uses = list(root.iter(document.tag("instance_material")))
    lost = [use for use in uses if use.get("target", "").removeprefix("#") not in known]
    for use in lost:
        use.getparent().remove(use)
    return bool(lost)


def _refuse_lost_geometry(document: Any, lines: Mapping[str, int], subject: str) -> None:
    """pycollada goes on after a geometry that it cannot read; then a part would be missing.

    lines: of the geometries that the file has, by their id.
    """
    from collada.common import DaeBrokenRefError

    known = {geometry.id for geometry in document.geometries}
    stated = [geometry.get("id") for geometry in document.xmlnode.getroot().iterfind(GEOMETRIES)]
    lost = [name for name in stated if name not in known]
    if lost:
        why = [e for e in document.errors if not isinstance(e, DaeBrokenRefError)]
        raise StepError(
            f"geometry `{lost[0]}` is not readable: "
            + one_line(why[0] if why else "unknown reason"),
            where=Where(subject, lines[lost[0]]),
        )
