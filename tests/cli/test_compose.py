"""A robot on a robot, from two recipes to one bundle, read back in MuJoCo and USD."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import mujoco
import pytest
from urdfs import inertial, joint, link, robot, shape, tensor

from .conftest import Place

BOX = '<box size="0.6 0.4 0.2"/>'
BALL = '<sphere radius="0.04"/>'
CART = robot(
    link("base", inertial(20, tensor(1, 1, 1)), shape("collision", BOX), shape("visual", BOX)),
    link("slide", inertial(2, tensor(0.1, 0.1, 0.1))),
    joint("joint1", "base", "slide", "prismatic", xyz="0 0 0.3", axis="0 0 1",
          content='<limit lower="0" upper="0.2" effort="200" velocity="1"/>'),
    name="cart",
)  # fmt: skip
ARM = robot(
    link("base", inertial(), shape("collision", BALL)),
    link("hand", inertial(0.5, xyz="0.2 0 0"), shape("collision", BALL, "0.2 0 0")),
    joint("joint1", "base", "hand", xyz="0 0 0.1"),
    name="arm",
)
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


def laid_out(folder: Path, store: Path | None = None) -> Place:
    """The cart, the arm and their recipes."""
    (folder / "cart.urdf").write_text(CART)
    (folder / "arm.urdf").write_text(ARM)
    (folder / "arm.yaml").write_text(RECIPE.format(name="arm", kp=40, home=0.3))
    (folder / "cart.yaml").write_text(RECIPE.format(name="cart", kp=900, home=0.1) + PARTS)
    return Place(folder, store or folder / "store", "cart.yaml")


@pytest.fixture
def cart(tmp_path: Path) -> Place:
    return laid_out(tmp_path)


@pytest.fixture(scope="module")
def checked(tmp_path_factory: pytest.TempPathFactory) -> Place:
    cart = laid_out(tmp_path_factory.mktemp("checked"))
    assert cart.run("check", "cart.yaml").returncode == 0
    return cart


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Place:
    cart = laid_out(tmp_path_factory.mktemp("cart"))
    cart.ran()
    return cart


def model_of(cart: Place) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(cart.bundle / "mjcf/cart.xml"))


@pytest.mark.slow
def test_a_part_whose_mesh_names_other_files_keeps_them(cart: Place):
    """The base is known before the part is: its questions are asked in rounds of their own."""
    corners = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\n"
    faces = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (cart.folder / "wedge.obj").write_text(f"mtllib paint.mtl\n{corners}usemtl red\n{faces}")
    (cart.folder / "paint.mtl").write_text("newmtl red\nKd 0.9 0.1 0.1\n")
    visual = '<visual><geometry><mesh filename="wedge.obj"/></geometry></visual>'
    (cart.folder / "arm.urdf").write_text(ARM.replace("<collision>", f"{visual}<collision>", 1))
    assert cart.run("check", "cart.yaml").returncode == 0
    cart.ran()
    model = model_of(cart)
    assert model.nmesh == 1, "both arms show the same wedge"
    assert 0.9 in model.mat_rgba[:, 0].round(6)


@pytest.mark.slow
def test_two_arms_on_a_cart_are_one_robot(built):
    model = model_of(built)
    assert model.body_mass.sum() == pytest.approx(22 + 2 * 1.5 + 0.25)
    joints = [model.joint(i).name for i in range(model.njnt)]
    assert joints == ["joint1", "left_joint1", "right_joint1"]
    assert model.actuator_gainprm[:, 0].tolist() == [900, 40, 40]
    assert model.key("home").qpos.tolist() == [0.1, 0.3, -0.5]

    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    left = data.body("left_hand").xpos
    assert left == pytest.approx([0.1, 0.1, 0.3 + 0.1 + 0.1 + 0.1])

    from pxr import Usd, UsdPhysics

    stage = Usd.Stage.Open(str(built.bundle / "usd/cart.usda"))
    roots = [p for p in stage.Traverse() if p.HasAPI(UsdPhysics.ArticulationRootAPI)]
    assert len(roots) == 1
    assert "cart" in (built.bundle / "NOTICE").read_text()


@pytest.mark.slow
def test_a_change_of_the_part_is_a_change_of_the_whole(built: Place, tmp_path: Path):
    cart = laid_out(tmp_path, shutil.copytree(built.store, tmp_path / "store"))
    cart.ran()
    assert "0 ran" in cart.build().stdout
    text = (cart.folder / "arm.yaml").read_text().replace("kp: 40", "kp: 41")
    (cart.folder / "arm.yaml").write_text(text)
    assert "mjcf" in cart.ran()
    assert model_of(cart).actuator_gainprm[:, 0].tolist() == [900, 41, 41]


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
def test_what_does_not_fit_is_told_with_its_line_in_its_own_recipe(
    checked: Place, tmp_path: Path, file: str, old: str, new: str, message: str
):
    cart = laid_out(tmp_path, checked.store)
    recipe = tmp_path / f"{file}.yaml"
    recipe.write_text(recipe.read_text().replace(old, new, 1))
    done = cart.run("check", "cart.yaml")
    assert done.returncode == 2, done.stdout + done.stderr
    assert f"error: {file}.yaml:" in done.stderr
    assert message in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_finding_about_a_row_of_a_part_has_its_line_in_the_parts_recipe(cart: Place):
    arm = (cart.folder / "arm.yaml").read_text().replace("kd: 5", "kd: 5, effort: 7")
    (cart.folder / "arm.yaml").write_text(arm)
    cart.ran()
    report = json.loads((cart.bundle / "report/report.json").read_text())
    found = [f for f in report["findings"] if f["rule"] == "actuator.overrides"]
    assert [(f["subject"], f["where"].rsplit(":", 1)[0]) for f in found] == [
        ("recipe actuators.1", "arm.yaml:5"), ("recipe actuators.2", "arm.yaml:5"),
    ]  # fmt: skip


@pytest.mark.slow
def test_samples_of_a_composite_draw_each_robot_from_its_own_ranges(cart: Place):
    for name, factor in (("cart", 3), ("arm", 2)):
        recipe = cart.folder / f"{name}.yaml"
        ranges = f'randomize: {{joints: {{".*": {{kp: [{factor}, {factor}]}}}}}}\n'
        recipe.write_text(recipe.read_text() + ranges)
    done = cart.run("sample", "cart.yaml", "-n", "1", "--judge", "1", "-o", "drawn")
    assert done.returncode == 0, done.stdout + done.stderr
    model = mujoco.MjModel.from_xml_path(str(cart.folder / "drawn/cart_000.xml"))
    assert model.actuator_gainprm[:, 0].tolist() == pytest.approx([2700, 80, 80])
