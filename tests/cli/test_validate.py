"""`assetbuild validate` on files that nobody built: findings, exit codes, no traceback."""

from __future__ import annotations

import importlib.util
import json
import math
import os
from pathlib import Path

import pytest
from urdfs import box, inertial, link, mesh, robot, shape, tensor

from assetbuild.cli import main

CUBE = """#usda 1.0
(
    defaultPrim = "cube"
    metersPerUnit = 1
    upAxis = "Z"
)
def Xform "cube" (
    prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
)
{
    float physics:mass = 1
    def Cube "shape" (
        prepend apiSchemas = ["PhysicsCollisionAPI"]
    )
    {
        double size = 0.2
    }
}
"""
ARM = """<mujoco><worldbody><body name="arm"><joint name="a" range="-1 1"/>
<geom size="0.1"/></body></worldbody>{}</mujoco>"""


def ran(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    code = main(["validate", *map(str, arguments)])
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    return code, said.out if "--json" in arguments else said.out + said.err


def test_a_good_and_a_bad_mjcf(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, bad = tmp_path / "good.xml", tmp_path / "bad.xml"
    good.write_text(ARM.format(""))
    bad.write_text(ARM.format('<actuator><motor joint="a" ctrlrange="2 1"/></actuator>'))
    assert ran(capsys, good)[0] == 0
    code, said = ran(capsys, bad)
    assert code == 1
    assert "error lint.range" in said


def test_the_drives_of_a_foreign_mjcf_are_tried(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A gain in N m per degree moves nothing."""
    path = tmp_path / "arm.xml"
    drive = '<actuator><position joint="a" kp="{}" kv="20" forcerange="-9 9"/></actuator>'
    path.write_text(ARM.format(drive.format(100)).replace('name="a"', 'name="a" frictionloss="1"'))
    assert "trials.dead" not in ran(capsys, path)[1]
    path.write_text(ARM.format(drive.format(1.7)).replace('name="a"', 'name="a" frictionloss="1"'))
    code, said = ran(capsys, path)
    assert (code, "error trials.dead" in said) == (1, True)


def test_a_urdf_with_an_impossible_tensor(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(robot(link("r", inertial(1.0, tensor(9, 1, 1)))))
    code, said = ran(capsys, path, "--json")
    assert code == 1
    rules = {f["rule"] for one in json.loads(said) for f in one["findings"]}
    assert "inertia.triangle" in rules
    path.write_text(robot(link("r", inertial(0.25, tensor(0.1, 0.1, 0.1)))))
    said = ran(capsys, path, "--static")[1]
    assert said.count(" inertia.radius:") == 1  # of the link and of the body that it is
    path.write_text("<robot")
    assert "urdf.unreadable" in ran(capsys, path)[1]


def test_a_urdf_is_read_wherever_its_meshes_lie(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a folder beside its own, as most packages have them, or nowhere."""
    path = tmp_path / "r.urdf"
    path.write_text(robot(link("r", inertial(), shape("visual", mesh("../meshes/r.stl")))))
    assert "0 errors, 0 warnings" in ran(capsys, path, "--static")[1]
    assert main(["diff", str(path), str(path)]) == 0


SHIFTED = robot(
    link("a", inertial(), shape("visual", box(0.2)), shape("collision", box(0.2), "0 0 {}"))
)


STAGE = """#usda 1.0
(defaultPrim = "bot"; metersPerUnit = 1; upAxis = "Z")
def Xform "bot" {{
    def Xform "a" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsArticulationRootAPI"]) {{}}
    def Xform "b" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {{
        float physics:mass = 2
        float3 physics:diagonalInertia = ({moment}, 0.1, 0.1)
        quatf physics:principalAxes = (1, 0, 0, 0)
    }}
    def PhysicsRevoluteJoint "j" {{
        rel physics:body0 = </bot/a>
        rel physics:body1 = </bot/b>
        float physics:lowerLimit = {lower}
        float physics:upperLimit = 20
    }}
}}
"""


@pytest.mark.parametrize(
    ("moment", "lower", "rules"),
    [
        (0.1, -20, set()),
        (1.0, -20, {"inertia.triangle"}),
        (math.nan, -20, {"inertia.mass"}),
        (0.1, 90, {"joint.limits"}),
    ],
)
def test_a_usd_that_no_validator_of_openusd_objects_to(
    moment: float, lower: float, rules: set[str], tmp_path: Path, capsys
) -> None:
    path = tmp_path / "bot.usda"
    path.write_text(STAGE.format(moment=moment, lower=lower))
    code, said = ran(capsys, path, "--json", "--static")
    errors = {f["rule"] for f in json.loads(said)[0]["findings"] if f["severity"] == "error"}
    assert (code, errors) == (int(bool(rules)), rules)


@pytest.mark.slow
def test_a_urdf_is_tried_as_init_would_build_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What only the built robot shows: collision beside what is seen."""
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "cache"))
    path = tmp_path / "r.urdf"
    path.write_text(SHIFTED.format(0))
    assert "0 errors, 0 warnings" in ran(capsys, path)[1]
    path.write_text(SHIFTED.format(0.06))
    code, said = ran(capsys, path)
    assert (code, "warning coverage.shift" in said) == (0, True)
    assert "0 warnings" in ran(capsys, path, "--static")[1]
    assert [p.name for p in tmp_path.iterdir() if p.name != "cache"] == ["r.urdf"]


def test_a_urdf_that_cannot_be_built_says_why_it_was_not_tried(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "r.urdf"
    nobodys = mesh("package://nobody/a.stl")
    path.write_text(SHIFTED.format(0).replace(box(0.2), nobodys, 1))
    code, said = ran(capsys, path)
    assert (code, "warning trials.not_simulated" in said) == (0, True)
    assert "--package nobody=FOLDER" in said


def test_a_usd_is_tried_in_physx_or_says_how(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.usda"
    path.write_text(CUBE)
    said = ran(capsys, path, "--json")[1]
    rules = {f["rule"] for one in json.loads(said) for f in one["findings"]}
    physx = importlib.util.find_spec("ovphysx") is not None
    assert ("physx.articulation" if physx else "trials.not_simulated") in rules
    assert "trials.not_simulated" not in ran(capsys, path, "--static")[1]


def test_a_file_of_another_kind_or_none_is_a_wrong_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.txt").write_text("x")
    assert ran(capsys, tmp_path / "a.txt")[0] == 2
    assert ran(capsys, tmp_path / "missing.xml")[0] == 2
    assert "is no bundle" in ran(capsys, tmp_path)[1]


def test_a_usd_that_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.usda").write_text("not usd")
    code, said = ran(capsys, tmp_path / "a.usda")
    assert (code, "usd.unreadable" in said) == (1, True)
    assert "trials.not_simulated" in said
    (tmp_path / "b.usda").write_text("#usda 1.0\n( subLayers = [@a.usda@] )\n")
    code, said = ran(capsys, tmp_path / "b.usda")
    assert (code, "usd.unreadable" in said) == (1, True)


@pytest.mark.parametrize("more", ["<mujoco/>", "\0"])
def test_what_mujoco_reads_and_nobody_else_is_told(
    more: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.xml").write_text(ARM.format("") + more)
    code, said = ran(capsys, tmp_path / "arm.xml", "--static")
    assert (code, "lint.malformed" in said) == (0, True)


@pytest.mark.parametrize("option", ['<option timestep="0"/>', '<option gravity="0 0 nan"/>'])
def test_numbers_that_simulate_nothing_are_an_error(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.xml").write_text(ARM.format(option))
    code, said = ran(capsys, tmp_path / "arm.xml")
    assert (code, "error mjcf.load" in said) == (1, True)


@pytest.mark.parametrize(
    ("checks", "code", "line"),
    [({"a": {}}, 2, "report.json: not a report"), ({}, 0, "formats: not compared: built by an")],
)
def test_a_report_is_one_of_any_version(
    checks: object, code: int, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "report").mkdir()
    verdict = {"ready": True, "blocked_by": []}
    report = {"robot": "r", "verdict": verdict, "checks": checks, "findings": []}
    (tmp_path / "report/report.json").write_text(json.dumps(report))
    assert main(["report", str(tmp_path)]) == code
    output = capsys.readouterr()
    assert line in output.out + output.err and not (output.out and output.err)


@pytest.mark.parametrize("pipe", ["arm.xml", "meshes/a.obj"])
def test_a_pipe_is_not_read(pipe: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = '<compiler meshdir="meshes"/><asset><mesh file="a.obj"/></asset>'
    (tmp_path / "meshes").mkdir()
    os.mkfifo(tmp_path / pipe)
    if pipe != "arm.xml":
        (tmp_path / "arm.xml").write_text(ARM.format(mesh))
    code, said = ran(capsys, tmp_path / "arm.xml")
    assert (code, "`a.obj`, which arm.xml names" in said) in ((2, False), (1, True))
