"""Words of MJCF that MuJoCo 3.11 does not know: the difference of `mj_printSchema` to 4.0.

mjlab 1.6 pins 3.11, so a file with one of these does not train there.
"""

from __future__ import annotations

from collections.abc import Mapping

OLDEST = "3.11"
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
