"""The script that measures in Isaac Lab, as `assetbuild diff` needs its readings.

It drops one robot from a metre for 0.3 s, lets another one stand for 2 s, and reads back what Isaac
Lab made of the robot's numbers. `MODULE`, `ROBOT` and the names stand for the robot's own.
"""

SCRIPT = r"""
import argparse
import importlib.util
import json
import tempfile
from pathlib import Path

GENERATION = 3 if importlib.util.find_spec("isaaclab_physx") else 2
BODIES = BODY_NAMES
JOINTS = JOINT_NAMES
FALL_S, SETTLE_S, RAISED_M = (0.3, 2.0, 1.0)
FLOOR = '#usda 1.0\n( defaultPrim = "floor"\n  metersPerUnit = 1\n  upAxis = "Z" )\ndef Xform "floor" {\n    def Plane "plane" ( prepend apiSchemas = ["PhysicsCollisionAPI"] ) {\n        uniform token axis = "Z"\n    }\n}\n'


def main():
    parser = argparse.ArgumentParser(description="Read a robot back in Isaac Lab.")
    file = Path(__file__).with_name("MODULE_isaaclab.json")
    parser.add_argument("--output", type=Path, default=file, help="where the readings go")
    if GENERATION == 3:
        from isaaclab.app import add_launcher_args, launch_simulation
        from isaaclab.physics import PhysicsCfg

        add_launcher_args(parser)
        parser.add_argument("--physics", default="physx", help="physx, ovphysx or newton_mjwarp")
        said = parser.parse_args()
        with launch_simulation(PhysicsCfg(), said) as physics:
            from MODULE_isaaclab_3 import ROBOT_CFG, NEWTON_CFG, SIMULATION_CFG

            physics = NEWTON_CFG if said.physics == "newton_mjwarp" else physics
            simulation = SIMULATION_CFG.replace(physics=physics, device=said.device)
            write(measure(ROBOT_CFG, simulation), f"Isaac Lab 3, {said.physics}", said.output)
    else:
        from isaaclab.app import AppLauncher

        AppLauncher.add_app_launcher_args(parser)
        said = parser.parse_args()
        app = AppLauncher(said).app
        from MODULE_isaaclab_2 import ROBOT_CFG, SIMULATION_CFG

        write(measure(ROBOT_CFG, SIMULATION_CFG), "Isaac Lab 2", said.output)
        app.close()


def write(told, simulator, file):
    told["simulator"] = simulator
    file.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    print(f"written: {file}\nnext: assetbuild diff BUNDLE {file}")


def measure(robot_cfg, simulation_cfg):
    import isaaclab.sim as sim_utils
    from isaaclab.assets import AssetBaseCfg
    from isaaclab.scene import InteractiveScene, InteractiveSceneCfg

    simulation = sim_utils.SimulationContext(simulation_cfg)
    plan = InteractiveSceneCfg(num_envs=1, env_spacing=20.0)
    floor = Path(tempfile.mkdtemp()) / "floor.usda"
    floor.write_text(FLOOR, encoding="utf-8")
    plan.floor = AssetBaseCfg(
        prim_path="/World/floor", spawn=sim_utils.UsdFileCfg(usd_path=str(floor))
    )
    plan.standing = placed(robot_cfg, "standing", 0.0, 0.0)
    plan.falling = placed(robot_cfg, "falling", 10.0, RAISED_M)
    scene = InteractiveScene(plan)
    simulation.reset()
    standing, falling = (scene["standing"], scene["falling"])
    dt, moves = (simulation_cfg.dt, not standing.is_fixed_base)
    facts, start = (readings(standing, simulation_cfg), height(falling))
    for step in range(1, round(SETTLE_S / dt) + 1):
        for robot in (standing, falling):
            hold(robot)
        scene.write_data_to_sim()
        simulation.step()
        scene.update(dt)
        if step == round(FALL_S / dt) and moves:
            facts.append(["robot", "robot", "fall in 0.3 s, m", start - height(falling)])
    if moves:
        facts.append(["robot", "robot", "height after 2 s, m", height(standing)])
    return {"format": "assetbuild.readings/v1", "start_m": start - RAISED_M, "facts": facts}


def placed(robot_cfg, name, x, z):
    x0, y0, z0 = robot_cfg.init_state.pos
    start = robot_cfg.init_state.replace(pos=(x0 + x, y0, z0 + z))
    return robot_cfg.replace(prim_path="{ENV_REGEX_NS}/" + name, init_state=start)


def hold(robot):
    target = getattr(robot.data.default_joint_pos, "torch", robot.data.default_joint_pos)
    if GENERATION == 3:
        robot.actuators.target_command.set_position_index(value=target)
    else:
        robot.set_joint_position_target(target)


def numbers(values):
    return getattr(values, "torch", values)[0].cpu().tolist()


def height(robot):
    return numbers(robot.data.root_pos_w)[2]


def drives(robot):
    found = {}
    for name, group in robot.actuators.items():
        if hasattr(group, "stiffness"):
            joints = group.joint_names
            columns = {"kp": group.stiffness, "kd": group.damping}
            if getattr(group, "is_implicit_model", False):
                limits = numbers(robot.data.joint_effort_limits)
                for joint, limit in zip(robot.joint_names, limits):
                    if joint in joints:
                        found.setdefault(joint, {})["effort"] = limit
            else:
                columns["effort"] = group.effort_limit
        else:
            joints = robot.find_joints(robot.cfg.actuators[name].joint_names_expr)[1]
            columns = dict(in_newton(robot, name))
        for word, values in columns.items():
            for joint, value in zip(joints, numbers(values)):
                found.setdefault(joint, {})[word] = value
    return found


def in_newton(robot, name):
    from isaaclab.actuators.newton import read_group_parameter

    words = {"kp": ["kp"], "kd": ["kd"]}
    words |= {"effort": ["max_effort", "max_motor_effort"], "stall": ["saturation_effort"]}
    for word, attributes in words.items():
        part = "controller" if word in ("kp", "kd") else "clamping"
        for attribute in attributes:
            try:
                yield (word, read_group_parameter(robot.actuators, name, part, attribute))
            except ValueError:
                pass


def readings(robot, simulation_cfg):
    data, facts = (robot.data, [])
    masses = numbers(data.body_mass if hasattr(data, "body_mass") else data.default_mass)
    inertias = numbers(
        data.body_inertia if hasattr(data, "body_inertia") else data.default_inertia
    )
    for name, mass, centre, rows in zip(
        robot.body_names, masses, numbers(data.body_com_pos_b), inertias
    ):
        own = ["body", BODIES.get(name, name)]
        facts.append([*own, "mass, kg", mass])
        if mass > 0.0:
            facts.append([*own, "centre of mass", centre])
            facts.append([*own, "inertia", [rows[place] for place in (0, 4, 8, 1, 2, 5)]])
    columns = zip(
        robot.joint_names,
        numbers(data.joint_pos_limits),
        numbers(data.joint_armature),
        numbers(data.joint_friction_coeff),
        numbers(data.joint_viscous_friction_coeff),
    )
    held = drives(robot)
    for name, limits, armature, friction, damping in columns:
        own = ["joint", JOINTS.get(name, name)]
        for quantity, limit in zip(("lower", "upper"), limits):
            facts.append([*own, quantity, limit if abs(limit) < 1000000.0 else None])
        facts += [[*own, "armature", armature], [*own, "friction", friction]]
        facts.append([*own, "damping", damping])
        for word, value in held.get(name, {}).items():
            facts.append([*own, word, value if abs(value) < 1000000.0 else None])
    facts.append(["robot", "robot", "total mass, kg", sum(masses)])
    facts.append(["robot", "robot", "base", "fixed" if robot.is_fixed_base else "floating"])
    facts.append(["robot", "robot", "timestep, s", simulation_cfg.dt])
    facts.append(["robot", "robot", "gravity, m/s2", list(simulation_cfg.gravity)])
    return facts


if __name__ == "__main__":
    main()
"""  # noqa: E501 # the text of the floor
