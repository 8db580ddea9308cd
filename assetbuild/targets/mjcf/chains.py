"""Joints in a row with nothing but massless links between them: several joints on one body."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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
        self._tree = tree
        self.chains: Mapping[str, Chain] = {
            chain.body: chain for chain in find_chains(tree, {s.link for s in shapes.shapes})
        }
        self.hidden = frozenset(link for c in self.chains.values() for link in c.between)
        """Bodies that MJCF does not need."""
        self._poses = {
            joint.name: pose
            for chain in self.chains.values()
            for joint, pose in zip(chain.joints, chain.joint_poses, strict=True)
        }

    def joints(self, body: str) -> tuple[Joint, ...]:
        """Return a body's joints, outermost first, in the order in which MuJoCo applies them."""
        if body in self.chains:
            return self.chains[body].joints
        above = self._tree.joint_above.get(body)
        return (above,) if above else ()

    def joint_pose(self, joint: Joint) -> Pose:
        """The joint's frame in the body that carries it, all joints at 0."""
        return self._poses.get(joint.name, IDENTITY)

    def seated(self, joint: Joint) -> Joint:
        """The joint with its axis in the axes of the body."""
        return replace(joint, axis=axis_in_body(joint, self.joint_pose(joint)))

    def parent(self, body: str) -> str | None:
        """The body above, as MJCF nests them."""
        joints = self.joints(body)
        return joints[0].parent if joints else None

    def pose_in_parent(self, body: str) -> Pose:
        """Where the body stands in its parent, all joints at 0."""
        if body in self.chains:
            return self.chains[body].pose_in_parent
        return self._tree.joint_above[body].X_parent_joint


def explain_chains(tree: Tree, shapes: Shapes) -> Iterator[Finding]:
    """One finding for each body with several joints."""
    for chain in JointPlacement(tree, shapes).chains.values():
        joints = ", ".join(joint.name for joint in chain.joints)
        links = ", ".join(chain.between)
        yield CHAIN(
            f"link {chain.body}",
            f"carries {len(chain.joints)} joints ({joints}): the massless links between them "
            f"({links}) are no bodies in the MJCF",
            hint="the motion is exactly the same",
            data={"links": chain.between},
        )
