"""Joints that a compiled MuJoCo model couples linearly, and the lever of a tendon over them.

An actuator on a fixed tendon of length c1 q1 + c2 q2 pulls each joint with c f. Where an equality
holds q2 = m q1, the virtual work of both is that of one drive of q1 with the gear c1 + c2 m. So a
gripper whose fingers mirror each other has one drive on the finger that leads.
"""

from __future__ import annotations

from assetbuild.simulators.mujoco import Model, turning

CLOSE = 1e-12
"""Length at which a tendon counts from the leader's 0, m or rad."""


def tendon_lever(model: Model, actuator: int) -> tuple[int, float] | None:
    """(the joint, its gear) that an actuator on a fixed tendon drives in effect; None without one.

    None, too, where the tendon or one of its joints limits the force, which acts on each alone.
    """
    import mujoco

    tendon = int(model.actuator_trnid[actuator, 0])
    if int(model.actuator_trntype[actuator]) != int(mujoco.mjtTrn.mjTRN_TENDON):
        return None
    if model.tendon_actfrclimited[tendon]:
        return None
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    leaders, lever, start = set(), 0.0, 0.0
    for wrap in range(first, first + count):
        joint, coefficient = int(model.wrap_objid[wrap]), float(model.wrap_prm[wrap])
        is_joint = int(model.wrap_type[wrap]) == int(mujoco.mjtWrap.mjWRAP_JOINT)
        if not is_joint or model.jnt_actfrclimited[joint]:
            return None
        leader, multiplier, offset = _led(model, joint)
        leaders.add(leader)
        lever += coefficient * multiplier
        start += coefficient * offset
    if len(leaders) != 1 or lever == 0.0 or abs(start) > CLOSE:
        return None
    (leader,) = leaders
    return (leader, lever * float(model.actuator_gear[actuator, 0])) if leader >= 0 else None


def _led(model: Model, joint: int) -> tuple[int, float, float]:
    """(leader, m, b) with q = m q(leader) + b, along all couplings; (-1, 0, 0) without a leader."""
    multiplier, offset = 1.0, 0.0
    for _ in range(model.njnt):
        if joint not in turning(model):
            break
        equality = _coupling(model, joint)
        if equality is None:
            return joint, multiplier, offset
        leader, (c0, c1, *more) = int(model.eq_obj2id[equality]), model.eq_data[equality][:5]
        if leader < 0 or any(more) or c1 == 0.0:
            break
        at, to = (float(model.qpos0[int(model.jnt_qposadr[j])]) for j in (joint, leader))
        offset += multiplier * (at + float(c0) - float(c1) * to)
        multiplier, joint = multiplier * float(c1), leader
    return -1, 0.0, 0.0


def _coupling(model: Model, joint: int) -> int | None:
    """The first equality that makes a joint follow another or holds it."""
    import mujoco

    for equality in range(model.neq):
        couples = int(model.eq_type[equality]) == int(mujoco.mjtEq.mjEQ_JOINT)
        if couples and model.eq_active0[equality] and int(model.eq_obj1id[equality]) == joint:
            return equality
    return None
