"""Equalities of an MJCF that are mimic joints: of two joints, or of fixed tendons over two."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from assetbuild.robot.model import Joint, Mimic
from assetbuild.simulators.mujoco.levers import tendon_coupling
from assetbuild.source.mjcf.compiled import Model


def coupling_of(
    tag: str, model: Model, index: int, said: Mapping[str, str]
) -> tuple[str, Mimic] | None:
    """(follower, mimic) of an equality; None of one that is no mimic.

    q1 = c0 + c1 q2, counted from the joints' `ref`, as the Robot counts.
    """
    if tag == "tendon" and (found := tendon_coupling(model, index)):
        follower, leader = (str(model.joint(joint).name) for joint in found[:2])
        return follower, Mimic(leader, *found[2:])
    c = [float(v) for v in model.eq_data[index][:5]]
    leader = said.get("joint2", "")
    if tag != "joint" or not leader or any(c[2:]) or c[1] == 0.0 or not model.eq_active0[index]:
        return None
    return said.get("joint1", ""), Mimic(leader, c[1], c[0])


def coupled(joints: Sequence[Joint], follower: str, mimic: Mimic) -> list[Joint] | None:
    """The joints with that mimic; None where it follows already, and of a circle."""
    by_name = {joint.name: joint for joint in joints}
    if not {follower, mimic.joint} <= by_name.keys() or by_name[follower].mimic:
        return None
    name = mimic.joint
    while (above := by_name[name].mimic) is not None:
        name = above.joint
        if name == follower:
            return None
    by_name[follower] = replace(by_name[follower], mimic=mimic)
    return list(by_name.values())
