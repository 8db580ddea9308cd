"""What Newton's solver holds, as MuJoCo's compiled model; runs in Newton's environment, API of 1.8.

The arrays of that model go out as they are: whoever reads MuJoCo's own model reads this one too.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

KINDS = {
    "body": "body_mass",
    "joint": "jnt_type",
    "geom": "geom_type",
    "site": "site_type",
    "actuator": "actuator_trntype",
    "equality": "eq_type",
    "sensor": "sensor_type",
    "key": "key_time",
    "tendon": "tendon_adr",
}
"""What has names, and an array that has a row for each."""
LEFT_OUT = ("_", "mesh", "hfield", "tex", "bvh", "skin", "flex", "plugin", "names", "paths")
"""Beginnings of words of the model that nobody needs and that fill megabytes."""
LAW = {
    "kp": "kp",
    "kd": "kd",
    "max_effort": "maxEffort",
    "max_motor_effort": "maxMotorEffort",
    "saturation_effort": "saturationEffort",
    "velocity_limit": "velocityLimit",
}
"""Arrays of Newton's drives and clamps, and what the USD calls them."""


def readings(model: Any, held: Any, run: dict[str, Any]) -> dict[str, Any]:
    """The solver's model as plain values, and the laws of drives that act outside of it.

    run: has the robot's names by what the file calls them, its whole path or the end of it.
    """
    values = plain(held) | {"opt": plain(held.opt), "laws": laws(model, run["joints"])}
    values["names"] = {
        kind: [getattr(held, kind)(index).name for index in range(len(values[count]))]
        for kind, count in KINDS.items()
    }
    for kind, names, known in (
        ("body", run["bodies"], model.body_label),
        ("joint", run["joints"], model.joint_label),
    ):
        labels = {joined(label): label for label in known}
        words = [word.strip("_") for word in values["names"][kind]]
        values["names"][kind] = [called(labels.get(word, word), names) for word in words]
    margins, gaps = model.shape_margin.numpy(), model.shape_gap.numpy()
    for index, word in enumerate(values["names"]["geom"]):
        label, _, shape = word.rpartition("_")  # Newton appends its number
        if shape.isdigit():  # margin and gap are Newton's, whose solver has none
            values["names"]["geom"][index] = called(label, run.get("shapes", {}))
            values["geom_margin"][index] = float(margins[int(shape)])
            values["geom_gap"][index] = float(gaps[int(shape)])
    return values


def plain(held: Any) -> dict[str, Any]:
    """Numbers and arrays of one of MuJoCo's structures."""
    words = [word for word in dir(held) if not word.startswith(LEFT_OUT)]
    values = {word: getattr(held, word) for word in words}
    return {
        word: value.tolist() if isinstance(value, np.ndarray) else value
        for word, value in values.items()
        if isinstance(value, int | float | np.ndarray)
    }


def called(label: str, names: dict[str, str]) -> str:
    """The robot's name of a label."""
    end = label.rsplit("/", 1)[-1]
    return names.get(label, names.get(end, end))


def joined(label: str) -> str:
    """What the solver calls a label."""
    return "_".join(label.strip("/").split("/")).strip("_")


def laws(model: Any, names: dict[str, str]) -> dict[str, dict[str, float | None]]:
    """By joint, the law of its `NewtonActuator`: gains and what limits the effort, SI, rad."""
    starts = [int(start) for start in model.joint_qd_start.numpy()]
    labels = dict(zip(starts, model.joint_label, strict=False))
    by_joint: dict[str, dict[str, float | None]] = {}
    for group in model.actuators:
        columns = {
            word: getattr(part, name).numpy()
            for part in (group.drive, *group.clamping)
            for name, word in LAW.items()
            if getattr(part, name, None) is not None
        }
        for row, dof in enumerate(group.indices.numpy()):
            values = {word: float(column[row]) for word, column in columns.items()}
            by_joint[called(labels[int(dof)], names)] = {
                word: value if math.isfinite(value) else None for word, value in values.items()
            }
    return by_joint
