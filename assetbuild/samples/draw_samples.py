"""Robots that could exist: the recipe's ranges drawn, what the draws are like, each as a robot."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode_file, encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import combine, matrix_of, move_inertial
from assetbuild.robot.mjcf_only import of_same_effort
from assetbuild.robot.model import Actuator, Body, Contact, Control, Inertial, Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.randomize import (
    BodySample,
    JointSample,
    Sample,
    Samples,
    draw,
    homogeneous_box,
    inconsistent,
    inertial_of,
    unit_draws,
)
from assetbuild.robot.ranges import JOINT_FACTORS, Randomize, RandomPayload, first_match


class DrawSamples(Step):
    """`tree.json` -> `samples.json`, `statistics.json`."""

    outputs = ("samples.json", "statistics.json")

    randomize: Randomize
    keep: int = 16
    """Samples to write down."""
    judge: int = 10_000
    """Samples to draw for the statistics; the kept ones are the first of them."""

    def run(self, files: Files) -> Iterable[Finding]:
        """Body by body, then each robot."""
        tree = RobotFiles(files.inputs).tree
        draws = dict(self._draws(tree))
        samples = tuple(self._sample(tree, draws, index) for index in range(self.keep))
        (files.outputs / "samples.json").write_bytes(encode(Samples(samples)))
        rows = [_statistics(tree.by_body[name], drawn) for name, drawn in draws.items()]
        files.write_json("statistics.json", {"draws": self._count, "bodies": rows})
        return ()

    @property
    def _count(self) -> int:
        return max(self.keep, self.judge)

    def _draws(self, tree: Tree) -> Iterator[tuple[str, Array]]:
        for name, body in tree.by_body.items():
            matter = first_match(self.randomize.links, name)
            if matter is not None and body.inertial is not None and body.inertial.mass_kg > 0.0:
                yield name, draw(body.inertial, matter, self._count, self.randomize.seed, name)

    def _sample(self, tree: Tree, draws: Mapping[str, Array], index: int) -> Sample:
        payloads = tuple(
            self._between(f"payload/{number}", payload.mass, index)
            for number, payload in enumerate(self.randomize.payloads)
        )
        bodies = []
        for body in tree.bodies:
            inertial = body.inertial
            if body.name in draws:
                inertial = inertial_of(draws[body.name][index])
            for payload, mass in zip(self.randomize.payloads, payloads, strict=True):
                inertial = _loaded(tree, body.name, inertial, payload, mass)
            if inertial is not None and inertial != body.inertial:
                bodies.append(BodySample(body.name, inertial))
        joints = [self._joint(joint.name, index) for joint in tree.moving_joints]
        friction = self.randomize.friction
        return Sample(
            bodies=tuple(bodies),
            joints=tuple(joint for joint in joints if joint is not None),
            payloads_kg=payloads,
            friction=None if friction is None else self._between("friction", friction, index),
        )

    def _joint(self, name: str, index: int) -> JointSample | None:
        ranges = first_match(self.randomize.joints, name)
        if ranges is None:
            return None
        unit = self._unit(f"joint/{name}", index, len(JOINT_FACTORS) + 2)
        factors = {
            key: _scaled(getattr(ranges, key), float(value))
            for key, value in zip(JOINT_FACTORS, unit, strict=False)
        }
        least, most = ranges.delay
        delay = min(most, least + int((unit[-2] + 1) / 2 * (most - least + 1)))
        return JointSample(
            name, **factors, delay=delay, encoder_bias=ranges.encoder_bias * unit[-1]
        )

    def _between(self, name: str, pair: tuple[float, float], index: int) -> float:
        return _scaled(pair, self._unit(name, index, 1)[0])

    def _unit(self, name: str, index: int, width: int) -> list[float]:
        row = unit_draws(self.randomize.seed, name, index + 1, width)[index]
        return [float(value) for value in row]


def _scaled(pair: tuple[float, float], unit: float) -> float:
    """-1..1 onto a range."""
    return (pair[0] + pair[1]) / 2 + (pair[1] - pair[0]) / 2 * unit


def _loaded(
    tree: Tree, body: str, inertial: Inertial | None, payload: RandomPayload, mass: float
) -> Inertial | None:
    """The body with the payload on it, if it carries it."""
    carrier, X_body_link = tree.placement(payload.link)
    if carrier != body or mass == 0.0:
        return inertial
    box = move_inertial(homogeneous_box(mass, payload.size, payload.at), X_body_link)
    return combine([inertial, box]) if inertial else box


def _statistics(body: Body, rows: Array) -> dict[str, object]:
    """What the draws of one body are like."""
    assert body.inertial is not None  # noqa: S101 # only bodies with mass are drawn
    return {
        "body": body.name,
        "mass_kg": _spread(rows[:, 0]),
        "com_shift_m": _spread(np.linalg.norm(rows[:, 1:4] - body.inertial.com_m, axis=1)),
        "largest_moment_kg_m2": _spread(
            np.asarray(np.linalg.eigvalsh(matrix_of(rows[:, 4:])))[:, 2]
        ),
        "inconsistent": int(inconsistent(rows).sum()),
    }


def _spread(values: Array) -> dict[str, object]:
    low, middle, high = (float(v) for v in np.quantile(values, (0.0, 0.5, 1.0)))
    return {"least": low, "median": middle, "most": high}


# --- one of them ---------------------------------------------------------------------------------


class ApplySample(Step):
    """`tree.json`, `control.json`, `samples.json` -> `tree.json`, `control.json`."""

    own_name = "apply_sample"
    outputs = ("tree.json", "control.json")

    index: int

    def run(self, files: Files) -> Iterator[Finding]:
        """Delay and encoder bias are the trainer's: no file of the robot holds them."""
        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        samples = decode_file(Samples, files.inputs / "samples.json")
        sample = samples.samples[self.index]
        drawn = {body.body: body.inertial for body in sample.bodies}
        (files.outputs / "tree.json").write_bytes(encode(tree.with_inertials(drawn)))
        (files.outputs / "control.json").write_bytes(encode(with_control(control, sample)))
        return iter(())


def with_control(control: Control, sample: Sample) -> Control:
    """The control with the drawn gains, limits and friction."""
    drawn = {joint.joint: joint for joint in sample.joints}
    actuators = tuple(
        _varied(actuator, drawn[actuator.joint]) if actuator.joint in drawn else actuator
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


def _varied(actuator: Actuator, by: JointSample) -> Actuator:
    stated = {key: value for key in JOINT_FACTORS if (value := getattr(actuator, key))}
    return replace(actuator, **{key: v * getattr(by, key) for key, v in stated.items()})
