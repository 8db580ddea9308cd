"""The script with which a user of Isaac Lab fills in Isaac Lab's half of the comparison.

It runs in Isaac Lab only, writes readings beside itself, and `assetbuild diff BUNDLE READINGS`
ranks them against the robot's. The check `smoke_isaaclab` runs it, too; what it measures is proven
in Isaac Lab itself.
"""

from __future__ import annotations

import json
from collections.abc import Mapping

from assetbuild.robot.model import Tree
from assetbuild.simulators.readings import FALL, FALL_S, FORMAT, HEIGHT, SETTLE_S
from assetbuild.simulators.usd_names import body_identifiers, joint_identifiers

TEXT = '''\
"""What {robot} is in Isaac Lab: read back, dropped, left standing.

    python {module}_isaaclab_measure.py --physics newton_mjwarp     # Isaac Lab 3; or ovphysx, physx
    ./isaaclab.sh -p {module}_isaaclab_measure.py --headless        # Isaac Lab 2, in Isaac Sim
    assetbuild diff BUNDLE {module}_isaaclab.json
"""

import argparse
import importlib.util
import json
import tempfile
from pathlib import Path

GENERATION = 3 if importlib.util.find_spec("isaaclab_physx") else 2
BODIES = {bodies}
"""Names of the robot by names of the USD, where they differ."""
JOINTS = {joints}
FALL_S, SETTLE_S, RAISED_M = {fall!r}, {settle!r}, 1.0
FLOOR = """#usda 1.0
( defaultPrim = "floor"
  metersPerUnit = 1
  upAxis = "Z" )
def Xform "floor" {{
    def Plane "plane" ( prepend apiSchemas = ["PhysicsCollisionAPI"] ) {{
        uniform token axis = "Z"
    }}
}}
"""


def main():
    parser = argparse.ArgumentParser(description="Read a robot back in Isaac Lab.")
    file = Path(__file__).with_name("{module}_isaaclab.json")
    parser.add_argument("--output", type=Path, default=file, help="where the readings go")
    if GENERATION == 3:
        from isaaclab.app import add_launcher_args, launch_simulation
        from isaaclab.physics import PhysicsCfg

        add_launcher_args(parser)
        parser.add_argument("--physics", default="physx", help="physx, ovphysx or newton_mjwarp")
        arguments = parser.parse_args()
        with launch_simulation(PhysicsCfg(), arguments) as physics:
            from {module}_isaaclab_3 import {upper}_CFG, NEWTON_CFG, SIMULATION_CFG

            physics = NEWTON_CFG if arguments.physics == "newton_mjwarp" else physics
            simulation = SIMULATION_CFG.replace(physics=physics, device=arguments.device)
            simulator = f"Isaac Lab 3, {{arguments.physics}}"
            write(measure({upper}_CFG, simulation), simulator, arguments.output)
    else:
        from isaaclab.app import AppLauncher

        AppLauncher.add_app_launcher_args(parser)
        arguments = parser.parse_args()
        app = AppLauncher(arguments).app  # the rest can be imported only now
        from {module}_isaaclab_2 import {upper}_CFG, SIMULATION_CFG

        write(measure({upper}_CFG, SIMULATION_CFG), "Isaac Lab 2", arguments.output)
        app.close()


def write(readings, simulator, file):
    readings["simulator"] = simulator
    file.write_text(json.dumps(readings, indent=1) + "\\n", encoding="utf-8")
    print(f"written: {{file}}\\nnext: assetbuild diff BUNDLE {{file}}")


def measure(robot_cfg, simulation_cfg):
    """Return the readings of one robot that stands and of one that falls from a metre."""
    import isaaclab.sim as sim_utils
    from isaaclab.assets import AssetBaseCfg
    from isaaclab.scene import InteractiveScene, InteractiveSceneCfg

    simulation = sim_utils.SimulationContext(simulation_cfg)
    plan = InteractiveSceneCfg(num_envs=1, env_spacing=20.0)
    plan.standing = placed(robot_cfg, "standing", 0.0, 0.0)
    plan.falling = placed(robot_cfg, "falling", 10.0, RAISED_M)
    with tempfile.TemporaryDirectory() as folder:
        floor = Path(folder) / "floor.usda"
        floor.write_text(FLOOR, encoding="utf-8")
        spawned = sim_utils.UsdFileCfg(usd_path=str(floor))
        plan.floor = AssetBaseCfg(prim_path="/World/floor", spawn=spawned)
        scene = InteractiveScene(plan)
        simulation.reset()
    standing, falling = scene["standing"], scene["falling"]
    dt, moves = simulation_cfg.dt, not standing.is_fixed_base
    facts, start = readings(standing, simulation_cfg), height(falling)
    for step in range(1, round(SETTLE_S / dt) + 1):
        for robot in (standing, falling):
            hold(robot)
        scene.write_data_to_sim()
        simulation.step()
        scene.update(dt)
        if step == round(FALL_S / dt) and moves:
            facts.append(["robot", "robot", {fall_name!r}, start - height(falling)])
    if moves:
        facts.append(["robot", "robot", {height_name!r}, height(standing)])
    return {{"format": {format!r}, "start_m": start - RAISED_M, "facts": facts}}


def placed(robot_cfg, name, x, z):
    x0, y0, z0 = robot_cfg.init_state.pos
    start = robot_cfg.init_state.replace(pos=(x0 + x, y0, z0 + z))
    return robot_cfg.replace(prim_path="{{ENV_REGEX_NS}}/" + name, init_state=start)


def hold(robot):
    target = getattr(robot.data.default_joint_pos, "torch", robot.data.default_joint_pos)
    if GENERATION == 3:
        robot.actuators.target_command.set_position_index(value=target)
    else:
        robot.set_joint_position_target(target)


def numbers(values):
    """Return the first environment's values as lists; Isaac Lab 3 wraps its tensors."""
    return getattr(values, "torch", values)[0].cpu().tolist()


def height(robot):
    return numbers(robot.data.root_pos_w)[2]


def drives(robot):
    """Return what drives hold, by joint; Isaac Lab 3 lets Newton compute explicit ones."""
    limits = {{}}
    for name, group in robot.actuators.items():
        if hasattr(group, "stiffness"):
            joints = group.joint_names
            columns = {{"kp": group.stiffness, "kd": group.damping}}
            if getattr(group, "is_implicit_model", False):
                limits = numbers(robot.data.joint_effort_limits)
                for joint, limit in zip(robot.joint_names, limits):
                    if joint in joints:
                        limits.setdefault(joint, {{}})["effort"] = limit
            else:
                columns["effort"] = group.effort_limit
        else:
            joints = robot.find_joints(robot.cfg.actuators[name].joint_names_expr)[1]
            columns = dict(in_newton(robot, name))
        for word, values in columns.items():
            for joint, value in zip(joints, numbers(values)):
                limits.setdefault(joint, {{}})[word] = value
    return limits


def in_newton(robot, name):
    from isaaclab.actuators.newton import read_group_parameter

    words = {{"kp": ["kp"], "kd": ["kd"]}}
    words |= {{"effort": ["max_effort", "max_motor_effort"], "stall": ["saturation_effort"]}}
    for word, attributes in words.items():
        part = "controller" if word in ("kp", "kd") else "clamping"
        for attribute in attributes:
            try:
                yield word, read_group_parameter(robot.actuators, name, part, attribute)
            except ValueError:
                pass  # a drive of another kind


def readings(robot, simulation_cfg):
    data, facts = robot.data, []
    masses = numbers(data.body_mass if hasattr(data, "body_mass") else data.default_mass)
    inertias = numbers(data.body_inertia if hasattr(data, "body_inertia") else data.default_inertia)
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
            facts.append([*own, quantity, limit if abs(limit) < 1e6 else None])  # it turns freely
        facts += [[*own, "armature", armature], [*own, "friction", friction]]
        facts.append([*own, "damping", damping])
        for word, value in held.get(name, {{}}).items():
            facts.append([*own, word, value if abs(value) < 1e6 else None])
    facts.append(["robot", "robot", "total mass, kg", sum(masses)])
    facts.append(["robot", "robot", "base", "fixed" if robot.is_fixed_base else "floating"])
    facts.append(["robot", "robot", "timestep, s", simulation_cfg.dt])
    facts.append(["robot", "robot", "gravity, m/s2", list(simulation_cfg.gravity)])
    return facts


if __name__ == "__main__":
    main()
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
