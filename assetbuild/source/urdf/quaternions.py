"""Versions of URDF, and rotations that a file states as quaternions (URDF 1.1)."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from assetbuild.findings import Data, Rule
from assetbuild.robot.pose import quat_of_rpy
from assetbuild.source.urdf.xml import Node

VERSION = Rule(
    "urdf.version",
    "warning",
    "the stated version of URDF does not exist (1.0, 1.1 and 1.2 do)",
    "urdfdom refuses it: state the version that the file follows",
)
QUATERNION = Rule(
    "urdf.quaternion",
    "info",
    "rotations are stated as `quat_xyzw` (URDF 1.1), which urdfdom reads since version 5 and "
    "MuJoCo, PyBullet and yourdfpy do not",
    "MuJoCo, PyBullet and yourdfpy do not read it: use the built URDF there",
)
QUATERNION_NORM = Rule(
    "urdf.quaternion.normalised", "info", "a quaternion did not have length 1", "write a unit one"
)

SAME = 1e-6
"""rad: rotations this close are one."""
NORM = 1e-6
"""A quaternion whose length is off by more is reported."""

Taken = tuple[str, Data]
"""What was wrong and how it is taken; data of the finding besides the line."""
Version = tuple[int, int]


def _version_of(node: Node) -> Version:
    """What <robot> states, tidy."""
    stated = node.element.getroottree().getroot().get("version")
    match = re.fullmatch(r"\s*(\d{1,4})\.(\d{1,4})\s*", stated or "", re.ASCII)
    return (int(match[1]), int(match[2])) if match else (1, 0)


def tidy_version(root: Node) -> Iterator[Taken]:
    """The nearest version that exists."""
    version, stated = _version_of(root), root.get("version")
    taken = min(max(version, (1, 0)), (1, 2))
    known = stated is None or (version == taken and "." in stated)
    if not known:
        text = f"{taken[0]}.{taken[1]}"
        root.element.set("version", text)
        yield f"version `{stated}` of URDF does not exist: read as {text}", {"version": stated}


def tidy_quaternion(origin: Node) -> Iterator[Taken]:
    """Leave `quat_xyzw` where it is the rotation, and nowhere else."""
    if origin.get("quat_xyzw") is None:
        return
    if _is_rotation(origin):
        yield f'quat_xyzw="{origin.get("quat_xyzw")}"', {}
    else:
        del origin.element.attrib["quat_xyzw"]


def _is_rotation(origin: Node) -> bool:
    """Whether the quaternion counts; False where it says the same as `rpy`."""
    x, y, z, w = origin.numbers("quat_xyzw", 4)
    norm = math.hypot(x, y, z, w)
    if norm < 1e-9:
        raise origin.error(
            f"quat_xyzw is `{origin.get('quat_xyzw')}`: it is no rotation",
            "write `0 0 0 1` for none, or the quaternion that is meant",
        )
    other = quat_of_rpy(*origin.numbers("rpy", 3, (0.0, 0.0, 0.0)))
    cosine = abs(math.fsum(p * q / norm for p, q in zip((w, x, y, z), other, strict=True)))
    same = 2.0 * math.acos(min(1.0, cosine)) <= SAME
    beside, early = origin.get("rpy") is not None, _version_of(origin) < (1, 1)
    if same and (beside or early):
        return False
    if early:
        raise origin.error(
            "`quat_xyzw` needs URDF 1.1, and the file states no such version",
            'write `version="1.1"` at <robot> to turn it by the quaternion, or remove '
            "`quat_xyzw`: urdfdom, MuJoCo, PyBullet and yourdfpy ignore it as it stands",
        )
    if beside:
        raise origin.error(
            "both `rpy` and `quat_xyzw` are given, and they differ",
            "remove one of the two: urdfdom refuses the file, MuJoCo, PyBullet and yourdfpy "
            "read `rpy`",
        )
    return True


def of_other_length(origin: Node) -> Iterator[Taken]:
    """A quaternion is normalised by whoever reads it."""
    if origin.get("quat_xyzw") is not None:
        norm = math.hypot(*origin.numbers("quat_xyzw", 4))
        if abs(norm - 1.0) > NORM:
            stated = f"quat_xyzw `{origin.get('quat_xyzw')}`"
            yield f"{stated} has length {norm:.6g} and was normalised", {"norm": norm}
