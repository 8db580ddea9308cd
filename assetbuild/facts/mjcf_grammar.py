"""MuJoCo's schema of MJCF, and the words of it that 3.11 does not know: the difference to 4.0.

mjlab 1.6 pins 3.11, so a file with one of these does not train there. A source that has one is
refused unless the recipe says `mjcf: {grammar: 4.0}`.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping

Path = tuple[str, ...]
"""The tags from the root down to an element; what is in a body or the world is in `BODY`."""
BODY = "(world)body"
OLDEST, NEWEST = "3.11", "4.0"
NEWER_TAGS: frozenset[str] = frozenset({"pid"})
NEWER_ATTRIBUTES: Mapping[str, frozenset[str]] = {
    tag: frozenset(words.split())
    for tag, words in {
        "compiler": "passthrough savecanonical savecompiled",
        "elasticity": "section sectionsize shear yield",
        "fixed": "springyield",
        "flag": "ipc speculative",
        "flex": "nodecoord",
        "flexcomp": "mesh",
        "general": "ffrange inheritrange velrange",
        "geom": "castshadow",
        "insidesite": "enclosed",
        "joint": "springyield",
        "key": "plastic",
        "light": "softness",
        "model": "gravcomp",
        "site": "mesh",
        "spatial": "springyield",
        "tactile": "cutoff",
        "tendon": "actuatorfrclimited actuatorfrcrange armature springyield",
        "texture": "class embed",
    }.items()
}
NEWER_VALUES: Mapping[tuple[str, str], frozenset[str]] = {
    ("general", "input"): frozenset({"pos", "vel", "force", "pid"}),
    ("option", "integrator"): frozenset({"discrete"}),
}
"""Values of attributes that 3.11 has, but not with these."""
UNWRITTEN = frozenset({"compiler", "model", "texture", "key", "flex", "flexcomp", "elasticity"})
"""Elements of a source whose newer words are resolved, left out, or refused with the element."""


@functools.cache
def schema() -> tuple[tuple[Path, tuple[str, ...]], ...]:
    """(path of an element, its attributes) of MuJoCo's schema, in its order; from the library."""
    import mujoco

    elements: list[tuple[Path, list[str]]] = []
    above: list[str] = []
    for line in str(mujoco.mj_printSchema(False, False)).splitlines():
        head, words = line[:30].rstrip(), line[30:].split()
        if head.strip():
            depth = (len(head) - len(head.lstrip())) // 3
            above[depth:] = [head.split()[0]]
            elements.append((tuple(above), words))
        elif elements:
            elements[-1][1].extend(words)
    return tuple((path, tuple(words)) for path, words in elements)


def newer_words(tag: str, attributes: Mapping[str, str]) -> list[str]:
    """The words of an element that 3.11 does not know, sorted."""
    newer = [tag] if tag in NEWER_TAGS else []
    newer += [name for name in NEWER_ATTRIBUTES.get(tag, ()) if name in attributes]
    newer += [
        f'{name}="{attributes[name]}"'
        for (owner, name), values in NEWER_VALUES.items()
        if owner == tag and attributes.get(name) in values
    ]
    return sorted(newer)


def newer_words_of(text: bytes | str) -> tuple[str, ...]:
    """Those of a whole MJCF that its reader keeps."""
    from defusedxml.ElementTree import fromstring

    elements = [e for e in fromstring(text).iter() if e.tag not in UNWRITTEN]
    return tuple(dict.fromkeys(w for e in elements for w in newer_words(e.tag, e.attrib)))
