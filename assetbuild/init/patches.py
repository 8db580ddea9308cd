"""Patches of a URDF's text: how they are applied, and those for what a build refuses to read."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace

from assetbuild.init.source import UrdfSource
from assetbuild.recipe.source import Patch
from assetbuild.source.urdf.joints import KINDS
from assetbuild.source.urdf.xml import Node, parse
from assetbuild.xml_text import number_words

NO_LIMIT = (
    "it states no <limit>, which urdfdom and PyBullet refuse; MuJoCo and Isaac Sim let it turn "
    "without end: give it a range where it has one"
)
FOUR = (
    "four numbers where three are meant: PyBullet and yourdfpy read the first three, urdfdom and "
    "MuJoCo refuse them"
)
SPELLED = "readers know this type in small letters alone"


def patched(source: UrdfSource, patches: Iterable[Patch | None]) -> UrdfSource:
    """The source behind the patches; only a URDF says its names in its own text."""
    made = tuple(patch for patch in patches if patch is not None)
    data = source.data
    for patch in made:
        data = data.replace(str(patch.find).encode(), str(patch.replace).encode())
    return replace(source, data=data, patches=source.patches + made)


def shortened(source: UrdfSource) -> Iterator[Patch | None]:
    """A patch for each place or turn of four numbers, which is read by its first three."""
    if source.key != "urdf":
        return
    text = source.data.decode("utf-8", "replace")
    stated = {
        (key, element.get(key) or "")
        for element in parse(source.data, source.shown).element.iter("origin")
        for key in ("xyz", "rpy")
    }
    for key, value in sorted(stated):
        words = number_words(value, 3)
        for mark in "\"'":
            find = f"{key}={mark}{value}{mark}"
            if len(words) == 4 and find in text:
                three = f"{key}={mark}{' '.join(words[:3])}{mark}"
                count = text.count(find)
                yield Patch(file=source.file, find=find, replace=three, times=count, because=FOUR)


def retyped(source: UrdfSource) -> Iterator[Patch | None]:
    """A patch for each joint whose type no build takes as it stands; none of a xacro."""
    if source.key != "urdf":
        return
    for joint in parse(source.data, source.shown).all("joint"):
        kind = joint.get("type") or ""
        if kind == "revolute" and joint.only("limit") is None:
            yield _of_type(source, joint, "continuous", NO_LIMIT)
        elif kind not in KINDS and kind.strip().lower() in KINDS:
            yield _of_type(source, joint, kind.strip().lower(), SPELLED)


def _of_type(source: UrdfSource, joint: Node, kind: str, because: str) -> Patch | None:
    """A patch of the joint's start tag; None where the text has no such tag, or several."""
    text, name = source.data.decode("utf-8", "replace"), re.escape(joint.get("name") or "")
    tag = rf"<joint\b(?=[^<>]*\sname\s*=\s*[\"']{name}[\"'])[^<>]*\stype\s*=\s*[\"'][^<>\"']*[\"']"
    found = re.findall(tag, text)
    if len(found) != 1 or text.count(found[0]) != 1:
        return None
    find = found[0]
    return Patch(
        file=source.file,
        find=find,
        replace=re.sub(r"(\stype\s*=\s*)([\"'])[^\"']*\2", rf"\g<1>\g<2>{kind}\g<2>", find),
        because=because,
    )
