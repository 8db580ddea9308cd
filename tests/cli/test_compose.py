"""Robots on robots, MJCF and URDF: what MuJoCo's own `attach` makes, and what it forgets."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mjcfs import TET
from urdfs import inertial, joint, link, robot, shape, tensor

from .conftest import Place

DOG = """<mujoco model="dog">
  <compiler angle="radian"/>
  <option timestep="0.003" cone="elliptic" impratio="10"/>
  <worldbody>
    <body name="trunk" pos="0 0 0.4">
      <freejoint/>
      <inertial mass="5" pos="0 0 0.01" diaginertia="0.05 0.06 0.07"/>
      <geom name="trunk_collision" type="box" size="0.2 0.1 0.05" friction="0.4 0.01 0.001"/>
      <site name="imu"/>
      <body name="leg" pos="0.1 0 -0.05">
        <joint name="hip" axis="0 1 0" range="-1 1" armature="0.01"/>
        <inertial mass="1" pos="0 0 -0.1" diaginertia="0.01 0.01 0.001"/>
        <geom name="foot_collision" size="0.03" pos="0 0 -0.2" contype="3" conaffinity="2"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="hip" joint="hip" kp="50" kv="1" forcerange="-20 20"/></actuator>
  <sensor><gyro name="gyro" site="imu"/></sensor>
  <keyframe>
    <key name="home" qpos="0 0 0.3 1 0 0 0 0.2" ctrl="0.2"/>
    <key name="lie" qpos="0 0 0.1 1 0 0 0 -0.5"/>
  </keyframe>
</mujoco>
"""
ARM = """<mujoco model="arm">
  <compiler angle="degree"/>
  <option timestep="0.001" integrator="RK4"/>
  <worldbody>
    <camera name="beside" pos="1 0 0.5"/>
    <body name="base" pos="0 0 0.5">
      <inertial mass="1" pos="0 0 0.02" diaginertia="0.002 0.002 0.002"/>
      <geom name="base_collision" size="0.04" contype="2" conaffinity="0"/>
      <body name="link" pos="0 0 0.1" euler="0 0 90">
        <joint name="lift" axis="0 1 0" range="-90 90" damping="0.3" armature="0.02"/>
        <inertial mass="0.5" pos="0.1 0 0" diaginertia="0.001 0.002 0.002"/>
        <geom name="link_collision" type="capsule" size="0.02" fromto="0.05 0 0 0.2 0 0"
          contype="0" conaffinity="1" condim="4"/>
        <site name="tcp" pos="0.25 0 0"/>
        <body name="left" pos="0.2 0.02 0">
          <joint name="left" type="slide" axis="0 1 0" range="0 0.03"/>
          <inertial mass="0.05" pos="0 0 0" diaginertia="1e-5 1e-5 1e-5"/>
          <geom name="left_collision" size="0.01" contype="2" conaffinity="2"/>
        </body>
        <body name="right" pos="0.2 -0.02 0">
          <joint name="right" type="slide" axis="0 -1 0" range="0 0.03"/>
          <inertial mass="0.05" pos="0 0 0" diaginertia="1e-5 1e-5 1e-5"/>
          <geom name="right_collision" size="0.01" contype="2" conaffinity="2"/>
        </body>
      </body>
    </body>
  </worldbody>
  <contact><exclude body1="base" body2="left"/></contact>
  <tendon><fixed name="grip">
    <joint joint="left" coef="0.5"/><joint joint="right" coef="0.5"/>
  </fixed></tendon>
  <equality><joint name="same" joint1="left" joint2="right" polycoef="0 1 0.1 0 0"/></equality>
  <actuator>
    <position name="lift_drive" joint="lift" kp="30" kv="1"/>
    <position name="hand" tendon="grip" kp="100" ctrlrange="0 0.03"/>
  </actuator>
  <sensor>
    <framepos name="tcp_pos" objtype="site" objname="tcp"/>
    <tendonpos name="opening" tendon="grip"/>
    <subtreecom name="com" body="base"/>
  </sensor>
  <keyframe>
    <key name="home" qpos="0.5 0.01 0.01" ctrl="0.5 0.01"/>
    <key name="folded" qpos="-1 0 0" ctrl="-1 0"/>
  </keyframe>
