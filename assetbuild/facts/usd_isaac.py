"""Isaac Sim's robot schema: which prims are the robot's links, sites and joints, in which order.

Isaac Sim's tools list a robot by these relationships; PhysX and Newton do not read them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from assetbuild.facts.table import Writer
from assetbuild.facts.usd_joints import JointPrim
from assetbuild.facts.usd_prims import Prim

SCHEMAS = frozenset({"IsaacLinkAPI", "IsaacSiteAPI", "IsaacJointAPI"})


def read_schema(robot: Prim, names: Mapping[str, str], book: Writer) -> None:
    """Note the names that the robot's prim lists. names: of bodies, frames and joints, by path."""
    stage = robot.prim.GetStage()
    for word in ("Links", "Joints"):
        listed = robot.targets(f"isaac:physics:robot{word}", "IsaacRobotAPI")
        found = [stage.GetPrimAtPath(path) for path in listed]
        stated = [_listed(Prim(prim), names) for prim in found if prim]
        book.put("robot", "", {f"usd:isaac {word.lower()}": tuple(stated)})


def read_poses(robot: Prim, joints: Sequence[JointPrim], book: Writer) -> None:
    """Note the keyframes that the robot's prim lists, in rad and m."""
    by_path = {joint.prim.path: joint for joint in joints}
    for path in robot.targets("isaac:robot:namedPoses", "IsaacRobotAPI"):
        pose = Prim(robot.prim.GetStage().GetPrimAtPath(path))
        posed = [by_path.get(each) for each in pose.targets("isaac:robot:pose:joints")]
        values = pose.numbers("isaac:robot:pose:jointValues") or ()
        for joint, value in zip(posed, values, strict=True):
            if joint is None:
                continue
            position = value * joint.units.length(joint.angular)
            book.put("keyframe", f"{pose.name}/{joint.prim.name}", {"position": position})


def _listed(prim: Prim, names: Mapping[str, str]) -> str:
    """The robot's name for it, as Isaac Sim finds it where the identifier is another."""
    name = names.get(prim.path, prim.prim.GetName())
    if not prim.applied & SCHEMAS:
        return f"{name} without its schema"
    stated = [prim.text(f"isaac:{word}") for word in ("nameOverride", "NameOverride")]
    called = next((each for each in stated if each), prim.prim.GetName())
    return name if called == name or prim.has("IsaacSiteAPI") else f"{name}, called {called}"
