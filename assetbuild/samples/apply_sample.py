"""One drawn robot: its tree and control, for any target to write."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode_file, encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.mjcf_only import of_same_effort
from assetbuild.robot.model import Actuator, Contact, Control, Tree
from assetbuild.robot.randomize import JointSample, Sample, Samples


class ApplySample(Step):
    """`tree.json`, `control.json`, `samples.json` -> `tree.json`, `control.json`."""

    outputs = ("tree.json", "control.json")

    index: int

    def run(self, files: Files) -> Iterator[Finding]:
        """Delay and encoder bias are the trainer's: no file of the robot holds them."""
        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        samples = decode_file(Samples, files.inputs / "samples.json")
        sample = samples.samples[self.index]
        (files.outputs / "tree.json").write_bytes(encode(with_matter(tree, sample)))
        (files.outputs / "control.json").write_bytes(encode(with_control(control, sample)))
        return iter(())


def with_matter(tree: Tree, sample: Sample) -> Tree:
    """The tree with the drawn mass properties."""
    drawn = {body.body: body.inertial for body in sample.bodies}
    bodies = tuple(
        replace(body, inertial=drawn[body.name]) if body.name in drawn else body
        for body in tree.bodies
    )
    return replace(tree, bodies=bodies)


def with_control(control: Control, sample: Sample) -> Control:
    """The control with the drawn gains, limits and friction."""
    drawn = {joint.joint: joint for joint in sample.joints}
    actuators = tuple(
        _scaled(actuator, drawn[actuator.joint]) if actuator.joint in drawn else actuator
        for actuator in control.actuators
    )
    contacts = tuple((shape, _slid(contact, sample)) for shape, contact in control.contacts)
    changed = replace(control, actuators=actuators)
    return replace(
        changed,
        contact=_slid(control.contact, sample),
        contacts=contacts,
        mjcf_only=tuple(of_same_effort(control.mjcf_only, control.by_joint, changed.by_joint)),
    )


def _slid(contact: Contact, sample: Sample) -> Contact:
    if sample.friction is None:
        return contact
    return contact.model_copy(update={"friction": (sample.friction, *contact.friction[1:])})


def _scaled(actuator: Actuator, by: JointSample) -> Actuator:
    return replace(
        actuator,
        kp=actuator.kp * by.kp,
        kd=actuator.kd * by.kd,
        damping=actuator.damping * by.damping,
        friction=actuator.friction * by.friction,
        armature=actuator.armature * by.armature,
        effort=actuator.effort and actuator.effort * by.effort,
    )
