"""Joints that a compiled MuJoCo model couples linearly, and the lever of a tendon over them.

An actuator on a fixed tendon of length c1 q1 + c2 q2 pulls each joint with c f. Where an equality
holds q2 = m q1, the virtual work of both is that of one drive of q1 with the gear c1 + c2 m. So a
gripper whose fingers mirror each other has one drive on the finger that leads.
"""

from __future__ import annotations

import numpy as np

from assetbuild.simulators.mujoco import Model, mj, turns

CLOSE = 1e-12
"""Length at which a tendon counts from the leader's 0, m or rad."""


def tendon_lever(model: Model, actuator: int) -> tuple[int, float] | None:
    """(the joint, its gear) that an actuator on a fixed tendon drives in effect; None without one.

    None, too, where the tendon or one of its joints limits the force, which acts on each alone.
    """
    tendon = int(model.actuator_trnid[actuator, 0])
    if int(model.actuator_trntype[actuator]) != int(mj.mjtTrn.mjTRN_TENDON):
        return None
    if model.tendon_actfrclimited[tendon]:
        return None
    leaders, lever, start = set(), 0.0, 0.0
    for joint, coefficient in joints_over(model, tendon).items():
        if model.jnt_actfrclimited[joint]:
            return None
        leader, multiplier, offset = _led(model, joint)
        leaders.add(leader)
        lever += coefficient * multiplier
        start += coefficient * offset
    if len(leaders) != 1 or lever == 0.0 or abs(start) > CLOSE:
        return None
    (leader,) = leaders
    return (leader, lever * float(model.actuator_gear[actuator, 0])) if leader >= 0 else None


def tendon_coupling(model: Model, equality: int) -> tuple[int, int, float, float] | None:
    """(follower, leader, m, b) of an equality of fixed tendons that is q1 = m q2 + b, from qpos0.

    None unless the equality of the two joints is the same constraint to MuJoCo, which weighs its
    softness by the tendons' inertias: each coefficient is 1 or -1, and these are the joints' own.
    Of one tendon over two joints, one that an actuator drives leads.
    """
    is_tendon = int(model.eq_type[equality]) == int(mj.mjtEq.mjEQ_TENDON)
    if not is_tendon or not model.eq_active0[equality]:
        return None
    tendons = [int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])]
    c0, c1, *more = (float(c) for c in model.eq_data[equality][:5])
    if tendons[1] < 0:
        tendons, c1 = tendons[:1], 0.0
    over = [joints_over(model, tendon) for tendon in tendons]
    joints = [joint for each in over for joint in each]
    ones = all(abs(c) == 1.0 for each in over for c in each.values())
    if any(more) or len(set(joints)) != 2 or len(joints) != 2 or not ones:
        return None
    if len(over) == 2 and (len(over[0]) != 1 or c1 == 0.0):
        return None
    weight = sum(float(model.tendon_invweight0[tendon]) for tendon in tendons)
    joint_weight = sum(float(model.dof_invweight0[int(model.jnt_dofadr[j])]) for j in joints)
    if abs(weight - joint_weight) > CLOSE * joint_weight:
        return None
    one, two = (c for each in over for c in each.values())
    if len(over) == 2:
        return joints[0], joints[1], c1 * two / one, c0 / one
    of_joints = np.asarray(model.actuator_trntype) == int(mj.mjtTrn.mjTRN_JOINT)
    driven = set(np.asarray(model.actuator_trnid)[of_joints, 0].tolist())
    if joints[0] in driven and joints[1] not in driven:
        return joints[1], joints[0], -one / two, c0 / two
    return joints[0], joints[1], -two / one, c0 / one


def joints_over(model: Model, tendon: int) -> dict[int, float]:
    """Coefficient by joint of a fixed tendon; nothing of a spatial one."""
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    coefficients: dict[int, float] = {}
    for wrap in range(first, first + count):
        if int(model.wrap_type[wrap]) != int(mj.mjtWrap.mjWRAP_JOINT):
            return {}
        joint = int(model.wrap_objid[wrap])
        coefficients[joint] = coefficients.get(joint, 0.0) + float(model.wrap_prm[wrap])
    return coefficients


def _led(model: Model, joint: int) -> tuple[int, float, float]:
    """(leader, m, b) with q = m q(leader) + b, along all couplings; (-1, 0, 0) without a leader."""
    multiplier, offset = 1.0, 0.0
    for _ in range(model.njnt):
        if not turns(model, joint):
            break
        coupled = _coupling(model, joint)
        if coupled is None:
            return joint, multiplier, offset
        leader, c1, c0 = coupled
        if leader < 0 or c1 == 0.0:
            break
        at, to = (float(model.qpos0[int(model.jnt_qposadr[j])]) for j in (joint, leader))
        offset += multiplier * (at + c0 - c1 * to)
        multiplier, joint = multiplier * c1, leader
    return -1, 0.0, 0.0


def _coupling(model: Model, joint: int) -> tuple[int, float, float] | None:
    """(leader, m, b) of the first equality by which a joint follows another, from qpos0.

    The leader is -1 where the equality holds the joint, or is not linear.
    """
    for equality in range(model.neq):
        follower, leader = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
        if coupled := tendon_coupling(model, equality):
            if coupled[0] == joint:
                return coupled[1:]
            continue
        couples = int(model.eq_type[equality]) == int(mj.mjtEq.mjEQ_JOINT)
        if couples and model.eq_active0[equality] and follower == joint:
            c0, c1, *more = (float(c) for c in model.eq_data[equality][:5])
            return (-1 if any(more) else leader), c1, c0
    return None
