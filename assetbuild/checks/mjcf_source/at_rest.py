"""A compiled MJCF as facts in the frame of its root, every joint at its reference position.

So it makes no difference which frame a body has, or into which body a fixed one was merged.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from assetbuild.facts.mjcf_fields import Bodies
from assetbuild.facts.mjcf_model import compiled_facts, shape_name
from assetbuild.facts.mjcf_parts import Meshes, pose_of
from assetbuild.facts.reference import inertial_facts
from assetbuild.facts.table import Key, Value, pair_name
from assetbuild.robot.inertia import combine, move_inertial, tensor_of
from assetbuild.robot.model import Inertial
from assetbuild.robot.pose import IDENTITY, Pose, vec3
from assetbuild.simulators.mujoco import Model, actuators, first_command, inertia_of, mj, name_of
from assetbuild.simulators.mujoco.drives import Drive, read_drives
from assetbuild.simulators.mujoco.pairs import touching_geoms

Facts = dict[Key, Value]
ROOT = "root"
"""The name of everything that is rigidly one with the root, whatever that is called."""
GREY = (0.5, 0.5, 0.5, 1.0)
"""What MuJoCo draws a shape in that states no colour."""
FIXED = (0, 1)
"""Equalities that hold bodies."""


@dataclass(frozen=True)
class Side:
    """A model and its facts. rest: `ref` of each hinge and slide that has one, rad or m.

    servos: the drives that hold positions, by joint.
    """

    model: Model
    facts: Facts
    rest: Mapping[str, float]
    servos: Mapping[str, Drive]

    def mesh(self, shape: str) -> str:
        """The name of a shape's mesh; "" without one."""
        mesh = int(self.model.geom_dataid[self.model.geom(shape).id])
        return name_of(self.model, "mesh", mesh) if mesh >= 0 else ""


class _InRoot(Bodies):
    """A thing in the frame of the root, by the body that carries the joints above it."""

    def __init__(self, model: Model) -> None:
        super().__init__(model)
        data = mj.MjData(model)
        mj.mj_kinematics(model, data)
        X_world = [pose_of(data.xpos[i], data.xquat[i]) for i in range(model.nbody)]
        root = X_world[min(1, model.nbody - 1)].inverse()
        self._X_root: list[Pose] = [root @ X for X in X_world]
        if model.njnt and model.jnt_type[0] == mj.mjtJoint.mjJNT_FREE:
            self._X_root[0] = IDENTITY  # wherever the root floats at the start

    def name(self, body: int) -> str:
        """All that is rigidly one with the root is `ROOT`."""
        carrier, of_root = (int(self.model.body_weldid[i]) for i in (body, 1))
        return ROOT if carrier == of_root else super().name(carrier)

    def placed(self, body: int) -> Pose:
        """X_root_body."""
        return self._X_root[body]

    def is_own_frame(self, body: int, site: str, X_body_site: Pose) -> bool:
        """Never: here the frames of bodies have no names, and ours calls such a site otherwise."""
        return False

    def weights(self) -> Iterator[tuple[str, Inertial]]:
        """All that moves together."""
        parts: dict[str, list[Inertial]] = {}
        for body in range(1, self.model.nbody):
            mass, com = float(self.model.body_mass[body]), vec3(self.model.body_ipos[body])
            inertial = Inertial(mass, com, tensor_of(inertia_of(self.model, body)))
            moved = move_inertial(inertial, self.placed(body))
            parts.setdefault(self.name(body), []).extend([moved] if mass else [])
        for name, some in parts.items():
            yield name, combine(some) if some else Inertial(0.0, (0.0,) * 3, (0.0,) * 6)


