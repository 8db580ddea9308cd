"""What of the control data other steps read: poses for pictures, ratings and loops for the URDF."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding, Rule
from assetbuild.robot.closure import RANK, constraint_jacobian, poses_along
from assetbuild.robot.codec import encode
from assetbuild.robot.dynamics import motions
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.loops import by_constraint, joints_of
from assetbuild.robot.mimic import leading
from assetbuild.robot.model import Actuator, Contact, Control, Joint, Loop, LoopMimic, Mimic, Tree


class KeepPose(Step):
    """`control.json` -> `control.json` without gains, friction, sensors and time.

    Its bytes stay the same when only those change, so that no picture is made anew.
    """

    shares = True
    own_name = "keep_pose"
    outputs = ("control.json",)

    def run(self, files: Files) -> Iterable[Finding]:
        """Keyframes, excludes and the contact masks are kept."""
        control = RobotFiles(files.inputs).control
        kept = Control(
            keyframes=control.keyframes,
            excludes=control.excludes,
            contact=_masks(control.contact),
            contacts=tuple((name, _masks(contact)) for name, contact in control.contacts),
        )
        (files.outputs / "control.json").write_bytes(encode(kept))
        return ()


def _masks(contact: Contact) -> Contact:
    return Contact(contype=contact.contype, conaffinity=contact.conaffinity)


RATINGS = ("damping", "friction", "effort", "velocity")
LOOP_MIMIC = Rule(
    "loop.mimic",
    "error",
    "a loop with `urdf: mimic` does not follow one driven joint, so no mimic joints stand for it",
    "leave `urdf: mimic` out: the URDF then leaves the loop open",
)


class KeepRatings(Step):
    """`control.json`, `tree.json` -> `ratings.json`: the ratings of the joints and the loops alone.

    Its bytes stay the same when a gain changes, so that no URDF is written and read back anew.
    """

    shares = True
    own_name = "keep_ratings"
    outputs = ("ratings.json",)

    def run(self, files: Files) -> Iterator[Finding]:
        """Keep only `RATINGS` of the actuators."""
        robot = RobotFiles(files.inputs)
        control = robot.control
        mimics: tuple[LoopMimic, ...] = ()
        refused: dict[str, str] = {}
        if any(loop.urdf == "mimic" for loop in control.loops):
            mimics, refused = loop_mimics(robot.tree, control)
        ratings = (
            Actuator(row.joint, "passive", **{key: getattr(row, key) for key in RATINGS})
            for row in control.actuators
        )
        kept = Control(actuators=tuple(ratings), loops=control.loops, loop_mimics=mimics)
        (files.outputs / "ratings.json").write_bytes(encode(kept))
        for name, why in refused.items():
            yield LOOP_MIMIC(f"loop {name}", f"no mimic joints can stand for it: {why}")


# --- mimics that stand for loops --------------------------------------------------------------


def loop_mimics(tree: Tree, control: Control) -> tuple[tuple[LoopMimic, ...], dict[str, str]]:
    """The mimics of the loops that ask for them; by name of a loop, why it can have none."""
    asked = by_constraint(loop for loop in control.loops if loop.urdf == "mimic")
    mimics: dict[str, LoopMimic] = {}
    refused: dict[str, str] = {}
    for name, loops in asked.items():
        names = joints_of(tree, loops)
        path = [joint for joint in tree.joints if joint.name in names]
        made = _of_loop(tree, control, name, loops, path)
        if isinstance(made, str):
            refused[name] = made
        else:
            mimics = {each.joint: each for each in made} | mimics
    return tuple(mimics.values()), refused


def _of_loop(
    tree: Tree, control: Control, name: str, loops: Sequence[Loop], path: Sequence[Joint]
) -> list[LoopMimic] | str:
    """One mimic for each joint of the loop that does not lead, or why there is none."""
    driven = {row.joint for row in control.actuators if row.model != "passive"}
    leaders = sorted({leading(tree, joint)[0].name for joint in path} & driven)
    if len(leaders) != 1:
        listed = ", ".join(f"`{leader}`" for leader in leaders) or "none"
        return f"one driven joint must move it, here {listed}"
    (leader,) = leaders
    followers = [j.name for j in path if j.mimic is None and j.name != leader]
    home = dict(initial_pose(tree, control).joints)
    moving = motions(tree, home)
    columns = [moving.column(name) for name in followers]
    jacobian = constraint_jacobian(loops, moving.bodies)[:, columns]
    sizes = np.linalg.svd(jacobian, compute_uv=False)
    if int((sizes > RANK * max(float(sizes.max(initial=0.0)), 1.0)).sum()) < len(columns):
        return "its other joints can move while the driven one stands still"
    everywhere = joints_of(tree, control.loops)
    poses = list(poses_along(tree, control, home, tree.by_joint[leader], everywhere - driven))
    q = np.array([pose[leader] for pose in poses])
    if np.ptp(q) <= 0.0:
        return f"`{leader}` cannot move from where it starts"
    ends = (float(q.min()), float(q.max()))
    made = []
    for follower in followers:
        asked = np.array([pose[follower] for pose in poses])
        slope, start = (float(c) for c in np.polyfit(q, asked, 1))
        off = float(np.abs(start + slope * q - asked).max())
        made.append(LoopMimic(name, follower, Mimic(leader, slope, start), off, ends))
    return made
