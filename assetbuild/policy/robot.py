"""The robot of a bundle, as a policy meets it: joints in every order, and its own numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from assetbuild.errors import UsageError
from assetbuild.facts.plain_yaml import read_yaml
from assetbuild.facts.reference import Reference, robot_named
from assetbuild.policy.stated import ByJoint, Policy, Term
from assetbuild.policy.terms import unknown
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Actuator, Control, Tree
from assetbuild.robot.orders import BUS, joint_orders
from assetbuild.robot.pose import IDENTITY, Array

CONTRACT = "policy/*_contract.yaml"


@dataclass(frozen=True)
class Bot:
    """A built robot. orders: of all moving joints by who counts them; `bus` may have fewer.

    position, kp, kd: by joint, rad or m, N m/rad and N m s/rad. step_s: between two actions.
    """

    bundle: Path
    name: str
    tree: Tree
    control: Control
    orders: Mapping[str, tuple[str, ...]]
    imu: str | None

    @property
    def driven(self) -> tuple[str, ...]:
        """Joints with a drive, in the order of the URDF."""
        return tuple(n for n, row in self.control.by_joint.items() if row.model != "passive")

    @property
    def position(self) -> ByJoint:
        """The pose in which it starts."""
        return dict(initial_pose(self.tree, self.control).joints)

    @property
    def kp(self) -> ByJoint:
        """Stiffness of each drive."""
        return {row.joint: row.kp for row in self.control.actuators if row.model != "passive"}

    @property
    def kd(self) -> ByJoint:
        """Damping of each drive."""
        return {row.joint: row.kd for row in self.control.actuators if row.model != "passive"}

    @property
    def states_bus(self) -> bool:
        """Whether a contract says in which order the motor bus counts."""
        return any(self.bundle.glob(CONTRACT))

    @property
    def step_s(self) -> float:
        """What the recipe's `simulation` says."""
        simulation = self.control.simulation
        return float(simulation.timestep * simulation.decimation)

    def servos(self, policy: Policy) -> dict[str, Actuator]:
        """Position servos with the policy's gains, where it states none with the bundle's."""
        actuators = {}
        for joint in policy.acts_on:
            actuator = self.control.by_joint.get(joint) or Actuator(joint, "passive")
            kp, kd = policy.kp.get(joint, actuator.kp), policy.kd.get(joint, actuator.kd)
            actuators[joint] = replace(actuator, model="pd", kp=kp, kd=kd)
        return actuators

    @property
    def imu_in_base(self) -> tuple[Array, Array]:
        """(R, p) of the IMU's frame in the base; without an IMU the base's own."""
        _, pose = self.tree.placement(self.imu) if self.imu else (self.tree.root, IDENTITY)
        return pose.rotation, np.array(pose.xyz)

    def cannot_see(self, term: Term) -> str:
        """Why an observation of this robot cannot be computed; "" where it can."""
        on_base = self.imu is None or self.tree.placement(self.imu)[0] == self.tree.root
        if term.function.startswith("imu_") and not on_base:
            return f"the IMU `{self.imu}` moves against the base"
        return unknown(term)


def bot_of(bundle: Path) -> Bot:
    """The robot of a bundle. UsageError where there is none."""
    reference = Reference.of_bundle(bundle)
    imu = (reference.options.get("imu") or {}).get("link")
    name = robot_named(bundle, reference.tree.name)
    return bot_from(bundle, name, reference.tree, reference.control, imu)


def bot_from(folder: Path, name: str, tree: Tree, control: Control, imu: str | None) -> Bot:
    """A robot whose files lie in a folder as in a bundle. UsageError where nothing drives it."""
    stated = [read_yaml(contract).get("orders", {}) for contract in sorted(folder.glob(CONTRACT))]
    bus = tuple(name for name in dict(*stated[:1]).get(BUS, ()) if name in tree.by_joint)
    known = {*tree.by_body, *(frame.name for frame in tree.frames)}
    orders = joint_orders(tree, bus)
    bot = Bot(folder, name, tree, control, orders, imu if imu in known else None)
    if not bot.driven:
        raise UsageError(f"{name}: no joint of the robot has a drive")
    return bot