def read_side(spec: Any, weightless: str = "") -> Side:  # Any: MjSpec
    """Compile and read; MuJoCo's ValueError where it refuses.

    weightless: a body that has no mass, though the compiler's `boundmass` gives it some.
    """
    option, bit = spec.option, int(mj.mjtDisableBit.mjDSBL_GRAVITY)
    if int(option.disableflags) & bit:  # gravity that a flag switches off is none
        option.disableflags = int(option.disableflags) & ~bit
        option.gravity = (0.0, 0.0, 0.0)
    model = spec.compile()
    if weightless:
        model.body(weightless).mass = 0.0
    bodies = _InRoot(model)
    table = compiled_facts(model, bodies=bodies, meshes=Meshes(model, by_area=True))
    rest = {
        name_of(model, "joint", joint): float(model.qpos0[int(model.jnt_qposadr[joint])])
        for joint in range(model.njnt)
        if int(model.jnt_type[joint]) in (2, 3) and model.qpos0[int(model.jnt_qposadr[joint])]
    }
    drives = [d for d in read_drives(model) if d.kind == "servo" and not d.filtered]
    side = Side(model, {}, rest, {drive.joint_name: drive for drive in drives})
    facts = side.facts
    keys = {str(model.key(index).name) for index in range(model.nkey)}
    keys.discard("")  # of `<size nkey>`
    sites = np.flatnonzero(model.site_bodyid == 0)
    scenery = {("frame", name_of(model, "site", int(site))) for site in sites}
    for key, value in table.facts.items():
        of_bodies = key.kind == "body" and key.quantity != "mjcf:gravcomp"
        unnamed = key.kind == "keyframe" and key.name.split("/")[0] not in keys
        fixed = key.quantity == "mjcf:data" and (  # of an equality that is switched off
            table.facts.get(key._replace(quantity="mjcf:type")) in FIXED
        )
        if not (of_bodies or unnamed or fixed or key[:2] in scenery or key.kind == "pair"):
            facts[key] = value
    for name, weight in bodies.weights():
        facts |= {Key("body", name, q): v for q, v in inertial_facts(weight).items()}
    for pair in touching_geoms(model):
        ends = (shape_name(model, geom) for geom in pair)
        facts[Key("pair", pair_name(*ends), "touches")] = True
    for key in [key for key in facts if key.kind == "shape" and key.quantity == "role"]:
        facts.setdefault(key._replace(quantity="rgba"), GREY)
    for index in range(model.nsensor):  # those of sites, which are no frames of bodies here
        for word, kinds, ids in (
            ("object", model.sensor_objtype, model.sensor_objid),
            ("reference", model.sensor_reftype, model.sensor_refid),
        ):
            if int(kinds[index]) == mj.mjtObj.mjOBJ_SITE:
                watched = f"site {name_of(model, 'site', int(ids[index]))}"
                facts[Key("sensor", name_of(model, "sensor", index), word)] = watched
    # Commands that keyframes give to actuators of tendons, sites and bodies.
    for index in set(actuators(model)) - {drive.index for drive in read_drives(model)}:
        for pose in sorted(keys):
            command = float(model.key(pose).ctrl[first_command(model, index)])
            subject = f"{pose}/{name_of(model, 'actuator', index)}"
            facts[Key("keyframe", subject, "mjcf:command")] = command
    _count_from_rest(side)
    return side


def _count_from_rest(side: Side) -> None:
    """Positions count from `ref`, and so do the commands of drives that hold positions.

    A position at which an equality locks a joint counts from there already.
    """
    ends = ("lower", "upper")
    locked = {
        key
        for key, value in side.facts.items()
        if key.quantity in ends
        and all(value == side.facts.get(key._replace(quantity=end)) for end in ends)
    }
    for key, value in list(side.facts.items()):
        joint = key.name.rpartition("/")[2]
        rest = side.rest.get(joint, 0.0)
        if key.quantity in ("command range", "target"):
            rest = side.servos[joint].command_step(rest) if joint in side.servos else 0.0
        elif key in locked or key.quantity not in (*ends, "spring reference", "position"):
            continue
        if rest and value is not None:
            values = value if isinstance(value, tuple) else (value,)
            moved = tuple(float(each) - rest for each in values)
            side.facts[key] = moved if isinstance(value, tuple) else moved[0]
