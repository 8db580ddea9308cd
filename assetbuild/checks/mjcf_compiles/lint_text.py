"""What the text of an MJCF says that no compiled model shows any more."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from lxml import etree

from assetbuild.facts.mjcf_grammar import OLDEST, newer_words
from assetbuild.findings import Finding, Rule

Xml = etree._Element  # lxml's own name for the type
PATHS = frozenset({"file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback",
                   "meshdir", "texturedir", "assetdir"})  # fmt: skip
RANGES = frozenset({"ctrlrange", "forcerange", "actrange", "range", "actuatorfrcrange"})

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


def lint(path: Path) -> Iterator[Finding]:
    """All that the text alone can show. path: of a file that MuJoCo compiles."""
    import mujoco

    roots = list(_with_includes(path))
    for root in roots:
        for element in root.iter("*"):
            yield from _element(element)
    yield from _classes(roots, mujoco.MjSpec.from_file(str(path)))


def _with_includes(path: Path) -> Iterator[Xml]:
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
    root = etree.fromstring(path.read_bytes(), parser)
    yield root
    for include in root.iter("include"):
        inner = path.parent / str(include.get("file"))
        if inner.is_file():
            yield from _with_includes(inner)


def _element(element: Xml) -> Iterator[Finding]:
    said = {str(name): str(value) for name, value in element.attrib.items()}
    where = f"line {element.sourceline}: <{element.tag}>"
    for word in newer_words(str(element.tag), said):
        yield GRAMMAR(
            where,
            f"MuJoCo {OLDEST} does not know `{word}`, so the file does not load there",
            hint=f"mjlab pins {OLDEST}: say it in older words, or leave it out",
        )
    for name, value in said.items():
        if name in PATHS and (PurePosixPath(value).is_absolute() or PureWindowsPath(value).drive):
            yield ABSOLUTE_PATH(
                where,
                f"`{value}` exists on one machine only",
                hint="give the path from the file's own folder",
            )
        numbers = [float(word) for word in value.split()] if name in RANGES else []
        if len(numbers) == 2 and numbers[0] >= numbers[1] and any(numbers):
            low, high = numbers
            yield RANGE(
                where,
                f"{name} {low:g} to {high:g}: the low end is not below the high",
                hint="swap them",
                data={"low": low, "high": high},
            )


def _classes(roots: list[Xml], spec: Any) -> Iterator[Finding]:  # Any: MjSpec
    """A drive whose class is meant for another joint: the class gives joints another range."""
    nested = (child for root in roots for child in root.iterfind(".//default/default"))
    inside = {d.get("class"): [above.get("class") for above in d.iterancestors()] for d in nested}
    joints = {joint.name: joint for joint in spec.joints}
    for drive in spec.actuators:
        joint = joints.get(drive.target)
        if joint is None or not joint.classname or not drive.classname:
            continue
        mine, theirs = drive.classname.name, joint.classname.name
        of_drive, of_joint = (tuple(x.classname.joint.range) for x in (drive, joint))
        related = theirs in inside.get(mine, ()) or mine in inside.get(theirs, ())
        stated = tuple(joint.range) != of_joint
        if not (related or stated or of_drive == of_joint) and any(of_drive) and any(of_joint):
            yield FOREIGN_CLASS(
                f"actuator {drive.name or drive.target}",
                f"class `{mine}` is for joints of range {_shown(of_drive)}, but joint "
                f"`{joint.name}` has class `{theirs}` with {_shown(of_joint)}",
                hint=f'class="{theirs}" is probably meant',
            )


def _shown(ends: tuple[float, ...]) -> str:
    return " ".join(f"{end:g}" for end in ends)
