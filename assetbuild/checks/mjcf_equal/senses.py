"""Surfaces, sensors and cameras of the robot beside those of a compiled MJCF, as pairs to compare.

A check yields a finding for each pair that differs; numbers are compared as numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from assetbuild.robot.model import Actuator, Camera, Contact, Control, Sensor, Tree
from assetbuild.robot.pose import IDENTITY, normalised_quat, rotation_of
from assetbuild.simulators import mujoco

SOLREF, SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
"""MuJoCo's own softness."""


@dataclass(frozen=True)
class Pair:
    """One thing said twice. what: the rule's last part; words: with the unit."""

    what: str
    subject: str
    words: str
    expected: tuple[float, ...] | str
    found: tuple[float, ...] | str


def surface(model: mujoco.Model, geom: int, subject: str, contact: Contact) -> Iterator[Pair]:
    """Of one collision geom."""
    for words, expected, found in (
        ("friction", contact.friction, model.geom_friction[geom]),
        ("condim", (contact.condim,), [model.geom_condim[geom]]),
        ("priority", (contact.priority,), [model.geom_priority[geom]]),
        ("solref", contact.solref or SOLREF, model.geom_solref[geom]),
        ("solimp", contact.solimp or SOLIMP, model.geom_solimp[geom]),
        ("margin (m)", (contact.margin,), [model.geom_margin[geom]]),
        ("gap (m)", (contact.gap,), [model.geom_gap[geom]]),
        ("contype", (contact.mask,), [model.geom_contype[geom]]),
        ("conaffinity", (contact.partners,), [model.geom_conaffinity[geom]]),
    ):
        yield Pair("contact", subject, words, expected, tuple(float(v) for v in found))


def general(model: mujoco.Model, index: int, actuator: Actuator) -> Iterator[Pair]:
    """The parameters of a general actuator, as far as the robot states them."""
    said, subject = actuator.general, f"actuator {actuator.joint}"
    if said is None:
        return
    for words, expected, row in (
        ("dynprm", said.dynprm, model.actuator_dynprm),
        ("gainprm", said.gainprm, model.actuator_gainprm),
        ("biasprm", said.biasprm, model.actuator_biasprm),
    ):
        found = tuple(float(v) for v in row[index][: len(expected)])
        yield Pair("gains", subject, words, expected, found)


def sensors(model: mujoco.Model, control: Control) -> Iterator[Pair]:
    """Each sensor of the robot by its name, with cutoff and noise."""
    index = {mujoco.name_of(model, "sensor", i): i for i in range(model.nsensor)}
    for sensor in control.sensors:
        subject = f"sensor {sensor.name}"
        at = index.get(sensor.name)
        if at is None:
            yield Pair("sensor", subject, "the sensor", "there", "missing")
            continue
        yield from _sensor(model, at, sensor, subject)


def _sensor(model: mujoco.Model, at: int, sensor: Sensor, subject: str) -> Iterator[Pair]:
    import mujoco as mj

    kind = mj.mjtSensor(int(model.sensor_type[at])).name.removeprefix("mjSENS_").lower()
    yield Pair("sensor", subject, "kind", sensor.kind, kind)
    said = (sensor.cutoff, sensor.noise)
    found = (float(model.sensor_cutoff[at]), float(model.sensor_noise[at]))
    yield Pair("sensor", subject, "cutoff and noise", said, found)


def cameras(model: mujoco.Model, tree: Tree, control: Control) -> Iterator[Pair]:
    """Each camera of the robot by its name: place and field of view."""
    index = {mujoco.name_of(model, "camera", i): i for i in range(model.ncam)}
    for camera in control.cameras:
        subject = f"camera {camera.name}"
        at = index.get(camera.name)
        if at is None:
            yield Pair("camera", subject, "the camera", "there", "missing")
            continue
        yield from _camera(model, at, tree, camera, subject)


def _camera(
    model: mujoco.Model, at: int, tree: Tree, camera: Camera, subject: str
) -> Iterator[Pair]:
    X_body_link = tree.placement(camera.link)[1] if camera.link else IDENTITY
    X_body_camera = X_body_link @ camera.X_link_camera
    place = tuple(float(v) for v in model.cam_pos[at])
    yield Pair("camera", subject, "position (m)", X_body_camera.xyz, place)
    w, x, y, z = (float(v) for v in model.cam_quat[at])
    turn = tuple(float(v) for v in rotation_of(normalised_quat((w, x, y, z))).ravel())
    yield Pair("camera", subject, "rotation", tuple(X_body_camera.rotation.ravel()), turn)
    fovy = (math.radians(float(model.cam_fovy[at])),)
    yield Pair("camera", subject, "field of view (rad)", (camera.fovy,), fovy)
