"""Facts of models that assetbuild did not write: any MJCF, URDF, USD, Isaac Lab configuration."""

from __future__ import annotations

import json
import math
from collections.abc import Collection
from pathlib import Path

import numpy as np

from assetbuild.engine.scratch import scratch
from assetbuild.errors import UsageError
from assetbuild.facts.readers.isaaclab import read_config
from assetbuild.report.snapshot import Facts, Snapshot, Value, kinds_text, robot_facts
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.pose import vec3
from assetbuild.robot.tree import merge_fixed_joints
from assetbuild.simulators import mujoco
from assetbuild.simulators.readings import FORMAT
from assetbuild.source.urdf.read_urdf import ReadUrdf, named_packages

FLOAT32 = 1e-6
DECIMALS = 1e-5
"""MuJoCo's own writer rounds to six digits."""


def foreign_snapshot(path: Path, name: str = "", joints: Collection[str] = ()) -> Snapshot:
    """Of a file by its suffix; AssetBuildError for what cannot be read.

    name, joints: of an Isaac Lab configuration, see `read_config`.
    """
    if path.suffix.lower() == ".py":
        shown = f"{path}:{name}" if name else str(path)
        return Snapshot(shown, _config_facts(path, name, joints), precision=FLOAT32)
    if path.suffix.lower() in (".usd", ".usda", ".usdc"):
        from assetbuild.targets.usd.facts import usd_facts

        return Snapshot(str(path), usd_facts(path), precision=FLOAT32)
    try:
        text = path.read_bytes()
    except OSError as error:
        raise UsageError(f"cannot read `{path}`: {error.strerror}") from None
    if path.suffix.lower() == ".json":
        return _readings(path, text)
    if b"<mujoco" in text:
        return Snapshot(str(path), mjcf_facts(path), precision=DECIMALS)
    if b"<robot" in text:
        return Snapshot(str(path), _urdf_facts(path))
    raise UsageError(
        f"`{path}` is no model that can be compared",
        hint="give a bundle, a recipe, an MJCF, URDF or USD file, or an Isaac Lab configuration",
    )


def _config_facts(path: Path, name: str, joints: Collection[str]) -> Facts:
    """Of an Isaac Lab configuration; its initial state is the pose `home`."""
    facts: Facts = {}
    for key, value in read_config(path, name, joints).facts.items():
        if isinstance(value, tuple):
            facts["robot", "robot", "keyframe home, base, m"] = vec3(value[:3])
        else:
            quantity = "keyframe home" if key.quantity == "start" else key.quantity
            facts[key.kind, key.name, quantity] = value
    return facts


def _readings(path: Path, text: bytes) -> Snapshot:
    """What Isaac Lab measured, by `python/<robot>_isaaclab_measure.py` of a bundle."""
    try:
        raw = json.loads(text)
        if raw["format"] != FORMAT:
            raise ValueError(f"its format is `{raw['format']}`, not `{FORMAT}`")
        facts: Facts = {
            (str(group), str(subject), str(quantity)): _value(value)
            for group, subject, quantity, value in raw["facts"]
        }
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise UsageError(f"`{path}` holds no readings: {error}") from None
    return Snapshot(f"{path} ({raw.get('simulator', 'unnamed')})", facts, precision=FLOAT32)


def _value(value: object) -> Value:
    if isinstance(value, list):
        return tuple(float(part) for part in value)
    return value if value is None or isinstance(value, str) else float(str(value))


def _urdf_facts(path: Path) -> Facts:
    """As a build would read it: fixed joints merged, no recipe, so no drives."""
    with scratch() as ports:
        ports.put("robot.urdf", path.read_bytes())
        packages = named_packages(path.read_bytes())
        ports.run(ReadUrdf(file=path.name, base="floating", packages=packages))
        robot = RobotFiles(ports.folder)
        facts = robot_facts(merge_fixed_joints(robot.links, True, ())[0], robot.source_shapes, None)
    del facts["robot", "robot", "base"]  # a URDF does not say
    return facts


def mjcf_facts(path: Path) -> Facts:
    """Of a compiled model: what MuJoCo will simulate."""
    model = mujoco.load(path).model
    facts: Facts = {("robot", "robot", "total mass, kg"): float(model.body_mass.sum())}
    facts["robot", "robot", "timestep, s"] = float(model.opt.timestep)
    facts["robot", "robot", "gravity, m/s2"] = vec3(model.opt.gravity)
    floating = bool(model.njnt) and int(model.jnt_type[0]) == 0
    facts["robot", "robot", "base"] = "floating" if floating else "fixed"
    for body in range(1, model.nbody):
        own = ("body", mujoco.name_of(model, "body", body))
        facts[*own, "mass, kg"] = float(model.body_mass[body])
        facts[*own, "centre of mass, m"] = vec3(model.body_ipos[body])
        facts[*own, "principal moments, kg m2"] = vec3(np.sort(model.body_inertia[body]))
        facts[*own, "collision"] = _collision(model, body)
    for joint in range(model.njnt):
        if int(model.jnt_type[joint]) in (2, 3):
            _joint_facts(model, joint, facts)
    for actuator in range(model.nu):
        _drive_facts(model, actuator, facts)
    return facts


def _collision(model: mujoco.Model, body: int) -> str:
    import mujoco as mj

    kinds: dict[str, int] = {}
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    for geom in np.flatnonzero(solid & (model.geom_bodyid == body)):
        kind = mj.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
        kinds[kind] = kinds.get(kind, 0) + 1
    return kinds_text(kinds)


def _joint_facts(model: mujoco.Model, joint: int, facts: Facts) -> None:
    own = ("joint", mujoco.name_of(model, "joint", joint))
    dof = int(model.jnt_dofadr[joint])
    limited = bool(model.jnt_limited[joint])
    facts[*own, "kind"] = "slide" if int(model.jnt_type[joint]) == 2 else "hinge"
    facts[*own, "axis"] = vec3(model.jnt_axis[joint])
    facts[*own, "lower"] = float(model.jnt_range[joint, 0]) if limited else None
    facts[*own, "upper"] = float(model.jnt_range[joint, 1]) if limited else None
    facts[*own, "damping"] = float(np.ravel(model.dof_damping[dof])[0])
    facts[*own, "friction"] = float(model.dof_frictionloss[dof])
    facts[*own, "armature"] = float(model.dof_armature[dof])
    if model.jnt_actfrclimited[joint]:
        facts[*own, "effort"] = float(model.jnt_actfrcrange[joint, 1])


def _drive_facts(model: mujoco.Model, actuator: int, facts: Facts) -> None:
    if int(model.actuator_trntype[actuator]) != 0:  # not on a joint
        return
    joint = mujoco.name_of(model, "joint", int(model.actuator_trnid[actuator, 0]))
    gain, bias = model.actuator_gainprm[actuator], model.actuator_biasprm[actuator]
    is_servo = math.isclose(float(gain[0]), -float(bias[1])) and float(gain[0]) > 0.0
    if is_servo:
        facts["joint", joint, "kp"] = float(gain[0])
        facts["joint", joint, "kd"] = -float(bias[2])
    if model.actuator_forcelimited[actuator]:
        facts["joint", joint, "effort"] = float(model.actuator_forcerange[actuator, 1])
    elif model.actuator_ctrllimited[actuator] and not is_servo and float(bias[1]) == 0.0:
        facts["joint", joint, "effort"] = float(model.actuator_ctrlrange[actuator, 1] * gain[0])
