"""Small robots that together make a build use nearly every step there is."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from urdfs import SOUND, inertial, joint, link, mesh, robot, shape

METHODS = ("auto", "coacd", "hull", "primitive", "spheres", "vhacd", "keep")
FEW = {"vhacd": ", max_hulls: 2", "coacd": ", max_hulls: 2"}
RULES = ", ".join(f"{name}(_link)?: {{method: {name}{FEW.get(name, '')}}}" for name in METHODS)
RULES += ", base: {method: explicit, pieces: [{type: sphere, radius: 0.02}]}"
ARM = f"""schema: assetbuild/v1
robot: arm
source: {{path: arm.zip, urdf: arm.urdf, license: MIT}}
base: floating
edits:
  - set_mass: {{link: auto, mass: 1.5}}
  - set_inertia: {{link: coacd, inertia: {{ixx: 0.02, iyy: 0.02, izz: 0.02}}}}
  - set_limits: {{joint: to_hull, lower: -0.5, upper: 0.5}}
  - balance_inertia: {{link: flat}}
  - inertia_from_geometry: {{link: spheres, density: 500}}
  - flip_axis: {{joint: to_vhacd}}
  - perturb_axis: {{joint: to_keep, eps: 1e-5}}
  - share_mass: {{link: gimbal}}
  - rename: {{links: {{keep: keep_link}}}}
visual: {{max_faces: 200}}
collision:
  exclude: {{adjacent: true, sampled: 20}}
  links: {{{RULES}}}
actuators:
  - {{joints: ".*", model: pd, kp: 20, kd: 1, effort: 10, velocity: 5}}
keyframes: {{home: {{base: on_ground, joints: {{".*": 0}}}}}}
contact: {{friction: [0.8, 0.02, 0.01], condim: 3}}
targets: [urdf, mjcf, mjx, usd, mjlab, isaaclab]
validate: {{free_fall: {{}}, stand: {{keyframe: home, seconds: 0.2}}, sine: {{}}}}
"""
XACRO = """<robot name="post" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="tip" default="hand"/>
  <xacro:include filename="$(find cart_parts)/*.xacro"/>
  <xacro:body name="post"/><xacro:body name="$(arg tip)"/>
  <joint name="slip" type="planar"><parent link="post"/><child link="$(arg tip)"/>
    <axis xyz="0 0 1"/></joint>
</robot>
"""
PART = f"""<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="body" params="name"><link name="${{name}}"><inertial><mass value="2"/>
    {SOUND}</inertial></link></xacro:macro>
</robot>
"""
CART = """schema: assetbuild/v1
robot: cart
source:
  path: .
  xacro: post/post.xacro
  args: {tip: tray}
  packages: {cart_parts: post/parts}
  license: MIT
edits: [split_joint: {joint: slip}]
compose: [{recipe: pole.yaml, as: left_, at: {link: post, xyz: [0, 0, 0.2]}}]
targets: [mjcf]
"""
POLE = """schema: assetbuild/v1
robot: pole
source:
  path: .
  mjcf: xml/pole.xml
  license: MIT
  patches: [{file: xml/pole.xml, find: kp="4", replace: kp="5", because: a misprint}]
targets: [urdf, mjcf, usd, xrdf, policy]
xrdf: {acceleration: 10, jerk: 100, tool_frames: [pole]}
randomize: {links: {pole: {density: [0.9, 1.1], stretch: 0.1}}, friction: [0.5, 1.0]}
identify:
  - logs: [{file: pole.csv}]
    columns: {time: t, position: "q_{joint}", target: "u_{joint}"}
    fit: [damping]
"""
ROD = """schema: assetbuild/v1
robot: rod
source: {path: ., urdf: rod.urdf, license: MIT}
base: fixed
motor_file: motors.yaml
actuators: []
targets: [urdf]
"""
MJCF = """<mujoco><asset><mesh file="../lump.stl"/></asset><worldbody><body name="pole" pos="0 0 1">
  <joint name="swing" range="-60 60"/><geom type="mesh" mesh="lump" mass="1"/>
</body></worldbody><actuator><position joint="swing" kp="4"/></actuator></mujoco>
"""


def swinging() -> str:
    """A log of 4 s: what the pole is told, and how it follows some 60 ms later."""
    lines = ["t,q_swing,u_swing"]
    for t in np.arange(0.0, 4.0, 0.01):
        told, done = (0.3 * np.sin(2 * np.pi * (0.5 + 0.2 * s) * s) for s in (t, t - 0.06))
        lines.append(f"{t:.2f},{done:.5f},{told:.5f}")
    return "\n".join(lines) + "\n"


def write_robots(folder: Path) -> list[Path]:
    """Write the robots and give their recipes: from an archive, a xacro, an MJCF, a plain URDF."""
    lump = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    lump.vertices[:, 0] += 0.05 * np.abs(lump.vertices[:, 1] / 0.05)  # not convex
    lump.export(folder / "lump.stl")
    Image.new("RGB", (4, 4), (200, 10, 10)).save(folder / "red.png")
    (folder / "skin.png").symlink_to("red.png")
    (folder / "tile.obj").write_text(
        "mtllib tile.mtl\nusemtl skin\n" + "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
        "vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 3/3 2/2\nf 1/1 2/2 4/3\nf 1/1 4/2 3/3\nf 2/1 3/2 4/3\n"
    )
    (folder / "tile.mtl").write_text("newmtl skin\nKd 1 1 1\nmap_Kd skin.png\n")
    worn = shape("visual", mesh("lump.stl"))
    painted = '<material name="paint"><texture filename="skin.png"/></material></visual>'
    links = [
        link("base", inertial(), shape("visual", mesh("tile.obj"))),
        '<link name="gimbal"/>\n',
        link(
            "tip",
            inertial(),
            worn.replace("</visual>", painted),
            shape("collision", mesh("tile.obj")),
        ),
    ]
    joints = [
        joint("to_gimbal", "base", "gimbal", xyz="0 0.4 0", axis="1 0 0"),
        joint("to_tip", "gimbal", "tip", xyz="0 0 0", axis="0 1 0"),
    ]
    for number, name in enumerate((*METHODS, "flat")):
        solid = mesh("lump.stl")
        links.append(link(name, inertial(), shape("visual", solid), shape("collision", solid)))
        at = f"{0.3 * (number + 1)} 0 0"
        joints.append(joint(f"to_{name}", "base", name, xyz=at))
    (folder / "arm.urdf").write_text(robot(*links, *joints, name="arm"))
    with zipfile.ZipFile(folder / "arm.zip", "w") as archive:
        for name in ("arm.urdf", "lump.stl", "tile.obj", "tile.mtl", "skin.png"):
            archive.write(folder / name, name)
    texts = {"arm.yaml": ARM, "cart.yaml": CART, "pole.yaml": POLE, "rod.yaml": ROD}
    rod = link("rod", inertial(), shape("visual", mesh("tile.obj")))
    texts |= {"rod.urdf": robot(rod, name="rod"), "LICENSE": "MIT"}
    texts["motors.yaml"] = "hip: {rotor_inertia: 1.0e-4, gear: 6, effort: 30, velocity: 20}\n"
    texts |= {"post/post.xacro": XACRO, "post/parts/body.xacro": PART}
    texts |= {"xml/pole.xml": MJCF, "pole.csv": swinging()}
    for name in ("xml", "post/parts"):
        (folder / name).mkdir(parents=True)
    for name, text in texts.items():
        (folder / name).write_text(text)
    return [folder / f"{name}.yaml" for name in ("arm", "cart", "pole", "rod")]
