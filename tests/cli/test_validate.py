"""`assetbuild validate` on files that nobody built: findings, exit codes, no traceback."""

from __future__ import annotations

import importlib.util
import json
import math
import os
from collections.abc import Callable
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
ARM = """<mujoco><worldbody><body name="arm"><joint name="a" range="-1 1"/>
<geom size="0.1"/></body></worldbody>{}</mujoco>"""
SHIFTED = robot(
    link("a", inertial(), shape("visual", box(0.2)), shape("collision", box(0.2), "0 0 {}"))
)
DRIVE = '<actuator><position joint="a" kp="{}" kv="20" forcerange="-9 9"/></actuator>'
STUCK = ARM.format(DRIVE).replace('name="a"', 'name="a" frictionloss="1"')
Validate = Callable[..., tuple[int, str]]


@pytest.fixture
def validate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Validate:
    """Write a file, where a text is given, and validate it: the exit code and what is said."""

    def run(name: str, text: str | None, *options: str) -> tuple[int, str]:
        path = tmp_path / name
        if text is not None:
            path.write_text(text)
        code = main(["validate", str(path), *options])
        said = capsys.readouterr()
        assert "Traceback" not in said.err
        return code, said.out if "--json" in options else said.out + said.err

    return run


def rules(said: str, *severities: str) -> set[str]:
    """Rules of all findings, as JSON, of these severities."""
    findings = [f for one in json.loads(said) for f in one["findings"]]
    return {f["rule"] for f in findings if not severities or f["severity"] in severities}


FILES: dict[str, tuple[str, str, int, str]] = {
    "a good MJCF": ("r.xml", ARM.format(""), 0, "0 errors"),
    "an empty range": (
        "r.xml", ARM.format('<actuator><motor joint="a" ctrlrange="2 1"/></actuator>'),
        1, "error lint.range",
    ),
    "a drive": ("r.xml", STUCK.format(100), 0, "0 errors"),
    "a drive whose gain is in N m per degree": ("r.xml", STUCK.format(1.7), 1, "error trials.dead"),
    "no step of time": ("r.xml", ARM.format('<option timestep="0"/>'), 1, "error mjcf.load"),
    "no gravity": ("r.xml", ARM.format('<option gravity="0 0 nan"/>'), 1, "error mjcf.load"),
    "two roots": ("r.xml", ARM.format("") + "<mujoco/>", 0, "lint.malformed"),
    "a zero byte": ("r.xml", ARM.format("") + "\0", 0, "lint.malformed"),
    "half a URDF": ("r.urdf", "<robot", 1, "urdf.unreadable"),
    "no USD": ("r.usda", "not usd", 1, "usd.unreadable"),
    "why a USD was not tried": ("r.usda", "not usd", 1, "trials.not_simulated"),
    "a file of another kind": ("a.txt", "x", 2, "error: "),
}  # fmt: skip


@pytest.mark.parametrize("what", FILES)
def test_a_file_that_nobody_built_is_judged(what: str, validate: Validate) -> None:
    name, text, expected, words = FILES[what]
    code, said = validate(name, text)
    assert (code, words in said) == (expected, True), said


def test_a_usd_on_top_of_what_is_none_is_unreadable(validate: Validate) -> None:
    validate("a.usda", "not usd")
    code, said = validate("b.usda", "#usda 1.0\n( subLayers = [@a.usda@] )\n")
    assert (code, "usd.unreadable" in said) == (1, True)


def test_a_file_that_is_not_there_and_a_folder_are_refused(validate: Validate) -> None:
    assert validate("missing.xml", None)[0] == 2
    assert "is no bundle" in validate("", None)[1]


def test_a_urdf_with_an_impossible_tensor(validate: Validate) -> None:
    code, said = validate("r.urdf", robot(link("r", inertial(1.0, tensor(9, 1, 1)))), "--json")
    assert code == 1
    assert "inertia.triangle" in rules(said)
    wide = robot(link("r", inertial(0.25, tensor(0.1, 0.1, 0.1))))
    said = validate("r.urdf", wide, "--static")[1]
    assert said.count(" inertia.radius:") == 1  # of the link and of the body that it is


def test_a_urdf_is_read_wherever_its_meshes_lie(validate: Validate, tmp_path: Path) -> None:
    """In a folder beside its own, as most packages have them, or nowhere."""
    text = robot(link("r", inertial(), shape("visual", mesh("../meshes/r.stl"))))
    assert "0 errors, 0 warnings" in validate("r.urdf", text, "--static")[1]
    assert main(["diff", str(tmp_path / "r.urdf"), str(tmp_path / "r.urdf")]) == 0


@pytest.mark.parametrize(
    ("moment", "lower", "found"),
    [
        (0.1, -20, set()),
        (1.0, -20, {"inertia.triangle"}),
        (math.nan, -20, {"inertia.mass"}),
        (0.1, 90, {"joint.limits"}),
    ],
)
def test_a_usd_that_no_validator_of_openusd_objects_to(
    moment: float, lower: float, found: set[str], validate: Validate
) -> None:
    stage = STAGE.format(moment=moment, lower=lower)
    code, said = validate("bot.usda", stage, "--json", "--static")
    assert (code, rules(said, "error")) == (int(bool(found)), found)


@pytest.mark.slow
def test_a_urdf_is_tried_as_init_would_build_it(
    validate: Validate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What only the built robot shows: collision beside what is seen."""
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "cache"))
    assert "0 errors, 0 warnings" in validate("r.urdf", SHIFTED.format(0))[1]
    code, said = validate("r.urdf", SHIFTED.format(0.06))
    assert (code, "warning coverage.shift" in said) == (0, True)
    assert "0 warnings" in validate("r.urdf", None, "--static")[1]
    assert [p.name for p in tmp_path.iterdir() if p.name != "cache"] == ["r.urdf"]


def test_a_urdf_that_cannot_be_built_says_why_it_was_not_tried(validate: Validate) -> None:
    text = SHIFTED.format(0).replace(box(0.2), mesh("package://nobody/a.stl"), 1)
    code, said = validate("r.urdf", text)
    assert (code, "warning trials.not_simulated" in said) == (0, True)
    assert "--package nobody=FOLDER" in said


def test_a_usd_is_tried_in_physx_or_says_how(validate: Validate) -> None:
    physx = importlib.util.find_spec("ovphysx") is not None
    tried = rules(validate("a.usda", CUBE, "--json")[1])
    assert ("physx.articulation" if physx else "trials.not_simulated") in tried
    assert "trials.not_simulated" not in validate("a.usda", CUBE, "--static")[1]


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
def test_a_pipe_is_not_read(pipe: str, validate: Validate, tmp_path: Path) -> None:
    mesh = '<compiler meshdir="meshes"/><asset><mesh file="a.obj"/></asset>'
    (tmp_path / "meshes").mkdir()
    os.mkfifo(tmp_path / pipe)
    code, said = validate("arm.xml", None if pipe == "arm.xml" else ARM.format(mesh))
    assert (code, "`a.obj`, which arm.xml names" in said) in ((2, False), (1, True))
