"""Loops of a compiled MuJoCo model: what a `connect` or a `weld` holds together."""

from __future__ import annotations

from assetbuild.facts.mjcf_meshes import pose_of
from assetbuild.facts.table import Value
from assetbuild.simulators.mujoco import Model, name_of

LOOPS = {0: "connect", 1: "weld"}
"""Kinds of loops by MuJoCo's number of the equality's type."""


def loop_facts(model: Model, index: int) -> dict[str, Value]:
    """Of two sites, or of two bodies with an anchor in each, and of a weld their relative turn."""
    kind = LOOPS[int(model.eq_type[index])]
    data = tuple(float(v) for v in model.eq_data[index])
    by_site = int(model.eq_objtype[index]) == 6  # mjOBJ_SITE
    facts: dict[str, Value] = {"type": kind}
    anchors = (data[3:6], data[:3]) if kind == "weld" else (data[:3], data[3:6])
    turns = (data[6:10] if kind == "weld" else (1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    for side, which, anchor, turn in zip("ab", (1, 2), anchors, turns, strict=True):
        body = int(getattr(model, f"eq_obj{which}id")[index])
        if by_site:
            pose = pose_of(model.site_pos[body], model.site_quat[body])
            body = int(model.site_bodyid[body])
        else:
            pose = pose_of(anchor, turn)
        turned = pose.quat if kind == "weld" else (1.0, 0.0, 0.0, 0.0)
        facts |= {
            f"body {side}": (name_of(model, "body", body) if body else ""),
            f"end {side}": (*pose.xyz, *turned),
        }
    return facts | ({"torque scale": data[10]} if kind == "weld" else {})