</mujoco>
"""
POST = robot(
    link("foot", inertial(20, tensor(1, 1, 1)), shape("collision", '<box size="0.4 0.4 0.2"/>')),
    link("pole", inertial(2, tensor(0.1, 0.1, 0.1))),
    joint("rise", "foot", "pole", "prismatic", xyz="0 0 0.3", axis="0 0 1",
          content='<limit lower="0" upper="0.2" effort="500" velocity="1"/>'),
    name="post",
)  # fmt: skip
HEAD = """schema: assetbuild/v1
robot: {robot}
source: {{path: ., {kind}: {file}, license: MIT}}
collision: {{default: {{method: keep, from: collision}}}}
targets: [urdf, mjcf, mjx, usd, mjlab]
rules: {{usd.motion: {{severity: warning, because: "the fingers follow by a polynomial"}}}}
"""
DOG_RECIPE = """compose:
  - recipe: arm.yaml
    as: arm_
    at: {link: trunk, xyz: [0.1, 0, 0.06], rpy: [0, 0, 0.5]}
    home: {lift: 0.7}
"""
POST_RECIPE = """actuators:
  - {joints: rise, model: pd, kp: 5000, kd: 500}
  - {joints: left_lift, model: pd, kp: 7, kd: 1, effort: 9}
compose:
  - source: {path: ., mjcf: arm.xml, license: MIT}
    as: left_
    at: {link: pole, xyz: [0, 0.2, 0.1]}
  - recipe: arm.yaml
    as: right_
    at: {link: pole, xyz: [0, -0.2, 0.1]}
    home: {lift: -0.2}
