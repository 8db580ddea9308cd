"""The script with which a user of Isaac Lab fills in Isaac Lab's half of the comparison.

It runs in Isaac Lab only, writes readings beside itself, and `assetbuild diff BUNDLE READINGS`
ranks them against the robot's. `report/sides.py` reads them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping

from assetbuild.robot.model import Tree
from assetbuild.simulators.readings import FALL, FALL_S, FORMAT, HEIGHT, SETTLE_S
from assetbuild.simulators.usd_names import body_identifiers, joint_identifiers

TEXT = '''\
"""What {robot} is in Isaac Lab: read back, dropped, left standing.

    ./isaaclab.sh -p {module}_isaaclab_measure.py --headless
    assetbuild diff BUNDLE {module}_isaaclab.json
"""

import argparse
import importlib.util
import json
from pathlib import Path

from isaaclab.app import AppLauncher

parser = argparse.ArgumentParser(description=__doc__)
AppLauncher.add_app_launcher_args(parser)
app = AppLauncher(parser.parse_args()).app  # the rest of Isaac Lab can be imported only now

import isaaclab.sim as sim_utils  # noqa: E402
from isaaclab.assets import Articulation  # noqa: E402

GENERATION = 3 if importlib.util.find_spec("isaaclab_physx") else 2
if GENERATION == 3:
    from {module}_isaaclab_3 import {upper}_CFG, SIMULATION_CFG  # noqa: E402
else:
    from {module}_isaaclab_2 import {upper}_CFG, SIMULATION_CFG  # noqa: E402

BODIES = {bodies}
"""Names of the robot by names of the USD, where they differ."""
JOINTS = {joints}
FALL_S, SETTLE_S, RAISED_M = {fall!r}, {settle!r}, 1.0


def numbers(values):
    """Return the values of the first environment as plain lists; Isaac Lab 3 wraps its tensors."""
    return getattr(values, "torch", values)[0].cpu().tolist()


def placed(path, x, z):
    x0, y0, z0 = {upper}_CFG.init_state.pos
    start = {upper}_CFG.init_state.replace(pos=(x0 + x, y0, z0 + z))
    return Articulation({upper}_CFG.replace(prim_path=path, init_state=start))


def height(robot):
    return numbers(robot.data.root_pos_w)[2]


def drives(robot):
    """Stiffness and damping by joint, of drives inside and outside of the solver alike."""
    names, found = robot.joint_names, {{}}
    for group in robot.actuators.values():
        for column, name in enumerate(group.joint_names):
            found[name] = [numbers(group.stiffness)[column], numbers(group.damping)[column]]
    return [found.get(name, [None, None]) for name in names]


def readings(robot):
    data, facts = robot.data, []
    masses = numbers(data.body_mass if hasattr(data, "body_mass") else data.default_mass)
    for name, mass in zip(robot.body_names, masses):
        facts.append(["body", BODIES.get(name, name), "mass, kg", mass])
    columns = zip(
        robot.joint_names,
        numbers(data.joint_pos_limits),
        drives(robot),
        numbers(data.joint_armature),
        numbers(data.joint_effort_limits),
    )
    implicit = {{
        name
        for group in robot.actuators.values()
        if getattr(group, "is_implicit_model", False)
        for name in group.joint_names
    }}
    for name, limits, (kp, kd), armature, effort in columns:
        own = ["joint", JOINTS.get(name, name)]
        for quantity, limit in zip(("lower", "upper"), limits):
            facts.append([*own, quantity, limit if abs(limit) < 1e6 else None])  # it turns freely
        facts.append([*own, "armature", armature])
        if kp is not None:
            facts += [[*own, "kp", kp], [*own, "kd", kd]]
        if name in implicit:  # else the solver's limit is none of the robot's
            facts.append([*own, "effort", effort])
    facts.append(["robot", "robot", "total mass, kg", sum(masses)])
    facts.append(["robot", "robot", "base", "fixed" if robot.is_fixed_base else "floating"])
    facts.append(["robot", "robot", "timestep, s", SIMULATION_CFG.dt])
    facts.append(["robot", "robot", "gravity, m/s2", list(SIMULATION_CFG.gravity)])
    return facts


def main():
    simulation = sim_utils.SimulationContext(SIMULATION_CFG)
    floor = sim_utils.GroundPlaneCfg()
    floor.func("/World/floor", floor)
    standing = placed("/World/standing", 0.0, 0.0)
    falling = placed("/World/falling", 10.0, RAISED_M)
    simulation.reset()
    dt = SIMULATION_CFG.dt
    facts, start = readings(standing), height(falling)
    for step in range(1, round(SETTLE_S / dt) + 1):
        for robot in (standing, falling):
            target = getattr(robot.data.default_joint_pos, "torch", robot.data.default_joint_pos)
            robot.set_joint_position_target(target)
            robot.write_data_to_sim()
        simulation.step()
        for robot in (standing, falling):
            robot.update(dt)
        if step == round(FALL_S / dt) and not standing.is_fixed_base:
            facts.append(["robot", "robot", {fall_name!r}, start - height(falling)])
    if not standing.is_fixed_base:
        facts.append(["robot", "robot", {height_name!r}, height(standing)])
    file = Path(__file__).with_name("{module}_isaaclab.json")
    told = {{"format": {format!r}, "simulator": f"Isaac Lab {{GENERATION}}", "facts": facts}}
    file.write_text(json.dumps(told, indent=1) + "\\n", encoding="utf-8")
    print(f"written: {{file}}\\nnext: assetbuild diff BUNDLE {{file}}")


main()
app.close()
'''


def script(robot: str, module: str, tree: Tree) -> str:
    """The text of `<module>_isaaclab_measure.py`; `module` is the robot's name in Python."""
    return TEXT.format(
        robot=robot,
        module=module,
        upper=module.upper(),
        bodies=_other_names(body_identifiers(tree)),
        joints=_other_names(joint_identifiers(tree)),
        fall=FALL_S,
        settle=SETTLE_S,
        format=FORMAT,
        fall_name=FALL,
        height_name=HEIGHT,
    )


def _other_names(identifiers: Mapping[str, str]) -> str:
    return json.dumps({usd: own for own, usd in identifiers.items() if usd != own})
