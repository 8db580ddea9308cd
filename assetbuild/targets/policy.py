"""The policy's contract: what a controller must know to drive this robot in any engine.

Joint orders, default pose, gains, limits, rates and conventions, as plain YAML that ten lines of
NumPy load: see docs/how-to/policy.md.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.errors import StepError, did_you_mean
from assetbuild.findings import Finding, Rule, known
from assetbuild.plugin_types import Target
from assetbuild.recipe_types import Model
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Control, Joint, Tree
from assetbuild.robot.orders import BUS, joint_orders, permutation
from assetbuild.robot.tree import link_names

NO_BUS = Rule(
    "policy.bus_order",
    "info",
    "the recipe does not say in which order the real robot's bus counts its motors, so the "
    "contract takes the order of the URDF",
    "`policy: {bus_order: [...]}`, names of joints",
)
HEAD = """\
# What a policy must know to drive {robot}, by assetbuild. SI units, radians.
# orders: names of the joints as each engine counts them. permutations: `x_engine[permutations]` is
# in the order of `joints`. Every other list is in the order of `joints`.
"""
CONVENTIONS: Mapping[str, str] = {
    "quaternion": "wxyz, body to world; Isaac Lab 3 and PhysX take xyzw",
    "projected_gravity": "the direction of gravity in the base's frame: (0, 0, -1) upright",
    "base_velocity": "of the base's origin, in the base's frame, m/s and rad/s",
    "action": "target = default_position + scale * action",
}


class PolicyOptions(Model):
    """What the real robot adds to the policy's contract: `policy/<robot>_contract.yaml`."""

    bus_order: tuple[str, ...] | None = Field(
        None,
        max_length=1000,
        description="driven joints in the order in which the robot's own bus counts its motors; "
        "null = as in the URDF",
    )


class Policy(Target):
    """`policy/<robot>_contract.yaml`."""

    outputs = ("policy/",)
    reads = ("tree.json", "control.json")

    sections: ClassVar[Mapping[str, str]] = {"policy": "options"}
    recipe_fields: ClassVar[Mapping[str, str]] = {"feet": "feet.links", "imu": "imu.link"}

    options: PolicyOptions = PolicyOptions()
    """The recipe's `policy`."""
    feet: str | None = None
    """Pattern of the source links that the robot stands on."""
    imu: str | None = None
    """The IMU's link; None: the root's own frame."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises StepError for a bus that lists what is no joint, or a joint twice."""
        import yaml

        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        bus = self.options.bus_order or ()
        _refuse_bus(bus, tree)
        joints, orders = tree.moving_joints, joint_orders(tree, bus)
        names = [joint.name for joint in joints]
        stated: dict[str, Any] = {  # Any: YAML
            "format": "assetbuild policy contract",
            "version": 1,
            "robot": self.robot,
            "joints": names,
            "orders": {engine: list(order) for engine, order in orders.items()},
            "permutations": {
                engine: list(permutation(names, order))
                for engine, order in orders.items()
                if set(names) <= set(order)
            },
            **_numbers(joints, tree, control),
            "timestep": control.simulation.timestep,
            "decimation": control.simulation.decimation,
            "base": {"kind": tree.base, "link": tree.root, "imu": self.imu or tree.root},
            "feet": [
                name for name in link_names(tree) if self.feet and re.fullmatch(self.feet, name)
            ],
            "conventions": dict(CONVENTIONS),
        }
        text = yaml.safe_dump(stated, sort_keys=False, default_flow_style=None, width=100)
        folder = files.outputs / "policy"
        folder.mkdir()
        path = folder / f"{self.robot}_contract.yaml"
        path.write_text(HEAD.format(robot=self.robot) + text, encoding="utf-8")
        if not bus and joints:
            yield NO_BUS("recipe policy", f"`{BUS}` is the order of the URDF: no other is stated")


def _refuse_bus(bus: tuple[str, ...], tree: Tree) -> None:
    names = [joint.name for joint in tree.moving_joints]
    for name in bus:
        if name not in names:
            raise StepError(
                f"policy.bus_order: no moving joint `{name}`", hint=did_you_mean(name, names)
            )
    if len(set(bus)) < len(bus):
        twice = next(name for name in bus if bus.count(name) > 1)
        raise StepError(f"policy.bus_order names `{twice}` twice")


def _numbers(joints: tuple[Joint, ...], tree: Tree, control: Control) -> dict[str, list[Any]]:
    """Columns in the order of the joints; null where nothing limits. Any: a number or None."""
    pose = dict(initial_pose(tree, control).joints)
    rows = [control.drive_of(joint) for joint in joints]
    return {
        "default_position": [pose[joint.name] for joint in joints],
        "lower": [known(joint.bounds[0]) for joint in joints],
        "upper": [known(joint.bounds[1]) for joint in joints],
        "model": [row.model for row in rows],
        "kp": [row.kp for row in rows],
        "kd": [row.kd for row in rows],
        "effort": [row.effort for row in rows],
        "velocity": [row.velocity for row in rows],
        "armature": [row.armature for row in rows],
    }
