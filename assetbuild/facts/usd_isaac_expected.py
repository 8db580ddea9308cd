"""What a USD must say in the words of Isaac Sim's robot schema."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Writer
from assetbuild.robot.model import Control
from assetbuild.simulators.usd_names import (
    ROOT_JOINT,
    body_identifiers,
    joint_identifiers,
    usd_identifiers,
)
from assetbuild.simulators.usd_options import UsdOptions

ROBOT, LINK, SITE, JOINT = "IsaacRobotAPI", "IsaacLinkAPI", "IsaacSiteAPI", "IsaacJointAPI"
POSE = "IsaacNamedPose"


def expected_schema(reference: Reference, options: UsdOptions, book: Writer) -> None:
    """The robot in its own order: each body with its frames, what holds the base first."""
    tree, control = reference.tree, reference.control
    links = [
        name
        for body in tree.bodies
        for name in (body.name, *(f.name for f in tree.frames if f.body == body.name))
    ]
    held = [ROOT_JOINT] if tree.base == "fixed" else []
    book.put("stage", "", {
        "usd:robot type": options.robot_type or "Default",
        "usd:robot links": tuple(links),
        "usd:robot joints": (*held, *tree.by_joint),
        "usd:robot poses": tuple(key.name for key in control.keyframes),
    })  # fmt: skip
    for key in control.keyframes:
        for joint, value in key.joints:
            book.put("joint", joint, {f"usd:pose {key.name}": value})


def overrides(reference: Reference, top: str, joints: str) -> Iterator[tuple[str, str, str]]:
    """(path, word, name) of every prim whose identifier is not the robot's name for it."""
    bodies, jointed = body_identifiers(reference.tree), joint_identifiers(reference.tree)
    for word, scope, table in (("nameOverride", top, bodies), ("NameOverride", joints, jointed)):
        for name, short in table.items():
            if name != short:
                yield f"{scope}/{short}", f"usd:isaac:{word}", name


def pose_prims(control: Control, scope: str) -> Iterator[tuple[str, str, Sequence[str]]]:
    """Path, type and schemas of the prims that hold the poses."""
    if control.keyframes:
        yield scope, "Scope", ()
    for short in usd_identifiers(key.name for key in control.keyframes).values():
        yield f"{scope}/{short}", POSE, ()