"""


def laid_out(folder: Path, store: Path | None = None) -> Place:
    """The robots and their recipes."""
    files = {"dog": ("dog.xml", DOG), "arm": ("arm.xml", ARM), "post": ("post.urdf", POST)}
    more = {"dog": DOG_RECIPE, "arm": "", "post": POST_RECIPE}
    for name, (file, text) in files.items():
        (folder / file).write_text(text)
        kind = "mjcf" if file.endswith(".xml") else "urdf"
        recipe = HEAD.format(robot=name, kind=kind, file=file) + more[name]
        (folder / f"{name}.yaml").write_text(recipe)
    return Place(folder, store or folder / "store", "post.yaml")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Place:
    place = laid_out(tmp_path_factory.mktemp("composites"))
    done = place.build("dog.yaml", "-j", "2")
    assert done.returncode == 0, done.stdout + done.stderr
    return place


def model_of(place: Place, robot: str, file: str = "") -> mujoco.MjModel:
    path = place.folder / "build" / robot / "mjcf" / (file or f"{robot}.xml")
    return mujoco.MjModel.from_xml_path(str(path))


def findings(place: Place, robot: str) -> list[dict]:
    report = json.loads((place.folder / f"build/{robot}/report/report.json").read_text())
    return report["findings"]


@pytest.fixture(scope="module")
def attached() -> mujoco.MjModel:
    """MuJoCo's own composite: the arm's root 0.5 m up in its world, so the frame 0.5 m down."""
    spec, arm = mujoco.MjSpec.from_string(DOG), mujoco.MjSpec.from_string(ARM)
    turn = [np.cos(0.25), 0, 0, np.sin(0.25)]
    frame = spec.body("trunk").add_frame(pos=[0.1, 0, 0.06 - 0.5], quat=turn)
    spec.attach(arm, prefix="arm_", frame=frame)
    return spec.compile()


def inertia(model: mujoco.MjModel, body: int) -> np.ndarray:
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    turn = turn.reshape(3, 3)
    return turn @ np.diag(model.body_inertia[body]) @ turn.T


def names(model: mujoco.MjModel, kind: str, count: int) -> list[str]:
    return [getattr(model, kind)(number).name for number in range(count)]


@pytest.mark.slow
def test_the_whole_weighs_moves_and_senses_as_mujocos_own(built, attached):
    ours = model_of(built, "dog")
    for count in ("nq", "nv", "nbody", "nu", "nsensor", "neq", "ntendon", "ncam"):
        assert getattr(ours, count) == getattr(attached, count), count
    assert names(ours, "body", ours.nbody) == names(attached, "body", attached.nbody)
    joints = names(ours, "joint", ours.njnt)[1:]
    assert joints == names(attached, "joint", attached.njnt)[1:]
    for kind, count in (("actuator", ours.nu), ("sensor", ours.nsensor), ("tendon", ours.ntendon)):
        assert names(ours, kind, count) == names(attached, kind, count)
    assert ours.body_mass == pytest.approx(attached.body_mass, rel=1e-12)
    for body in range(1, ours.nbody):
        assert np.allclose(inertia(ours, body), inertia(attached, body), rtol=1e-9, atol=1e-14)
    for array in ("actuator_gainprm", "actuator_biasprm", "eq_data", "dof_armature"):
        assert getattr(ours, array) == pytest.approx(getattr(attached, array)), array
    random = np.random.default_rng(3)
    for _ in range(20):
        q = np.concatenate([random.normal(size=7), random.uniform(-1, 1, ours.nq - 7)])
        q[3:7] /= np.linalg.norm(q[3:7])
        mine, other = (moved_to(model, q) for model in (ours, attached))
        for array in ("xpos", "xmat", "cam_xpos", "sensordata"):
            assert np.allclose(getattr(mine, array), getattr(other, array), atol=1e-9), array
        mass = full_mass(ours, mine), full_mass(attached, other)
        assert np.allclose(*mass, rtol=1e-9, atol=1e-12)


def moved_to(model: mujoco.MjModel, q: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    return data


def full_mass(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full


@pytest.mark.slow
def test_options_are_the_bases_surfaces_and_excludes_the_parts(built):
    ours = model_of(built, "dog")
    assert ours.geom("trunk_collision").friction[0] == 0.4
    link = ours.geom("arm_link_collision")
    assert (link.friction[0], link.condim[0]) == (1, 4)
    pairs = [{int(s) >> 16, int(s) & 0xFFFF} for s in ours.exclude_signature]
    assert {ours.body("arm_base").id, ours.body("arm_left").id} in pairs
    assert (ours.opt.timestep, ours.opt.impratio) == (0.003, 10.0)
    assert ours.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    told = {f["rule"]: f["data"] for f in findings(built, "dog")}
    keys = {"option timestep", "option integrator", "keyframes.folded"}
    assert set(told["compose.left_out"]["keys"]) >= keys
    assert {"compose.masks", "compose.scenery"} <= told.keys()


@pytest.mark.slow
def test_each_keyframe_of_the_base_has_the_arms_home(built):
    """MuJoCo pads with qpos0; ours has both poses, and the commands that go with them."""
    ours = model_of(built, "dog")
    assert names(ours, "key", ours.nkey) == ["home", "lie"]
    # `home` of the row moves the lift; the fingers stay as the arm's own keyframe has them.
    assert ours.key("home").qpos[2:] == pytest.approx([0.3, 1, 0, 0, 0, 0.2, 0.7, 0.01, 0.01])
    assert ours.key("home").ctrl == pytest.approx([0.2, 0.7, 0.01])
    assert ours.key("lie").qpos[7:] == pytest.approx([-0.5, 0.5, 0.01, 0.01])
    assert ours.key("lie").ctrl == pytest.approx([-0.5, 0.5, 0.01])


@pytest.mark.slow
def test_two_arms_on_a_urdf_one_by_its_recipe_one_by_its_source(built):
    ours = model_of(built, "post")
    assert names(ours, "joint", ours.njnt) == [
        "rise", "left_lift", "left_left", "left_right", "right_lift", "right_left", "right_right",
    ]  # fmt: skip
    gains = dict(zip(names(ours, "actuator", ours.nu), ours.actuator_gainprm[:, 0], strict=True))
    # The row of the base takes the left arm's lift; its hand and the right arm drive themselves.
    assert gains == {
        "rise": 5000, "left_lift": 7, "right_lift_drive": 30, "left_hand": 100, "right_hand": 100,
    }  # fmt: skip
    assert ours.ntendon == 2
    assert ours.neq == 2
    assert ours.opt.timestep == 0.005  # the recipe's own default: the base is a URDF
    assert ours.body_mass.sum() == pytest.approx(22 + 2 * 1.6)
    home = dict(zip(names(ours, "joint", ours.njnt), ours.key("home").qpos, strict=True))
    assert (home["rise"], home["left_lift"], home["right_lift"]) == (0, 0.5, -0.2)
    told = [f for f in findings(built, "post") if f["rule"] == "compose.part"]
    assert len(told) == 2


@pytest.mark.slow
def test_the_usd_of_three_robots_is_one_articulation(built):
    from pxr import Usd, UsdPhysics

    bundle = built.folder / "build/post"
    stage = Usd.Stage.Open(str(bundle / "usd/post.usda"))
    roots = [p for p in stage.Traverse() if p.HasAPI(UsdPhysics.ArticulationRootAPI)]
    assert len(roots) == 1
    assert "post" in (bundle / "NOTICE").read_text()


@pytest.mark.slow
def test_a_change_of_the_part_is_a_change_of_the_whole(built, tmp_path):
    place = laid_out(tmp_path, shutil.copytree(built.store, tmp_path / "store"))
    place.ran()
    assert "0 ran" in place.build().stdout
    (tmp_path / "arm.xml").write_text(ARM.replace('kp="30"', 'kp="31"'))
    assert "mjcf" in place.ran()
    assert model_of(place, "post").actuator("right_lift_drive").gainprm[0] == 31


@pytest.mark.slow
def test_a_part_keeps_what_its_mesh_names_and_the_lines_of_its_recipe(tmp_path):
    """The base is known before the part is: its questions are asked in rounds of their own."""
    place = laid_out(tmp_path)
    (tmp_path / "wedge.obj").write_text(f"mtllib paint.mtl\nusemtl red\n{TET}")
    (tmp_path / "paint.mtl").write_text("newmtl red\nKd 0.9 0.1 0.1\n")
    wedge = '<mesh filename="wedge.obj" scale="0.1 0.1 0.1"/>'
    base = link("base", inertial(), shape("visual", wedge))
    (tmp_path / "arm.urdf").write_text(robot(base, link("hand"), joint("lift", "base", "hand")))
    head = HEAD.format(robot="arm", kind="urdf", file="arm.urdf")
    row = "actuators: [{joints: lift, model: pd, kp: 40, kd: 5, effort: 7}]\n"
    (tmp_path / "arm.yaml").write_text(head + row)
    rows = [f"  - {{recipe: arm.yaml, as: {side}_, at: {{link: pole}}}}\n" for side in "ab"]
    kept, _ = POST_RECIPE.split("  - {joints: left_lift")
    head = HEAD.format(robot="post", kind="urdf", file="post.urdf")
    place.recipe.write_text(f"{head}{kept}compose:\n{''.join(rows)}")
    assert place.run("check", "post.yaml").returncode == 0
    place.ran()
    model = model_of(place, "post")
    assert model.nmesh == 1, "both parts show the same wedge"
    assert 0.9 in model.mat_rgba[:, 0].round(6)
    told = [f for f in findings(place, "post") if f["rule"] == "actuator.overrides"]
    assert [(f["subject"], f["where"].rpartition(":")[0]) for f in told] == [
        ("recipe actuators.1", "arm.yaml:7"), ("recipe actuators.2", "arm.yaml:7"),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Place:
    """The post and its arms with a store that knows their names."""
    place = laid_out(tmp_path_factory.mktemp("known"))
    place.edit("[urdf, mjcf, mjx, usd, mjlab]", "[urdf]")
    place.ran()
    return place


WRIST = "rules:", "actuators: [{joints: wrist, model: passive}]\nrules:"
MOTOR = "rules:", "actuators: [{joints: lift, model: pd, kp: 1, kd: 1, motor: m}]\nrules:"
ELBOW = "rules:", "keyframes: {home: {joints: {elbow: 0.3}}}\nrules:"


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("post", "link: pole, xyz: [0, 0.2", "link: pol, xyz: [0, 0.2", "did you mean `pole`"),
        ("post", "as: right_", "as: left_", "begins with that of another part"),
        ("post", "as: left_", "as: pol", "`pole` of the base begins with the prefix `pol` too"),
        ("post", "recipe: arm.yaml", "recipe: arn.yaml", "did you mean `arm.yaml`"),
        ("post", "recipe: arm.yaml", "recipe: post.yaml", "is this recipe itself"),
        ("post", "recipe: arm.yaml", "recipe: dog.yaml", "is composed of parts itself"),
        ("post", "home: {lift: -0.2}", "home: {wrist: -0.2}", "matches no joint"),
        ("post", "- source: {path: ., mjcf: arm.xml, license: MIT}", "- variant: x", "exactly one"),
        ("post", "arm.xml, license: MIT}", "arm.xml}\n    variant: x", "a `source` has none"),
        ("post", "compose:", "keyframes: {up: {}}\ncompose:", "the base has no keyframe `home`"),
        ("arm", *MOTOR, "arm.yaml:6:53: actuators[0]: no motor named `m`"),
        ("arm", *WRIST, "arm.yaml:6:14: actuators[0].joints: pattern `wrist` matches no"),
        ("arm", *ELBOW, "pattern `elbow` matches no moving joint"),
    ],
)
def test_what_does_not_fit_is_told_with_its_line_in_its_own_recipe(
    known: Place, tmp_path: Path, file: str, old: str, new: str, message: str
):
    place = laid_out(tmp_path, known.store)
    Place(tmp_path, place.store, f"{file}.yaml").edit(old, new)
    said = place.refused("check", "post.yaml")
    assert message in said and f"{file}.yaml:" in said


def test_parts_that_a_variant_brings_are_refused_and_none_is_lost(known: Place, tmp_path: Path):
    place = laid_out(tmp_path, known.store)
    plain, parts = (tmp_path / "dog.yaml").read_text().split("compose:")
    rows = parts.replace("\n", "\n    ")
    (tmp_path / "dog.yaml").write_text(f"{plain}variants:\n  armed:\n    compose:{rows}\n")
    place.edit("recipe: arm.yaml", "recipe: dog.yaml\n    variant: armed")
    assert "`dog.yaml` is composed of parts itself" in place.refused("check", "post.yaml")
