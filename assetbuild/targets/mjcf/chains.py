"""Joints in a row with nothing but massless links between them: several joints on one body."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from assetbuild.findings import Finding, Rule
from assetbuild.robot.chains import Chain, axis_in_body, find_chains
from assetbuild.robot.model import Joint, Tree
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.robot.shapes import Shapes

CHAIN = Rule(
    "mjcf.chain",
    "info",
    "joints with only massless links between them are joints of one body, which is exact",
    "nothing",
)


class JointPlacement:
    """Where the joints of a tree sit in MJCF: mostly one on each body, in its origin."""

    def __init__(self, tree: Tree, shapes: Shapes) -> None:
        chains = find_chains(tree, {s.link for s in shapes.shapes})
        self.hidden = frozenset(link for chain in chains for link in chain.between)
        """Bodies that MJCF does not need."""
        self._rows = {joint.child: Chain((joint,), ()) for joint in tree.joints}
        self._rows |= {chain.body: chain for chain in chains}
        self._poses = {
            joint.name: pose
            for chain in chains
            for joint, pose in zip(chain.joints, chain.joint_poses, strict=True)
        }

    def joints(self, body: str) -> tuple[Joint, ...]:
        """Return a body's joints, outermost first, in the order in which MuJoCo applies them."""
        return self._rows[body].joints if body in self._rows else ()

    def joint_pose(self, joint: Joint) -> Pose:
        """The joint's frame in the body that carries it, all joints at 0."""
        return self._poses.get(joint.name, IDENTITY)

    def seated(self, joint: Joint) -> Joint:
        """The joint with its axis in the axes of the body."""
        return replace(joint, axis=axis_in_body(joint, self.joint_pose(joint)))

    def parent(self, body: str) -> str | None:
        """The body above, as MJCF nests them."""
        return self._rows[body].parent if body in self._rows else None

    def pose_in_parent(self, body: str) -> Pose:
        """Where the body stands in its parent, all joints at 0."""
        return self._rows[body].pose_in_parent


def explain_chains(tree: Tree, shapes: Shapes) -> Iterator[Finding]:
    """One finding for each body with several joints."""
    for chain in find_chains(tree, {s.link for s in shapes.shapes}):
        joints = ", ".join(joint.name for joint in chain.joints)
        links = ", ".join(chain.between)
        yield CHAIN(
            f"link {chain.body}",
            f"carries {len(chain.joints)} joints ({joints}): the massless links between them "
            f"({links}) are no bodies in the MJCF",
            hint="the motion is exactly the same",
            data={"links": chain.between},
        )
