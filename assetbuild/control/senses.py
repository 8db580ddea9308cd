"""Surfaces, sensors and cameras of the recipe on this robot's links, joints and shapes."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping

from assetbuild.errors import did_you_mean
from assetbuild.recipe_types import stated
from assetbuild.robot import model
from assetbuild.robot.actuator_table import Key, RowError, must_match
from assetbuild.robot.contact import Contacts, Surface
from assetbuild.robot.pose import Pose, quat_multiply, quat_of_rpy
from assetbuild.robot.ranges import first_match
from assetbuild.robot.sections import IMU_NAMES, Camera, Feet, Imu, Sensor
from assetbuild.robot.shapes import Shapes
from assetbuild.robot.tree import link_placement

_ABOUT_X = (0.0, 1.0, 0.0, 0.0)


# --- surfaces -------------------------------------------------------------------------------


def check_surfaces(shapes: Shapes, contact: Contacts, may_idle: Collection[str] = ()) -> None:
    """RowError for a pattern without a shape, unless nobody has written it: `may_idle`."""
    links = [shape.link for shape in shapes.of("collision")]
    for pattern in contact.links:
        if pattern not in may_idle:
            must_match(("contact", "links", pattern), pattern, links, "link with a collision shape")


def changed(common: model.Contact, rules: Mapping[str, Surface], link: str) -> model.Contact:
    """The surface of a link by the first rule that matches it."""
    rule = first_match(rules, link)
    return common if rule is None else common.model_copy(update=stated(rule))


# --- sensors --------------------------------------------------------------------------------


def check_sensors(
    tree: model.Tree, imu: Imu | None, sensors: Mapping[str, Sensor], cameras: Mapping[str, Camera]
) -> None:
    """Raise the RowError of a link or joint that is not there; for a plan that knows the tree."""
    list(_imu_sensors(tree, imu))
    list(_named_sensors(tree, sensors))
    placed_cameras(tree, cameras)


def placed_sensors(
    tree: model.Tree,
    shapes: Shapes,
    imu: Imu | None,
    feet: Feet | None,
    sensors: Mapping[str, Sensor],
) -> tuple[model.Sensor, ...]:
    """The IMU's, one per sole, and the named ones. RowError: no such link, or two of one name."""
    made = [*_imu_sensors(tree, imu), *_named_sensors(tree, sensors), *soles(shapes, feet)]
    names = [sensor.name for sensor in made]
    for name in sensors:
        if names.count(name) > 1:
            message = f"sensors: the name `{name}` is taken by the IMU or a foot"
            raise RowError(message, key=("sensors", name), hint="choose another name")
    return tuple(made)


def _imu_sensors(tree: model.Tree, imu: Imu | None) -> Iterator[model.Sensor]:
    if imu is None:
        return
    at = _frame(tree, imu.link, ("imu", "link"))
    for kind in imu.sensors:
        yield model.Sensor(IMU_NAMES[kind], kind, at)


def soles(shapes: Shapes, feet: Feet | None) -> Iterator[model.Sensor]:
    """A contact sensor for each collision shape of a foot; RowError when no foot has one."""
    if feet is None:
        return
    links = [shape.link for shape in shapes.of("collision")]
    must_match(("feet", "links"), feet.links, links, "link with a collision shape")
    for shape in shapes.of("collision") if feet.contact_sensors else ():
        if re.fullmatch(feet.links, shape.link):
            name = shape.name.replace("_collision", "_contact")
            yield model.Sensor(name, "contact", model.Place("shape", shape.name))


def _named_sensors(tree: model.Tree, sensors: Mapping[str, Sensor]) -> Iterator[model.Sensor]:
    for name, sensor in sensors.items():
        at, relative_to = _place(tree, name, sensor), None
        if sensor.relative_to:
            relative_to = _frame(tree, sensor.relative_to, ("sensors", name, "relative_to"))
        yield model.Sensor(name, sensor.kind, at, relative_to, sensor.cutoff, sensor.noise)


def _place(tree: model.Tree, name: str, sensor: Sensor) -> model.Place:
    if sensor.link is not None:
        place = _frame(tree, sensor.link, ("sensors", name, "link"))
        if sensor.kind.startswith("subtree"):
            return model.Place("body", tree.placement(sensor.link)[0])
        return place
    joints = [joint.name for joint in tree.moving_joints]
    if sensor.joint not in joints:
        raise RowError(
            f"sensors.{name}: no moving joint `{sensor.joint}`",
            key=("sensors", name, "joint"),
            hint=did_you_mean(str(sensor.joint), joints),
        )
    driven = sensor.kind.startswith("actuator")
    return model.Place("actuator" if driven else "joint", str(sensor.joint))


def _frame(tree: model.Tree, link: str, key: Key) -> model.Place:
    link_placement(tree, link, ".".join(map(str, key)), key)
    return model.Place("frame", link)


# --- cameras --------------------------------------------------------------------------------


def placed_cameras(tree: model.Tree, cameras: Mapping[str, Camera]) -> tuple[model.Camera, ...]:
    """Cameras with their poses; RowError for a link that is not there."""
    made = []
    for name, camera in cameras.items():
        if camera.link is not None:
            _frame(tree, camera.link, ("cameras", name, "link"))
        quat = quat_of_rpy(*camera.rpy)
        if camera.optical:
            # An optical frame looks along +z with y down: half a turn about x.
            quat = quat_multiply(quat, _ABOUT_X)
        pose, view = Pose(camera.xyz, quat), (camera.fovy, camera.resolution, camera.tracking)
        made.append(model.Camera(name, camera.link, pose, *view))
    return tuple(made)
