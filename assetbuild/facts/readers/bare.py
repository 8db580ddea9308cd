"""`mjcf/<robot>_bare.xml`: the robot for mjlab, whose configuration brings drives and poses."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from assetbuild.facts.mjcf import UNSEEN, MjcfReader
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Key, Table, Value
from assetbuild.robot.model import Actuator, Control, Place, Sensor

TASK_SENSORS = {
    "imu_ang_vel": "gyro", "imu_lin_vel": "velocimeter", "imu_lin_acc": "accelerometer",
    "imu_upvector": "framezaxis", "root_angmom": "subtreeangmom",
}  # fmt: skip
"""What mjlab's velocity task reads, by name, and its kind."""
RENAMED = re.compile(r"(.*)_collision\d*")
BROUGHT = ("actuator", "option", "size", "keyframe", "drive")
"""Sections of a source's MJCF that mjlab's configuration brings itself."""


class BareFacts(MjcfReader):
    """Bodies, joints without drives, shapes, sites and the sensors of mjlab's tasks."""

    needs = ("mjlab",)
    format_id = "bare"
    display_name = "the bare MJCF"
    folder = ""
    file_globs = ("mjcf/{robot}_bare.xml", "mjcf/assets/*")
    written = "mjcf/{robot}_bare.xml"
    recipe_sections = ("feet", "imu")
    lacks: ClassVar[Mapping[str, str]] = {
        **UNSEEN,
        "keyframe": "mjlab's configuration has the initial state",
        "simulation": "mjlab's configuration has the options",
    }

    def robot_of(self, reference: Reference) -> Reference:
        """The robot without what mjlab's configuration says."""
        control = reference.control
        drives = tuple(
            row if row.model == "passive" else Actuator(row.joint, "passive")
            for row in control.actuators
        )
        only = tuple(item for item in control.mjcf_only if item.place not in BROUGHT)
        sensors = tuple(_sensors(reference, control))
        bare = replace(control, actuators=drives, sensors=sensors, mjcf_only=only)
        return replace(reference, control=bare)

    def found(self, path: Path, reference: Reference) -> Table:
        """With the robot's names of collision geoms: `FR_foot` of `FR_foot_collision2`.

        That mjlab finds every geom is the check `mjlab_contract`.
        """
        known = {shape.name for shape in reference.shapes.shapes}

        def robot_name(name: str) -> str:
            match = RENAMED.fullmatch(name)
            return match[1] if match and name not in known else name

        facts: dict[Key, Value] = {}
        for key, value in super().found(path, reference).facts.items():
            if key.kind == "shape":
                key = key._replace(name=robot_name(key.name))
            if key.kind == "sensor" and isinstance(value, str) and value.startswith("shape "):
                value = f"shape {robot_name(value.removeprefix('shape '))}"
            facts[key] = value
        return Table(facts)


def _sensors(reference: Reference, control: Control) -> Iterator[Sensor]:
    """The robot's own but for those that mjlab makes itself; those of its tasks."""
    sensors = [
        sensor
        for sensor in control.sensors
        if sensor.kind != "contact" and sensor.at.kind not in ("actuator", "tendon")
    ]
    yield from sensors
    there = {sensor.name for sensor in sensors}
    root = reference.tree.root
    at = Place("frame", str((reference.options.get("imu") or {}).get("link") or root))
    for name, kind in TASK_SENSORS.items():
        if reference.tree.base == "floating" and name not in there:
            yield Sensor(name, kind, Place("body", root) if kind.startswith("subtree") else at)
