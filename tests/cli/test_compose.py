"""A robot on a robot, from two recipes to one bundle, read back in MuJoCo and USD."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import commands
import mujoco
import pytest

CART = """<robot name="cart">
  <link name="base">
    <inertial><mass value="20"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.6 0.4 0.2"/></geometry></collision>
    <visual><geometry><box size="0.6 0.4 0.2"/></geometry></visual>
  </link>
  <link name="slide">
    <inertial><mass value="2"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="joint1" type="prismatic"><parent link="base"/><child link="slide"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.2" effort="200" velocity="1"/></joint>
</robot>
"""
ARM = """<robot name="arm">
  <link name="base">
    <inertial><mass value="1"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.04"/></geometry></collision>
  </link>
  <link name="hand">
    <inertial><origin xyz="0.2 0 0"/><mass value="0.5"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0.2 0 0"/><geometry><sphere radius="0.04"/></geometry></collision>
  </link>
  <joint name="joint1" type="revolute"><parent link="base"/><child link="hand"/>
    <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="20" velocity="3"/></joint>
</robot>
"""
RECIPE = """schema: assetbuild/v1
robot: {name}
source: {{path: ., urdf: {name}.urdf, license: MIT}}
actuators:
  - {{joints: ".*", model: pd, kp: {kp}, kd: 5}}
keyframes:
  home: {{joints: {{joint1: {home}}}}}
targets: [mjcf, usd]
"""
PARTS = """compose:
  - recipe: arm.yaml
    as: left_
    at: {link: slide, xyz: [0.1, 0.1, 0.1]}
    mount: {mass: 0.25, size: [0.05, 0.05, 0.02], at: [0, 0, -0.01]}
  - recipe: arm.yaml
    as: right_
    at: {link: slide, xyz: [0.1, -0.1, 0.1], rpy: [0, 0, 1.5707963267948966]}
    home: {joint1: -0.5}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return laid_out(tmp_path)


