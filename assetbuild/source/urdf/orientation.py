"""The version that a URDF states, and rotations as quaternions, which came with version 1.1."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from assetbuild.findings import Finding, Rule
from assetbuild.robot.pose import quat_of_rpy
from assetbuild.source.urdf.xml import Node, Problems

VERSION = Rule(
    "urdf.version",
    "warning",
    "the stated version of URDF does not exist (1.0, 1.1 and 1.2 do), or an element needs a later "
    "one than is stated",
    "state the version that the file follows",
)
QUATERNION = Rule(
    "urdf.quaternion",
    "info",
    "rotations are stated as `quat_xyzw` (URDF 1.1), which urdfdom reads since version 5 and "
    "MuJoCo, PyBullet and yourdfpy do not",
    "nothing; every target states them in its own form",
)
QUATERNION_NORM = Rule(
    "urdf.quaternion.normalised", "info", "a quaternion did not have length 1", "write a unit one"
)
SAME = 1e-6
"""rad: rotations this close are one."""
NORM = 1e-6
"""A quaternion whose length is off by more is reported."""

Version = tuple[int, int]


def tidy_orientation(root: Node, problems: Problems) -> list[Finding]:
    """Leave `quat_xyzw` where it is the rotation, and nowhere else."""
    version, findings = _version(root)
    findings += _needs_later(root, version)
    used: list[Node] = []
    for joint_or_link in (*root.all("joint"), *root.all("link")):
        subject = f"{joint_or_link.tag} {joint_or_link.get('name')}"
        for element in joint_or_link.element.iter("origin"):
            origin = Node(element, root.file, subject)
            if origin.get("quat_xyzw") is None:
                continue
            counts = False
            with problems.kept():
                counts = _is_rotation(origin, version)
            if counts:
                used.append(origin)
                findings += _of_other_length(origin)
            else:
                del element.attrib["quat_xyzw"]
    if used:
        times = f"{len(used)} origins are" if len(used) > 1 else "one origin is"
        message = f"{times} turned by `quat_xyzw` (first on line {used[0].line})"
        hint = "MuJoCo, PyBullet and yourdfpy do not read it: use the built URDF there"
        data = {"count": len(used), "line": used[0].line}
        findings.append(QUATERNION("robot", message, hint, data=data))
    return findings


def _version(root: Node) -> tuple[Version, list[Finding]]:
    stated = root.get("version")
    if stated is None:
        return (1, 0), []
    found = re.fullmatch(r"\s*(\d{1,4})\.(\d{1,4})\s*", stated, re.ASCII)
    version = (int(found[1]), int(found[2])) if found else (1, 0)
    if found and (1, 0) <= version <= (1, 2):
        return version, []
    version = min(max(version, (1, 0)), (1, 2))
    taken = f"{version[0]}.{version[1]}"
    message = f"version `{stated}` of URDF does not exist: read as {taken}"
    root.element.set("version", taken)
    hint = f'urdfdom refuses it: write `version="{taken}"`'
    return version, [VERSION("robot", message, hint, data={"version": stated, "line": root.line})]


def _needs_later(root: Node, version: Version) -> Iterator[Finding]:
    """A capsule is a capsule to all readers but urdfdom, which asks for the version."""
    capsule = next(root.element.iter("capsule"), None)
    if capsule is None or version >= (1, 1):
        return
    line = Node(capsule, root.file).line
    message = f"<capsule> on line {line} needs version 1.1, the file says {version[0]}.{version[1]}"
    hint = 'it is read; urdfdom leaves it out: write `version="1.1"` at <robot>'
    yield VERSION("robot", message, hint, data={"line": line})


def _is_rotation(origin: Node, version: Version) -> bool:
    """Whether the quaternion counts; False where it says the same as `rpy`."""
    x, y, z, w = origin.numbers("quat_xyzw", 4)
    norm = math.hypot(x, y, z, w)
    if norm < 1e-9:
        raise origin.error(
            f"quat_xyzw is `{origin.get('quat_xyzw')}`: it is no rotation",
            "write `0 0 0 1` for none, or the quaternion that is meant",
        )
    roll, pitch, yaw = origin.numbers("rpy", 3, (0.0, 0.0, 0.0))
    other = quat_of_rpy(roll, pitch, yaw)
    cosine = abs(math.fsum(p * q / norm for p, q in zip((w, x, y, z), other, strict=True)))
    if 2.0 * math.acos(min(1.0, cosine)) <= SAME and origin.get("rpy") is not None:
        return False
    if version >= (1, 1):
        if origin.get("rpy") is not None:
            raise origin.error(
                "both `rpy` and `quat_xyzw` are given, and they differ",
                "remove one of the two: urdfdom refuses the file, MuJoCo, PyBullet and yourdfpy "
                "read `rpy`",
            )
        return True
    if 2.0 * math.acos(min(1.0, cosine)) <= SAME:
        return False
    raise origin.error(
        "`quat_xyzw` needs URDF 1.1, and the file states no such version",
        'write `version="1.1"` at <robot> to turn it by the quaternion, or remove `quat_xyzw`: '
        "urdfdom, MuJoCo, PyBullet and yourdfpy ignore it as it stands",
    )


def _of_other_length(origin: Node) -> Iterator[Finding]:
    norm = math.hypot(*origin.numbers("quat_xyzw", 4))
    if abs(norm - 1.0) > NORM:
        message = f"quat_xyzw `{origin.get('quat_xyzw')}` has length {norm:.6g} and was normalised"
        data = {"norm": norm, "line": origin.line}
        yield QUATERNION_NORM(origin.subject, message, "write a unit quaternion", data=data)
