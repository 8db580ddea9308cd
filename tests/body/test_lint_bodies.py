"""Wrong mass properties of what will be simulated are errors, with numbers."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from tiny import TinyRobot, box_inertial, pendulum, run_step, tiny_quadruped, write_source_ports

from assetbuild.body.lint import LintBodies
from assetbuild.findings import Finding
from assetbuild.pipeline.recipes import whole_model
from assetbuild.robot.chains import split
from assetbuild.robot.codec import encode
from assetbuild.robot.inertia import InertiaBounds
from assetbuild.robot.model import Body, Inertial, Joint, Limits, Tree
from assetbuild.robot.shapes import SourceShape, SourceShapes, Sphere

BRICK = box_inertial(1.0, (0.1, 0.1, 0.1))


def body(mass: float, xx: float, yy: float, zz: float, xy: float = 0.0) -> Inertial:
    return Inertial(mass, (0.0, 0.0, 0.0), (xx, yy, zz, xy, 0.0, 0.0))


def lint(inertial: Inertial | None, tmp_path: Path, kind: str = "continuous") -> list[Finding]:
    joint = Joint("j", kind, "base", "arm")  # type: ignore[arg-type] # a literal
    tree = Tree("arm", "floating", (Body("base", BRICK), Body("arm", inertial)), (joint,))
    inputs = write_source_ports(tmp_path / "in", TinyRobot(tree, tree))
    return run_step(LintBodies(), inputs, tmp_path / "out")


@pytest.mark.parametrize(("upper", "rules"), [(-1.5, ["joint.limits"]), (1.5, [])])
def test_crossed_limits_are_an_error_in_what_is_simulated(
    upper: float, rules: list[str], tmp_path: Path
):
    joint = Joint("j", "revolute", "base", "arm", limits=Limits(-1.0, upper, 1.0, 1.0))
    tree = Tree("arm", "floating", (Body("base", BRICK), Body("arm", BRICK)), (joint,))
    inputs = write_source_ports(tmp_path / "in", TinyRobot(tree, tree))
    findings = run_step(LintBodies(), inputs, tmp_path / "out")
    assert [f.rule for f in findings] == rules
    assert all(f.severity == "error" for f in findings)


@pytest.mark.parametrize("robot", [tiny_quadruped(), pendulum()])
def test_good_robots_have_no_findings(robot: TinyRobot, tmp_path: Path):
    inputs = write_source_ports(tmp_path / "in", robot)
    assert run_step(LintBodies(), inputs, tmp_path / "out") == []


@pytest.mark.parametrize(
    ("rule", "severity", "inertial"),
    [
        ("inertia.missing", "error", None),
        ("inertia.mass", "error", body(0.0, 1.0, 1.0, 1.0)),
        ("inertia.positive", "error", body(1.0, 0.0, 0.01, 0.01)),
        ("inertia.positive", "error", body(1.0, 0.01, 0.01, 0.01, xy=0.02)),
        ("inertia.positive", "error", body(1.0, 1e-6, 1e-6, 3e-6, xy=1e-6)),
        ("inertia.triangle", "error", body(1.0, 0.01, 0.01, 0.03)),
        ("inertia.triangle", "warning", body(1.0, 0.01, 0.01, 0.0201)),
        ("inertia.pseudo", "warning", body(1.0, 0.01, 0.01, 0.02)),
        ("inertia.radius", "warning", body(1.0, 0.2, 0.2, 0.2)),
        ("inertia.radius", "warning", body(1.0, 50.0, 50.0, 50.0)),
        ("inertia.dense", "info", body(1.0, 1e-6, 1e-6, 1e-6)),
        ("inertia.dense", "error", body(1e-3, 0.9e-15, 0.9e-15, 0.9e-15)),
        ("inertia.mass_small", "warning", body(1e-4, 1e-8, 1e-8, 1e-8)),
    ],
)
def test_each_rule_fires_on_the_body_that_breaks_it(
    rule: str, severity: str, inertial: Inertial | None, tmp_path: Path
):
    (finding,) = lint(inertial, tmp_path)
    assert (finding.rule, finding.severity, finding.subject) == (rule, severity, "link arm")
    assert finding.hint


def test_the_light_links_of_a_split_joint_are_no_fault(tmp_path: Path):
    ball = Tree(
        "arm",
        "floating",
        (Body("base", BRICK), Body("arm", BRICK)),
        (Joint("j", "ball", "base", "arm"),),
    )
    light = body(1e-5, 1e-9, 1e-9, 1e-9)
    tree = split(ball, frozenset({"j"}))
    bodies = tuple(replace(b, inertial=b.inertial or light) for b in tree.bodies)
    tree = replace(tree, bodies=(*bodies, Body("mote", light)))
    tree = replace(tree, joints=(*tree.joints, Joint("k", "continuous", "arm", "mote")))
    inputs = write_source_ports(tmp_path / "in", TinyRobot(tree, tree))
    (inputs / "source_links.json").write_bytes(encode(ball))
    found = run_step(LintBodies(), inputs, tmp_path / "out")
    assert [(f.subject, f.severity) for f in found if f.rule == "inertia.mass_small"] == [
        ("link j_x_link", "info"),
        ("link j_y_link", "info"),
        ("link mote", "warning"),
    ]


def test_a_body_with_a_shape_is_no_denser_than_osmium(tmp_path: Path):
    """22,590 kg/m3 in a ball of 2 cm passes, 40,000 does not."""
    ball = 4.0 / 3.0 * math.pi * 0.02**3
    for density, expected in ((22_590.0, []), (40_000.0, [("inertia.dense", "warning")])):
        mass = density * ball
        inertial = body(mass, *(0.4 * mass * 0.02**2,) * 3)
        joint = Joint("j", "continuous", "base", "arm")
        tree = Tree("arm", "floating", (Body("base", BRICK), Body("arm", inertial)), (joint,))
        shapes = SourceShapes((SourceShape("arm", "arm", "visual", Sphere(0.02)),))
        inputs = write_source_ports(tmp_path / f"{density}", TinyRobot(tree, tree, shapes))
        found = run_step(LintBodies(), inputs, tmp_path / "out")
        assert [(f.rule, f.severity) for f in found] == expected


def test_a_massless_link_between_two_joints_is_told_and_no_error(tmp_path: Path):
    joints = (
        Joint("j", "continuous", "base", "between"),
        Joint("k", "continuous", "between", "arm"),
    )
    bodies = (Body("base", BRICK), Body("between"), Body("arm", BRICK))
    tree = Tree("arm", "floating", bodies, joints)
    inputs = write_source_ports(tmp_path / "in", TinyRobot(tree, tree))
    (finding,) = run_step(LintBodies(), inputs, tmp_path / "out")
    assert (finding.rule, finding.severity) == ("inertia.between", "info")
    assert finding.subject == "link between"
    assert finding.data["joints"] == ("j", "k")


def test_rounding_of_a_flat_tensor_is_no_violation(tmp_path: Path):
    (finding,) = lint(body(1.0, 0.01, 0.01, 0.02 * (1 + 1e-13)), tmp_path)
    assert finding.rule == "inertia.pseudo"


def test_what_six_numbers_could_state_better_is_a_violation(tmp_path: Path):
    """MuJoCo refuses it, so `init` must see it."""
    (finding,) = lint(body(1.0, 0.01, 0.01, 0.02 * (1 + 1e-11)), tmp_path)
    assert finding.rule == "inertia.triangle"


def test_the_violation_is_told_as_a_number(tmp_path: Path):
    (finding,) = lint(body(1.0, 0.01, 0.01, 0.04), tmp_path)
    assert finding.data["violation"] == pytest.approx(0.5)
    assert finding.data["principal_kg_m2"] == pytest.approx((0.01, 0.01, 0.04))


def test_the_bound_itself_is_allowed(tmp_path: Path):
    at_half_a_metre = 0.4 * 1.0 * 0.5**2
    assert lint(body(1.0, *(at_half_a_metre,) * 3), tmp_path) == []


def test_a_kept_body_without_mass_is_a_warning(tmp_path: Path):
    finding, empty = lint(None, tmp_path, kind="fixed")
    assert (finding.rule, finding.severity) == ("inertia.missing", "warning")
    assert (empty.rule, empty.unready) == ("robot.empty", True)  # nothing moves or has a shape


def test_go1s_singular_base_is_valid_once_merged(go1_root: Path, tmp_path: Path):
    from assetbuild.body.lint import LintLinks
    from assetbuild.body.merge_fixed_joints import MergeFixedJoints
    from assetbuild.source.urdf.read_urdf import ReadUrdf

    name = "robots/go1_description/urdf/go1.urdf"
    folder = tmp_path / "all"
    folder.mkdir()
    (folder / "robot.urdf").write_bytes((go1_root / name).read_bytes())
    read = ReadUrdf(file=name, base="floating", packages={"example-robot-data": "."})
    run_step(read, folder, folder)
    raw = run_step(LintLinks(), folder, folder)
    assert [(f.rule, f.severity) for f in raw] == [
        ("inertia.mass_small", "info"),
        ("inertia.positive", "info"),
    ]
    assert {f.subject for f in raw} == {"link base"}
    run_step(MergeFixedJoints(), folder, folder)
    assert run_step(LintBodies(), folder, folder) == []


def test_the_recipe_draws_the_lines():
    said = {"inertia": {"radius": 1.0, "triangle_slack": 0.2, "density": 8000, "small_mass": 0.1}}
    recipe = whole_model().model_validate(
        {
            "schema": "assetbuild/v1",
            "robot": "r",
            "source": {"path": ".", "urdf": "r.urdf"},
            "validate": said,
        }
    )
    bounds = recipe.validate_.inertia
    assert (bounds.radius, bounds.triangle_slack) == (1.0, 0.2)
    assert (bounds.density, bounds.small_mass) == (8000.0, 0.1)
    default = whole_model().model_validate(recipe.model_dump(by_alias=True) | {"validate": {}})
    assert default.validate_.inertia == InertiaBounds()
