"""The springs of joint limits as MuJoCo has them, for engines that ask for their numbers.

MuJoCo states how soft a limit is by a time constant and a damping ratio, (0.02 s, 1) unless a model
says otherwise, and scales the force by the inertia that the joint accelerates. At its impedance d a
limit acts as a spring k = I / ((1 - d) t^2 z^2) with the damping c = 2 I / ((1 - d) t).
Source: MuJoCo, Computation, "Solver parameters"; Newton 1.8 inverts it with the same d.
"""

from __future__ import annotations

import math

from assetbuild.robot.dynamics import dynamics
from assetbuild.robot.model import Control, Tree

TIME_S, RATIO, IMPEDANCE = 0.02, 1.0, 0.95
"""MuJoCo's defaults: `solreflimit`, and the second number of `solimplimit`."""


def limit_springs(tree: Tree, control: Control) -> dict[str, tuple[float, float]]:
    """Return the stiffness and damping of the limits of each moving joint at q = 0.

    N m/rad and N m s/rad, or N/m and N s/m. A joint that moves no mass has none. Of a robot with
    loops, too, MuJoCo scales by the inertia of its tree (`dof_invweight0` knows no equality).
    """
    armature = {row.joint: row.armature for row in control.actuators}
    inertia = dynamics(tree, {}, armature).effective_inertia
    springs = {}
    for joint in tree.moving_joints:
        moved, leader = 1.0, joint
        while leader.mimic is not None:  # a follower moves what its leader does, geared
            moved, leader = moved * leader.mimic.multiplier**2, tree.by_joint[leader.mimic.joint]
        reflected = inertia[leader.name] / moved if moved else math.inf
        if 0.0 < reflected < math.inf:
            softness = reflected / (1.0 - IMPEDANCE)
            springs[joint.name] = (softness / (TIME_S * RATIO) ** 2, 2.0 * softness / TIME_S)
    return springs