def laid_out(folder: Path) -> Path:
    """The cart, the arm and their recipes."""
    (folder / "cart.urdf").write_text(CART)
    (folder / "arm.urdf").write_text(ARM)
    (folder / "arm.yaml").write_text(RECIPE.format(name="arm", kp=40, home=0.3))
    (folder / "cart.yaml").write_text(RECIPE.format(name="cart", kp=900, home=0.1) + PARTS)
    return folder


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the cart is built."""
    folder = laid_out(tmp_path_factory.mktemp("cart"))
    done = run(folder, "build", "cart.yaml")
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture
def warm(tmp_path: Path, built: Path) -> Path:
    """The folder of a cart that is not built, with a store in which its steps are done."""
    shutil.copytree(built / "store", tmp_path / "store")
    return laid_out(tmp_path)


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"ASSETBUILD_CACHE": str(folder / "store"), "MUJOCO_GL": "disable"}
    return commands.run(words, folder, environment)


@pytest.mark.slow
def test_a_part_whose_mesh_names_other_files_keeps_them(folder: Path):
    """The base is known before the part is: its questions are asked in rounds of their own."""
    corners = ("0 0 0", "0.1 0 0", "0 0.1 0", "0 0 0.1")
    faces = ("1 3 2", "1 2 4", "1 4 3", "2 3 4")
    text = [
        "mtllib paint.mtl",
        *(f"v {c}" for c in corners),
        "usemtl red",
        *(f"f {f}" for f in faces),
    ]
    (folder / "wedge.obj").write_text("\n".join(text) + "\n")
    (folder / "paint.mtl").write_text("newmtl red\nKd 0.9 0.1 0.1\n")
    visual = '<visual><geometry><mesh filename="wedge.obj"/></geometry></visual>'
    (folder / "arm.urdf").write_text(ARM.replace("<collision>", f"{visual}<collision>", 1))
    done = run(folder, "check", "cart.yaml")
    assert done.returncode == 0, done.stdout + done.stderr
    done = run(folder, "build", "cart.yaml")
    assert done.returncode == 0, done.stdout + done.stderr
    model = mujoco.MjModel.from_xml_path(str(folder / "build/cart/mjcf/cart.xml"))
    assert model.nmesh == 1, "both arms show the same wedge"
    assert 0.9 in model.mat_rgba[:, 0].round(6)


@pytest.mark.slow
def test_two_arms_on_a_cart_are_one_robot(built):
    model = mujoco.MjModel.from_xml_path(str(built / "build/cart/mjcf/cart.xml"))
    assert model.body_mass.sum() == pytest.approx(22 + 2 * 1.5 + 0.25)
    assert [model.joint(i).name for i in range(model.njnt)] == [
        "joint1",
        "left_joint1",
        "right_joint1",
    ]
    assert model.actuator_gainprm[:, 0].tolist() == [900, 40, 40]
    assert model.key("home").qpos.tolist() == [0.1, 0.3, -0.5]

    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    left = data.body("left_hand").xpos
    assert left == pytest.approx([0.1, 0.1, 0.3 + 0.1 + 0.1 + 0.1])

    from pxr import Usd, UsdPhysics

    stage = Usd.Stage.Open(str(built / "build/cart/usd/cart.usda"))
    roots = [p for p in stage.Traverse() if p.HasAPI(UsdPhysics.ArticulationRootAPI)]
    assert len(roots) == 1
    assert "cart" in (built / "build/cart/NOTICE").read_text()


@pytest.mark.slow
def test_a_change_of_the_part_is_a_change_of_the_whole(warm):
    folder = warm
    assert run(folder, "build", "cart.yaml").returncode == 0
    again = run(folder, "build", "cart.yaml")
    assert "0 ran" in again.stdout or "nothing" in again.stdout
    text = (folder / "arm.yaml").read_text().replace("kp: 40", "kp: 41")
    (folder / "arm.yaml").write_text(text)
    assert run(folder, "build", "cart.yaml").returncode == 0
    model = mujoco.MjModel.from_xml_path(str(folder / "build/cart/mjcf/cart.xml"))
    assert model.actuator_gainprm[:, 0].tolist() == [900, 41, 41]


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("cart", "link: slide", "link: slid", "did you mean `slide`"),
        ("cart", "as: right_", "as: left_", "begins with that of another part"),
        ("cart", "recipe: arm.yaml", "recipe: arn.yaml", "did you mean `arm.yaml`"),
        ("cart", "recipe: arm.yaml", "recipe: cart.yaml", "is this recipe itself"),
        ("cart", "home: {joint1: -0.5}", "home: {wrist: -0.5}", "matches no joint"),
        ("arm", "kd: 5", "kd: 5, motor: m", "arm.yaml:5:46: actuators[0]: no motor named `left_m`"),
        ("arm", '".*"', "wrist", "arm.yaml:5:6: actuators[0].joints: pattern `wrist` matches no"),
        ("arm", "joint1: 0.3", "elbow: 0.3", "pattern `elbow` matches no moving joint"),
    ],
)
def test_what_does_not_fit_is_told_with_its_line_in_its_own_recipe(folder, file, old, new, message):
    assert run(folder, "check", "cart.yaml").returncode == 0
    recipe = folder / f"{file}.yaml"
    recipe.write_text(recipe.read_text().replace(old, new, 1))
    done = run(folder, "check", "cart.yaml")
    assert done.returncode == 2, done.stdout + done.stderr
    assert f"error: {file}.yaml:" in done.stderr
    assert message in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_finding_about_a_row_of_a_part_has_its_line_in_the_parts_recipe(folder):
    arm = (folder / "arm.yaml").read_text().replace("kd: 5", "kd: 5, effort: 7")
    (folder / "arm.yaml").write_text(arm)
    assert run(folder, "build", "cart.yaml").returncode == 0
    report = json.loads((folder / "build/cart/report/report.json").read_text())
    found = [f for f in report["findings"] if f["rule"] == "actuator.overrides"]
    assert [(f["subject"], f["where"].rsplit(":", 1)[0]) for f in found] == [
        ("recipe actuators.1", "arm.yaml:5"),
        ("recipe actuators.2", "arm.yaml:5"),
    ]


@pytest.mark.slow
def test_samples_of_a_composite_draw_each_robot_from_its_own_ranges(folder):
    for name, factor in (("cart", 3), ("arm", 2)):
        text = (folder / f"{name}.yaml").read_text()
        ranges = f'randomize: {{joints: {{".*": {{kp: [{factor}, {factor}]}}}}}}\n'
        (folder / f"{name}.yaml").write_text(text + ranges)
    done = run(folder, "sample", "cart.yaml", "-n", "1", "--judge", "1", "-o", "drawn")
    assert done.returncode == 0, done.stdout + done.stderr
    model = mujoco.MjModel.from_xml_path(str(folder / "drawn/cart_000.xml"))
    assert model.actuator_gainprm[:, 0].tolist() == pytest.approx([2700, 80, 80])
