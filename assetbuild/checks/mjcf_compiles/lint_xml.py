"""What the text of an MJCF says that no compiled model shows any more."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath, PureWindowsPath

from lxml import etree

from assetbuild.errors import StepError
from assetbuild.facts.mjcf_grammar import OLDEST, newer_words
from assetbuild.findings import Finding, Rule

Xml = etree._Element  # lxml's own name for the type
FILES = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")
RANGES = ("ctrlrange", "forcerange", "actrange", "range", "actuatorfrcrange")
MAX_INCLUDES = 64

GRAMMAR = Rule(
    "lint.grammar",
    "warning",
    "a word that MuJoCo 3.11 (mjlab) does not know",
    "use the older spelling",
)
ABSOLUTE_PATH = Rule(
    "lint.absolute_path",
    "warning",
    "a path that exists on one machine only",
    "make it relative to the file",
)
RANGE = Rule(
    "lint.range", "error", "the lower end of a range is not below the upper one", "swap them"
)
FOREIGN_CLASS = Rule(
    "lint.class",
    "warning",
    "a drive has the class of another joint, whose range differs",
    "use the joint's own class",
)


def read(path: Path) -> Xml:
    """The root with its includes in place; StepError for what is no XML, or includes too much."""
    seen: list[Path] = []
    root = _parsed(path, seen)
    if root.tag != "mujoco":
        raise StepError(f"{path.name}: the root element is `{root.tag}`, not `mujoco`")
    return root


def _parsed(path: Path, seen: list[Path]) -> Xml:
    if len(seen) >= MAX_INCLUDES:
        raise StepError(f"{path.name}: more than {MAX_INCLUDES} includes, or a circle of them")
    seen.append(path)
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
    try:
        root = etree.fromstring(path.read_bytes(), parser)
    except (etree.XMLSyntaxError, OSError) as error:
        raise StepError(f"{path.name}: {error}") from None
    for include in list(root.iter("include")):
        above = include.getparent()
        if above is None:
            continue
        inner = _parsed(path.parent / str(include.get("file", "")), seen)
        at = above.index(include)
        for offset, child in enumerate(list(inner)):
            above.insert(at + offset, child)
        above.remove(include)
    return root


def lint(root: Xml) -> Iterator[Finding]:
    """All that the text alone can show."""
    yield from _grammar(root)
    yield from _paths(root)
    yield from _ranges(root)
    yield from _classes(root)


def _line(element: Xml) -> str:
    return f"line {element.sourceline}"


def _grammar(root: Xml) -> Iterator[Finding]:
    for element in root.iter():
        tag = element.tag
        if not isinstance(tag, str):
            continue  # a comment
        for word in newer_words(tag, {str(k): str(v) for k, v in element.attrib.items()}):
            yield GRAMMAR(
                f"{_line(element)}: <{tag}>",
                f"MuJoCo {OLDEST} does not know `{word}`, so the file does not load there",
                hint=f"mjlab pins {OLDEST}: say it in older words, or leave it out",
            )


def _paths(root: Xml) -> Iterator[Finding]:
    folders = [(c, name) for c in root.iter("compiler") for name in ("meshdir", "texturedir", "assetdir")]  # fmt: skip # noqa: E501
    for element, name in [*folders, *((e, n) for e in root.iter() for n in FILES)]:
        value = element.get(name) if isinstance(element.tag, str) else None
        if value and (PurePosixPath(value).is_absolute() or PureWindowsPath(value).drive):
            yield ABSOLUTE_PATH(
                f"{_line(element)}: <{element.tag}>",
                f"`{value}` exists on one machine only",
                hint="give the path from the file's own folder",
            )


def _ranges(root: Xml) -> Iterator[Finding]:
    for element in root.iter():
        for name in RANGES:
            numbers = _numbers(element.get(name)) if isinstance(element.tag, str) else ()
            if len(numbers) == 2 and numbers[0] >= numbers[1] and any(numbers):
                yield RANGE(
                    f"{_line(element)}: <{element.tag}>",
                    f"{name} {numbers[0]:g} to {numbers[1]:g}: the low end is not below the high",
                    hint="swap them",
                    data={"low": numbers[0], "high": numbers[1]},
                )


def _numbers(text: str | None) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in (text or "").split())
    except ValueError:
        return ()


# --- classes --------------------------------------------------------------------------------


def _classes(root: Xml) -> Iterator[Finding]:
    """A drive whose class is meant for another joint: the class gives joints another range."""
    above = {d.get("class"): d for d in root.iter("default") if d.get("class")}
    joints = {j.get("name"): j for b in root.iter("worldbody") for j in b.iter("joint")}
    for section in root.findall("actuator"):
        for drive in section:
            if not isinstance(drive.tag, str):
                continue
            joint = joints.get(drive.get("joint"))
            own = drive.get("class")
            if joint is None or own not in above or joint.get("range"):
                continue
            theirs = _class_of(joint)
            mine = above[own]
            if theirs is None or theirs not in above or _related(mine, above[theirs]):
                continue
            of_drive, of_joint = _inherited(mine, "range"), _inherited(above[theirs], "range")
            if of_drive and of_joint and _numbers(of_drive) != _numbers(of_joint):
                yield FOREIGN_CLASS(
                    f"actuator {drive.get('name') or drive.get('joint')}",
                    f"{_line(drive)}: class `{own}` is for joints of range {of_drive}, but joint "
                    f"`{joint.get('name')}` has class `{theirs}` with {of_joint}",
                    hint=f'class="{theirs}" is probably meant',
                )


def _class_of(joint: Xml) -> str | None:
    if joint.get("class"):
        return str(joint.get("class"))
    for body in joint.iterancestors("body"):
        if body.get("childclass"):
            return str(body.get("childclass"))
    return None


def _related(a: Xml, b: Xml) -> bool:
    return a is b or a in list(b.iterancestors()) or b in list(a.iterancestors())


def _inherited(default: Xml, attribute: str) -> str | None:
    """What joints of a class get, from it or from the classes above."""
    for place in (default, *default.iterancestors("default")):
        joint = place.find("joint")
        if joint is not None and joint.get(attribute):
            return re.sub(r"\s+", " ", str(joint.get(attribute))).strip()
    return None
