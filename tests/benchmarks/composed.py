"""B1 and Z1, composed from their two URDFs, beside the b1-z1.urdf that somebody merged by hand.

    assetbuild build recipes/b1.yaml --variant z1
    python -m tests.benchmarks.composed build/b1_with_z1 B1_Z1_URDF [POSES]

B1_Z1_URDF: of the package example-robot-data. Pinocchio reads both URDFs; ours has the prefix
`arm_` on the arm's names. Prints the largest differences of the masses of bodies, of the poses of
all links, and of the mass matrix, at random poses within the limits.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

PREFIX = "arm_"


def main(bundle: str, by_hand: str, poses: str = "100") -> None:
    """Reads `<bundle>/urdf/*.urdf`."""
    import pinocchio as pin

    (written,) = (Path(bundle) / "urdf").glob("*.urdf")
    ours, theirs = (
        pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer()) for path in (written, by_hand)
    )
    partner = [theirs.getJointId(name.removeprefix(PREFIX)) for name in ours.names]
    joints = [(joint, partner[i]) for i, joint in enumerate(ours.joints) if i]
    order = np.concatenate([theirs.joints[j].idx_v + np.arange(mine.nv) for mine, j in joints])
    bodies = [
        abs(ours.inertias[i].mass - theirs.inertias[j].mass) for i, j in enumerate(partner) if i
    ]
    body = pin.FrameType.BODY
    links = [
        (ours.getFrameId(name, body), theirs.getFrameId(name.removeprefix(PREFIX), body))
        for name in (frame.name for frame in ours.frames if frame.type == body)
        if theirs.existFrame(name.removeprefix(PREFIX), body)
    ]
    mine, other = ours.createData(), theirs.createData()
    apart, mass = [], []
    for seed in range(int(poses)):
        pin.seed(seed)
        q_theirs = pin.randomConfiguration(theirs, *limits(theirs))
        q_ours = np.concatenate([q_theirs[:7], q_theirs[7:][order[6:] - 6]])
        pin.framesForwardKinematics(ours, mine, q_ours)
        pin.framesForwardKinematics(theirs, other, q_theirs)
        for a, b in links:
            apart.append(np.abs(mine.oMf[a].homogeneous - other.oMf[b].homogeneous).max())
        M_ours = symmetric(pin.crba(ours, mine, q_ours))
        M_theirs = symmetric(pin.crba(theirs, other, q_theirs))[np.ix_(order, order)]
        mass.append(np.abs(M_ours - M_theirs).max() / np.abs(M_theirs).max())
    total = abs(pin.computeTotalMass(ours) - pin.computeTotalMass(theirs))
    print(
        f"{len(joints) - 1} joints, {len(links)} links, {poses} poses: total mass {total:.1e} kg, "
        f"bodies {max(bodies):.1e} kg, poses {max(apart):.1e}, mass matrix {max(mass):.1e}"
    )


def limits(model: object) -> tuple[np.ndarray, np.ndarray]:
    """Of the configuration, the base within a metre."""
    lower = np.array(model.lowerPositionLimit)  # type: ignore[attr-defined] # pinocchio has no types
    upper = np.array(model.upperPositionLimit)  # type: ignore[attr-defined]
    lower[:3], upper[:3] = -1.0, 1.0
    return lower, upper


def symmetric(upper: np.ndarray) -> np.ndarray:
    """crba fills one triangle."""
    return np.triu(upper) + np.triu(upper, 1).T


if __name__ == "__main__":
    main(*sys.argv[1:])
