"""What USD runtimes call the parts of a robot: identifiers of ASCII letters, digits and `_`."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable

from assetbuild.robot.model import Camera, Loop, Tree

JOINTS, LOOKS, PHYSICS_MATERIALS = "Joints", "Looks", "PhysicsMaterials"
ACTUATORS, LOOPS = "Actuators", "Loops"
"""Groups beside the bodies, below the robot."""
SHAPES = ("visuals", "collisions")
"""Groups of shapes below a body."""
POSES = "NamedPoses"
"""Keyframes, as Isaac Sim's robot schema has them."""
SCENE = ("physics", "floor", "light", PHYSICS_MATERIALS)
"""Prims beside the robot in `scene.usda`."""
METADATA = "SimReady_Metadata"
"""The dictionary of the root layer's custom data that libraries of assets read."""
NO_DATE = "not recorded: a build on another day gives the same bytes"
ROBOT_QCODE = "Q11012"
"""Wikidata's number for `robot`."""
ROOT_JOINT = "root_joint"
"""Holds a fixed base to the world."""

_GROUPS = (JOINTS, LOOKS, PHYSICS_MATERIALS, LOOPS, ACTUATORS, POSES)
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def usd_identifier(name: str) -> str:
    """`name` itself when it is an ASCII identifier of USD, else the nearest one.

    Letters beyond ASCII have no near one: eight hex digits of the name's SHA-256 stand for them.
    """
    if _IDENTIFIER.fullmatch(name):
        return name
    near = re.sub(r"[^A-Za-z0-9_]", "_", name)
    if not name.isascii():
        near = _with_digest(near.strip("_") or "name", name)
    return near if _IDENTIFIER.fullmatch(near) else f"_{near}"


def usd_identifiers(names: Iterable[str], taken: Iterable[str] = ()) -> dict[str, str]:
    """A different identifier for each of `names`, none of them in `taken`.

    A name that is an identifier keeps itself. Where two would meet, the changed one carries a
    digest of its own name, so that no name depends on the order or on a neighbour's absence.
    """
    wanted = {name: usd_identifier(name) for name in names}
    reserved = set(taken)
    kept = {name for name, near in wanted.items() if name == near and name not in reserved}
    changed = [name for name in wanted if name not in kept]
    nears = [wanted[name] for name in changed]
    clash = reserved | kept | {near for near in nears if nears.count(near) > 1}
    for name in changed:
        if wanted[name] in clash:
            wanted[name] = _with_digest(wanted[name], name)
    return wanted


def _with_digest(near: str, name: str) -> str:
    return f"{near}_{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def scene_identifier(robot: str) -> str:
    """Return the name of the robot's prim in `scene.usda`, which no other prim there has."""
    root = usd_identifier(robot)
    return usd_identifiers([root], SCENE)[root]


def body_identifiers(tree: Tree) -> dict[str, str]:
    """Prim name by body name."""
    return usd_identifiers(tree.by_body, _GROUPS)


def loop_identifiers(loops: Iterable[Loop]) -> dict[str, str]:
    """Prim name by the name of a loop."""
    return usd_identifiers(loop.name for loop in loops)


def frame_identifiers(tree: Tree) -> dict[str, str]:
    """Prim name by the name of a merged link, beside the groups of shapes of its body."""
    return usd_identifiers((frame.name for frame in tree.frames), SHAPES)


def camera_identifiers(tree: Tree, cameras: Iterable[Camera]) -> dict[str, str]:
    """Prim name by the name of a camera; it stands among frames, or in the world among bodies."""
    parts = (*body_identifiers(tree).values(), *frame_identifiers(tree).values())
    return usd_identifiers((camera.name for camera in cameras), (*_GROUPS, *SHAPES, *parts))


def joint_identifiers(tree: Tree) -> dict[str, str]:
    """Prim name by joint name: what a training framework matches its patterns against."""
    return usd_identifiers(tree.by_joint, (ROOT_JOINT,))
