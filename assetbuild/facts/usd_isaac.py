"""Isaac Sim's robot schema: which prims are the robot's links, sites and joints, in which order.

Isaac Sim's tools list a robot by these relationships; PhysX and Newton do not read them.
"""

from __future__ import annotations

from collections.abc import Mapping

from assetbuild.facts.table import Writer
from assetbuild.facts.usd_prims import Prim
from assetbuild.robot.model import Tree

ROOT_JOINT = "root_joint"


def read_schema(robot: Prim, names: Mapping[str, str], book: Writer) -> None:
    """Note the names that the robot's prim lists. names: of bodies, frames and joints, by path."""
    for word in ("Links", "Joints"):
        listed = robot.targets(f"isaac:physics:robot{word}", "IsaacRobotAPI")
        stated = tuple(names.get(path, path.rpartition("/")[2]) for path in listed)
        book.put("robot", "", {f"usd:isaac {word.lower()}": stated})


def expected_schema(tree: Tree, book: Writer) -> None:
    """Each body is followed by its frames; what holds a fixed base comes before the joints."""
    links: list[str] = []
    for body in tree.bodies:
        links += [body.name, *(frame.name for frame in tree.frames if frame.body == body.name)]
    held = [ROOT_JOINT] if tree.base == "fixed" else []
    book.put("robot", "", {
        "usd:isaac links": tuple(links),
        "usd:isaac joints": (*held, *(joint.name for joint in tree.joints)),
    })  # fmt: skip
