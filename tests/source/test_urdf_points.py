"""What URDFs of the wild say, in one robot, through a build: nothing lost, nothing silent.

Without USD, which refuses a planar joint and says so (`tests/targets/test_usd.py`).
"""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from urdfs import LIMIT, inertial, joint, link, shape

from assetbuild.cli import main

pytestmark = pytest.mark.slow

SPIN = "<limit effort='9' velocity='5'/>"
HALF = LIMIT + "<mimic joint='a' multiplier='-0.5'/>"
CAPSULE = shape("collision", "<capsule radius='0.02' length='0.1'/>")
PART = "<mesh filename='package:///bot/part.stl' scale='1 -2 1'/>"
MIRRORED = shape("visual", PART)
URDF = f"""<robot name="all of it">
  <mujoco><compiler discardvisual="false"/></mujoco>
  {link("base", inertial(), MIRRORED)}
  {link("world", inertial(), CAPSULE)}{joint("slide in a plane", "base", "world", "planar", "")}
  {link("left/hand #1")}{joint("a", "world", "left/hand #1")}
  {link("Finger é")}
  {joint("b", "left/hand #1", "Finger é", content=HALF)}
  {link("tip")}
  {joint("c", "Finger é", "tip", content=LIMIT + "<mimic joint='b' offset='0.1'/>")}
  <link name="tool0"/>{joint("flange", "tip", "tool0", "fixed", "")}
  {link("wheel")}{joint("roll", "world", "wheel", "continuous", SPIN)}
  <transmission name="t"><joint name="a"/></transmission>
  <gazebo reference="tip"/>
</robot>"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """(bundle, report)"""
    folder = tmp_path_factory.mktemp("urdf")
    (folder / "bot").mkdir()
    (folder / "bot/all.urdf").write_text(URDF)
    trimesh.creation.box((0.2, 0.1, 0.1)).export(folder / "bot/part.stl")
    (folder / "r.yaml").write_text(
        "schema: assetbuild/v1\nrobot: r\nbase: floating\ntargets: [urdf, mjcf]\n"
        "source: {path: ., urdf: bot/all.urdf, packages: {bot: bot}, license: MIT}\n"
        "actuators: [{joints: '.*', model: pd, kp: 5, kd: 1}]\n"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ASSETBUILD_CACHE", str(folder / "cache"))
        patch.setenv("MUJOCO_GL", "disable")
        main(["build", str(folder / "r.yaml"), "-o", str(folder / "out"), "--fail-on", "never"])
    report = json.loads((folder / "out/report/report.json").read_text())
    return folder / "out", report


def errors(report: dict) -> list[str]:
    return [
        f"{f['rule']} {f['subject']}: {f['message']}"
        for f in report["findings"]
        if f["severity"] == "error"
    ]


@pytest.mark.slow
def test_no_check_finds_an_error(built: tuple[Path, dict]):
    assert errors(built[1]) == []


def test_what_has_no_home_is_told(built: tuple[Path, dict]):
    dropped = {f["data"]["element"] for f in built[1]["findings"] if f["rule"] == "urdf.dropped"}
    assert {"mujoco", "transmission", "gazebo"} <= dropped


def test_names_that_a_format_does_not_allow_are_mapped_and_told(built: tuple[Path, dict]):
    bundle, report = built
    rules = {f"{f['rule']} {f['subject']}" for f in report["findings"]}
    assert "mjcf.reserved_name link world" in rules
    model = mujoco.MjModel.from_xml_path(str(bundle / "mjcf/r.xml"))
    names = {model.body(i).name for i in range(model.nbody)}
    assert {"world_body", "left/hand #1", "Finger é", "tip", "wheel"} <= names


def test_a_chain_of_mimics_follows_its_leader(built: tuple[Path, dict]):
    """b = -a/2, c = b + 0.1; a is held at 0.8 by its equations alone."""
    model = mujoco.MjModel.from_xml_path(str(built[0] / "mjcf/r.xml"))
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    for name, value in (("a", 0.8), ("b", -0.4), ("c", -0.3)):
        data.joint(name).qpos[0] = value
    mujoco.mj_forward(model, data)
    held = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    assert held.sum() == 2
    assert np.abs(data.efc_pos[: data.nefc][held]).max() < 1e-12


def test_planar_is_two_slides_and_a_turn(built: tuple[Path, dict]):
    model = mujoco.MjModel.from_xml_path(str(built[0] / "mjcf/r.xml"))
    kinds = [model.joint(f"slide in a plane_{end}").type[0] for end in ("x", "y", "yaw")]
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    assert kinds == [slide, slide, hinge]


def test_a_mirrored_mesh_keeps_its_size_and_its_inside(built: tuple[Path, dict]):
    parts = list((built[0] / "mjcf/assets").glob("*.obj"))
    assert parts  # what is seen, and its hull
    for part in parts:
        mesh = trimesh.load(part, process=True)
        assert mesh.extents == pytest.approx((0.2, 0.2, 0.1))
        assert mesh.volume == pytest.approx(0.2 * 0.2 * 0.1)  # positive: its normals point outward


def test_a_capsule_stays_a_capsule(built: tuple[Path, dict]):
    model = mujoco.MjModel.from_xml_path(str(built[0] / "mjcf/r.xml"))
    (capsule,) = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_CAPSULE)
    assert model.geom_size[capsule][:2] == pytest.approx((0.02, 0.05))
