"""Wrong masses, limits and mimics are found in the source and in what is simulated."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from robot_files import run_step, write_source_ports
from tiny import TinyRobot, box_inertial, pendulum, tiny_quadruped

from assetbuild.body.lint import LintBodies, LintLinks
from assetbuild.findings import Finding
from assetbuild.robot.chains import split
from assetbuild.robot.codec import encode
from assetbuild.robot.model import Body, Inertial, Joint, JointKind, Limits, Mimic, Tree
from assetbuild.robot.shapes import Box, SourceShape, SourceShapes, Sphere

BRICK = box_inertial(1.0, (0.1, 0.1, 0.1))


def body(mass: float, xx: float, yy: float, zz: float, xy: float = 0.0) -> Inertial:
    return Inertial(mass, (0.0, 0.0, 0.0), (xx, yy, zz, xy, 0.0, 0.0))


def lint(
    tree: Tree, tmp_path: Path, shapes: SourceShapes | None = None, guessed: tuple[str, ...] = ()
) -> list[Finding]:
    robot = TinyRobot(tree, tree, shapes or SourceShapes())
    step = LintLinks(guessed=guessed)
    return run_step(step, write_source_ports(tmp_path / "in", robot), tmp_path / "out")


def arm(
    limits: Limits = Limits(-1.0, 1.0, 1.0, 1.0),  # noqa: B008 # frozen
    inertial: Inertial | None = BRICK,
    kind: JointKind = "revolute",
) -> Tree:
    joint = Joint("j", kind, "base", "arm", limits=limits)
    return Tree("arm", "fixed", (Body("base"), Body("arm", inertial)), (joint,))


@pytest.mark.parametrize("robot", [tiny_quadruped(), pendulum()])
def test_good_robots_have_no_warning(robot: TinyRobot, tmp_path: Path):
    inputs = write_source_ports(tmp_path / "in", robot)
    told = run_step(LintLinks(), inputs, tmp_path / "out")
    assert [f for f in told if f.severity != "info"] == []
    assert run_step(LintBodies(), inputs, tmp_path / "out") == []


@pytest.mark.parametrize(
    ("rule", "severity", "limits"),
    [
        ("joint.limits", "warning", Limits(1.0, -1.0, 1.0, 1.0)),
        ("joint.locked", "warning", Limits(0.0, 0.0, 1.0, 1.0)),
        ("joint.range", "warning", Limits(-8.0, 8.0, 1.0, 1.0)),
        ("joint.range", "info", Limits(-4.0, 4.0, 1.0, 1.0)),
        ("joint.range", "warning", Limits(-360.0, 360.0, 1.0, 1.0)),
        ("joint.range", "info", Limits(-1e6, 1e6, 1.0, 1.0)),
        ("joint.effort_zero", "warning", Limits(-1.0, 1.0, 0.0, 1.0)),
        ("joint.velocity_zero", "warning", Limits(-1.0, 1.0, 1.0, 0.0)),
    ],
)
def test_joint_limits_that_cannot_be_meant(
    rule: str, severity: str, limits: Limits, tmp_path: Path
):
    (finding,) = lint(arm(limits), tmp_path)
    assert (finding.rule, finding.severity, finding.subject) == (rule, severity, "joint j")


@pytest.mark.parametrize(("travel", "said"), [(10.5, True), (10.0, False)])
def test_a_slide_of_more_than_ten_metres_is_reported(travel: float, said: bool, tmp_path: Path):
    found = lint(arm(Limits(0.0, travel, 1.0, 1.0), kind="prismatic"), tmp_path)
    assert [(f.rule, f.severity) for f in found] == [("joint.range", "warning")] * said


def coupled(multiplier: float, offset: float = 0.0) -> Tree:
    """A finger of 0 to 0.5 rad that mimics another of the same range."""
    lead = Joint("lead", "revolute", "base", "a", limits=Limits(0.0, 0.5, 1.0, 1.0))
    follow = Joint(
        *("follow", "revolute", "base", "b"),
        limits=Limits(0.0, 0.5, 1.0, 1.0),
        mimic=Mimic("lead", multiplier, offset),
    )
    return Tree("gripper", "fixed", (Body("base"), Body("a", BRICK), Body("b", BRICK)),
                (lead, follow))  # fmt: skip


@pytest.mark.parametrize(
    ("multiplier", "offset", "led", "apart"),
    [
        (-1.0, 0.0, (-0.5, 0.0), True),  # only 0 suits both
        (1.5, 0.0, (0.0, 0.75), False),  # the leader may go to 0.333
        (1.0, 0.3, (0.3, 0.8), False),  # to 0.2
        (1.0, 0.7, (0.7, 1.2), True),
        (2.0, -0.2, (-0.2, 0.8), False),  # from 0.1 to 0.35
        (1.0, 0.0, None, False),
        (-1.0, 0.5, None, False),
        (0.4, 0.1, None, False),
    ],
)
def test_a_finger_that_is_led_over_its_limits(
    multiplier: float, offset: float, led: tuple[float, float] | None, apart: bool, tmp_path: Path
):
    """It is not ready where no position of the leader suits both."""
    found = lint(coupled(multiplier, offset), tmp_path)
    assert [(f.rule, f.severity, f.subject, f.unready) for f in found] == [
        ("joint.mimic_limits", "warning", "joint follow", apart)
    ] * (led is not None)
    for finding in found:
        assert (finding.data["led_lower"], finding.data["led_upper"]) == pytest.approx(led)


NOTHING = Inertial(0.0, (0.0,) * 3, (0.0,) * 6)


@pytest.mark.parametrize(
    ("inertial", "kind", "said"),
    [
        (None, "revolute", [("inertia.missing", "warning")]),
        (NOTHING, "revolute", [("inertia.mass", "warning")]),
        (None, "fixed", []),
        (NOTHING, "fixed", []),
        (body(0.02, 0.0, 0.0, 0.0), "fixed", [("inertia.positive", "info")]),
        (body(0.02, -1e-3, -1e-3, -1e-3), "fixed", [("inertia.positive", "warning")]),
        (body(0.02, 0.0, 0.0, 0.0), "revolute", [("inertia.positive", "warning")]),
    ],
)
def test_what_a_link_lacks_is_no_error_before_merging(
    inertial: Inertial | None, kind: JointKind, said: list[tuple[str, str]], tmp_path: Path
):
    """On a fixed joint it may be a frame without mass, or a point mass, which is exact."""
    found = lint(arm(inertial=inertial, kind=kind), tmp_path)
    assert [(f.rule, f.severity) for f in found] == said


@pytest.mark.parametrize(
    ("guessed", "invented"),
    [((), False), (("arm",), False), (("arm", "base"), True), ((".*",), True), (("ar",), False)],
)
def test_a_robot_all_of_whose_masses_are_guesses_is_not_ready(
    guessed: tuple[str, ...], invented: bool, tmp_path: Path
):
    robot = arm()
    bodies = tuple(replace(body, inertial=BRICK) for body in robot.bodies)
    found = lint(replace(robot, bodies=bodies), tmp_path, guessed=guessed)
    assert [(f.rule, f.unready) for f in found] == [("inertia.invented", True)] * invented


@pytest.mark.parametrize(
    ("bare", "seen", "severity"),
    [(0, 4, None), (1, 1, "info"), (1, 4, "info"), (2, 4, "info"), (3, 4, "warning"),
     (13, 17, "warning"), (4, 4, "warning")],
)  # fmt: skip
def test_links_without_collision_are_one_finding(
    bare: int, seen: int, severity: str | None, tmp_path: Path
):
    """A warning where more than half of what is seen passes through everything else."""
    names = [f"l{k}" for k in range(seen)]
    joints = tuple(Joint(f"j{n}", "fixed", names[0], n) for n in names[1:])
    tree = Tree("r", "fixed", tuple(Body(n, BRICK) for n in names), joints)
    box = Box((0.1, 0.1, 0.1))
    shapes = [SourceShape(f"{n}_seen", n, "visual", box) for n in names]
    shapes += [SourceShape(f"{n}_felt", n, "collision", box) for n in names[bare:]]
    found = lint(tree, tmp_path, SourceShapes(tuple(shapes)))
    assert [(f.rule, f.severity) for f in found] == (
        [("link.no_collision", severity)] if severity else []
    )
    for finding in found:
        assert finding.message.startswith(f"{bare} of {seen} links")
        assert finding.data["links"] == tuple(names[:bare])


def lint_bodies(
    folder: Path,
    *joints: Joint,
    inertial: Inertial | None = BRICK,
    shapes: SourceShapes | None = None,
) -> list[Finding]:
    """A base and its links, each of `inertial`, but for those called `between`."""
    links = [Body(j.child, None if j.child == "between" else inertial) for j in joints]
    tree = Tree("arm", "floating", (Body("base", BRICK), *links), joints)
    robot = TinyRobot(tree, tree, shapes or SourceShapes())
    return run_step(LintBodies(), write_source_ports(folder / "in", robot), folder / "out")


def lint_body(inertial: Inertial | None, folder: Path, kind: JointKind = "continuous"):
    return lint_bodies(folder, Joint("j", kind, "base", "arm"), inertial=inertial)


@pytest.mark.parametrize(("upper", "rules"), [(-1.5, ["joint.limits"]), (1.5, [])])
def test_crossed_limits_are_an_error_in_what_is_simulated(
    upper: float, rules: list[str], tmp_path: Path
):
    joint = Joint("j", "revolute", "base", "arm", limits=Limits(-1.0, upper, 1.0, 1.0))
    findings = lint_bodies(tmp_path, joint)
    assert [(f.rule, f.severity) for f in findings] == [(rule, "error") for rule in rules]


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
        # Rounding is no violation; what six numbers could state better is: MuJoCo refuses it.
        ("inertia.pseudo", "warning", body(1.0, 0.01, 0.01, 0.02 * (1 + 1e-13))),
        ("inertia.triangle", "warning", body(1.0, 0.01, 0.01, 0.02 * (1 + 1e-11))),
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
    (finding,) = lint_body(inertial, tmp_path)
    assert (finding.rule, finding.severity, finding.subject) == (rule, severity, "link arm")
    assert finding.hint


def test_the_heavy_link_of_a_large_arm_is_no_fault(tmp_path: Path):
    """A brick of 1.2 x 0.3 x 0.2 m and 60 kg: its moments are those of a ball of 0.56 m radius."""
    assert not lint_body(body(60.0, 0.65, 7.4, 7.65), tmp_path)


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
    shapes = SourceShapes((SourceShape("arm", "arm", "visual", Sphere(0.02)),))
    for density, expected in ((22_590.0, []), (40_000.0, [("inertia.dense", "warning")])):
        mass = density * ball
        inertial = body(mass, *(0.4 * mass * 0.02**2,) * 3)
        joint = Joint("j", "continuous", "base", "arm")
        found = lint_bodies(tmp_path / f"{density}", joint, inertial=inertial, shapes=shapes)
        assert [(f.rule, f.severity) for f in found] == expected


def test_a_massless_link_between_two_joints_is_told_and_no_error(tmp_path: Path):
    above = Joint("j", "continuous", "base", "between")
    below = Joint("k", "continuous", "between", "arm")
    (finding,) = lint_bodies(tmp_path, above, below)
    assert (finding.rule, finding.severity) == ("inertia.massless_intermediate_link", "info")
    assert finding.subject == "link between"
    assert finding.data["joints"] == ("j", "k")


def test_the_violation_is_told_as_a_number(tmp_path: Path):
    (finding,) = lint_body(body(1.0, 0.01, 0.01, 0.04), tmp_path)
    assert finding.data["violation"] == pytest.approx(0.5)
    assert finding.data["principal_kg_m2"] == pytest.approx((0.01, 0.01, 0.04))


def test_a_kept_body_without_mass_is_a_warning(tmp_path: Path):
    finding, empty = lint_body(None, tmp_path, kind="fixed")
    assert (finding.rule, finding.severity) == ("inertia.missing", "warning")
    assert (empty.rule, empty.unready) == ("robot.empty", True)  # nothing moves or has a shape
