"""The script that measures in Isaac Lab, as `assetbuild diff` needs its readings.

It drops one robot from a metre for 0.3 s, lets another one stand for 2 s, and reads back what Isaac
Lab made of the robot's numbers. `MODULE`, `ROBOT` and the names stand for the robot's own.
"""

SCRIPT = r"""
import argparse
import importlib.util
import json
from pathlib import Path
from isaaclab.app import AppLauncher

parser = argparse.ArgumentParser(description=__doc__)
AppLauncher.add_app_launcher_args(parser)
app = AppLauncher(parser.parse_args()).app
import isaaclab.sim as sim_utils
from isaaclab.assets import Articulation

GENERATION = 3 if importlib.util.find_spec("isaaclab_physx") else 2
if GENERATION == 3:
    from MODULE_isaaclab_3 import ROBOT_CFG, SIMULATION_CFG
else:
    from MODULE_isaaclab_2 import ROBOT_CFG, SIMULATION_CFG
BODIES = BODY_NAMES
JOINTS = JOINT_NAMES
FALL_S, SETTLE_S, RAISED_M = (0.3, 2.0, 1.0)


def numbers(values):
    return getattr(values, "torch", values)[0].cpu().tolist()


def placed(path, x, z):
    x0, y0, z0 = ROBOT_CFG.init_state.pos
    start = ROBOT_CFG.init_state.replace(pos=(x0 + x, y0, z0 + z))
    return Articulation(ROBOT_CFG.replace(prim_path=path, init_state=start))


def height(robot):
    return numbers(robot.data.root_pos_w)[2]


def drives(robot):
    names, found = (robot.joint_names, {})
    for group in robot.actuators.values():
        for column, name in enumerate(group.joint_names):
            found[name] = [numbers(group.stiffness)[column], numbers(group.damping)[column]]
    return [found.get(name, [None, None]) for name in names]


def readings(robot):
    data, facts = (robot.data, [])
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
    implicit = {
        name
        for group in robot.actuators.values()
        if getattr(group, "is_implicit_model", False)
        for name in group.joint_names
    }
    for name, limits, (kp, kd), armature, effort in columns:
        own = ["joint", JOINTS.get(name, name)]
        for quantity, limit in zip(("lower", "upper"), limits):
            facts.append([*own, quantity, limit if abs(limit) < 1000000.0 else None])
        facts.append([*own, "armature", armature])
        if kp is not None:
            facts += [[*own, "kp", kp], [*own, "kd", kd]]
        if name in implicit:
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
    facts, start = (readings(standing), height(falling))
    for step in range(1, round(SETTLE_S / dt) + 1):
        for robot in (standing, falling):
            target = getattr(robot.data.default_joint_pos, "torch", robot.data.default_joint_pos)
            robot.set_joint_position_target(target)
            robot.write_data_to_sim()
        simulation.step()
        for robot in (standing, falling):
            robot.update(dt)
        if step == round(FALL_S / dt) and (not standing.is_fixed_base):
            facts.append(["robot", "robot", "fall in 0.3 s, m", start - height(falling)])
    if not standing.is_fixed_base:
        facts.append(["robot", "robot", "height after 2 s, m", height(standing)])
    file = Path(__file__).with_name("MODULE_isaaclab.json")
    told = {
        "format": "assetbuild.readings/v1",
        "simulator": f"Isaac Lab {GENERATION}",
        "facts": facts,
    }
    file.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    print(f"written: {file}\nnext: assetbuild diff BUNDLE {file}")


main()
app.close()
"""
