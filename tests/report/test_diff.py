"""What changed between two robots: found, ranked, told once for subjects with the same change."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from robot_files import run_step, write_robot_ports
from tiny import TinyRobot, tiny_quadruped, with_mimic
from urdfs import inertial, joint, link, robot

from assetbuild.errors import UsageError
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key, Table
from assetbuild.report.diff import Changes, changes, counts, diff_markdown, diff_text
from assetbuild.report.sides import Form, Side, bundle_side, foreign_side
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.urdf import Urdf
from assetbuild.targets.usd import Usd

from .robots_for_tests import with_drives, with_joint

ROBOT = tiny_quadruped()


@pytest.fixture
def side(tmp_path: Path) -> Callable[..., Side]:
    """A robot as one side of a comparison."""

    def make(robot: TinyRobot = ROBOT, **more: Any) -> Side:
        ports = write_robot_ports(tmp_path / "ports", robot)
        table = robot_table(Reference.of_ports(ports, {}))
        return Side("r", {"robot": Form(lambda: table)}, **more)

    return make


def test_a_robot_does_not_differ_from_itself(side: Callable[..., Side]):
    assert changes(side(), side()) == Changes(())
    assert "no difference" in diff_text(side(), side(), Changes(()))


KP = ROBOT.control.actuators[0].kp
FIRST, THIRD = ROBOT.tree.moving_joints[0], ROBOT.tree.moving_joints[2]
LOWER = replace(FIRST.limits, lower=FIRST.limits.lower - 0.2)
TURNED = with_joint(ROBOT, THIRD.name, axis=tuple(-v for v in THIRD.axis))


@pytest.mark.parametrize(
    ("other", "rank", "quantity", "count", "note"),
    [
        (with_drives(ROBOT, kp=1.1 * KP), "HIGH", "kp", len(ROBOT.control.actuators), ""),
        (with_drives(ROBOT, kp=KP * math.pi / 180), "CRITICAL", "kp", 12, "degrees"),
        (TURNED, "CRITICAL", "axis", 1, "other way"),
        (with_joint(ROBOT, FIRST.name, limits=LOWER), "HIGH", "lower", 1, ""),
    ],
    ids=["a gain of all joints", "a gain in degrees", "a reversed axis", "a limit"],
)
def test_a_change_is_one_line_with_its_rank(side, other, rank, quantity, count, note):
    (change,) = changes(side(), side(other)).rows
    assert (change.rank, change.quantity, len(change.subjects)) == (rank, quantity, count)
    assert note in change.note


def test_what_links_say_as_their_bodies_do_is_said_once(side: Callable[..., Side]):
    def with_links(one: Side) -> Side:
        table = one.forms["robot"].read()
        joints = [(k, v) for k, v in table.facts.items() if k.kind == "joint"]
        whole = table | Table({Key("link's joint", k.name, k.quantity): v for k, v in joints})
        return replace(one, forms={"robot": Form(lambda: whole)})

    (change,) = changes(with_links(side()), with_links(side(with_drives(ROBOT, kp=1.1 * KP)))).rows
    assert not any(subject.startswith("link's") for subject in change.subjects)


def test_a_lost_joint_is_critical_and_nothing_more_is_said_of_it(side: Callable[..., Side]):
    name = ROBOT.tree.moving_joints[-1].name
    whole = side()
    fewer = whole.forms["robot"].read().only(lambda key: key.name != name)
    lost = replace(whole, forms={"robot": Form(lambda: fewer)})
    found = changes(whole, lost).rows
    assert [(c.rank, c.subjects) for c in found] == [("CRITICAL", (f"joint {name}",))]


def test_a_new_error_is_critical_a_new_warning_is_not_and_a_gone_one_is_low(
    side: Callable[..., Side],
):
    before = side(ready=True, findings={("a.a", "link x"): "warning"})
    new = {("b.b", "link x"): "error", ("c.c", "link x"): "warning"}
    after = side(ready=False, findings=new | {("d.d", "link x"): "a severity of another version"})
    found = changes(before, after)
    assert [(c.rank, c.quantity) for c in found.rows] == [
        ("CRITICAL", "ready for training"), ("CRITICAL", "finding b.b"),
        ("MEDIUM", "finding c.c"), ("LOW", "finding a.a"), ("LOW", "finding d.d")]  # fmt: skip
    assert counts(found) == "2 CRITICAL, 1 MEDIUM, 2 LOW"


def test_of_the_figures_of_a_check_that_grew_the_one_that_did_most_is_told(
    side: Callable[..., Side],
):
    """And no noise."""
    before = {"stand.drift_m": 0.106, "stand.sag.knee": 0.2, "gains.margin": 2.0, "gains.kp": 3.0}
    after = {"stand.drift_m": 0.243, "stand.sag.knee": 0.3, "gains.margin": 3.0, "gains.kp": 3.001}
    stand, gains = changes(side(figures=before), side(figures=after)).rows
    assert (stand.subjects, stand.quantity) == (("check stand",), "drift_m")
    assert (stand.before, stand.after, stand.note) == ("0.106", "0.243", "most of 2 figures")
    assert (gains.subjects, gains.quantity, gains.note) == (("check gains",), "margin", "")


def test_the_markdown_is_one_table_row_for_each_change(side: Callable[..., Side]):
    found = changes(side(), side(with_drives(ROBOT, kp=1.0, kd=1.0)))
    text = diff_markdown(side(), side(), found)
    assert text.count("\n| ") == len(found.rows) + 2


# --- bundles, file by file ------------------------------------------------------------------


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    """A bundle of two formats, and a copy of it that a test may change."""
    ports = write_robot_ports(tmp_path / "in", ROBOT)
    made = tmp_path / "bundle"
    for target, folder in ((Mjcf(robot="tiny"), "mjcf"), (Usd(robot="tiny"), "usd")):
        run_step(target, ports, tmp_path / "out" / folder)
        shutil.copytree(tmp_path / "out" / folder / folder, made / folder)
    (made / "report").mkdir()
    (made / "report/robot.json").write_text(Reference.of_ports(ports, {}).to_json())
    report = {"verdict": {"ready": True}, "findings": [], "checks": {}}
    (made / "report/report.json").write_text(json.dumps(report))
    (made / "report/index.html").write_text("<html>\n<p>A robot</p>\n</html>\n")
    (made / "manifest.json").write_text('{"robot": "tiny", "files": []}')
    shutil.copytree(made, tmp_path / "copy")
    return made


def edited(bundle: Path, file: str, old: str, new: str) -> Changes:
    """What differs after one change of a copy's file."""
    copy = bundle.with_name("copy")
    path = copy / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return changes(bundle_side(bundle), bundle_side(copy))


@pytest.mark.parametrize(
    ("file", "old", "new", "quantity", "form"),
    [
        ("mjcf/tiny.xml", '<joint name="FL_hip_joint"', '<joint name="FL_hip_joint" armature="9"',
         "armature", "mjcf"),
        ("mjcf/tiny.xml", 'friction="', 'friction="7', "friction", "mjcf"),
        ("mjcf/tiny.xml", "<option ", '<option wind="1 0 0" ', "mjcf:wind", "mjcf"),
        ("usd/payloads/physics.usda", "physics:mass = ", "physics:mass = 1", "mass", "usd"),
    ],
)  # fmt: skip
def test_an_edited_file_is_told_by_what_it_says(
    file: str, old: str, new: str, quantity: str, form: str, bundle: Path
):
    found = edited(bundle, file, old, new)
    assert quantity in {change.quantity for change in found.rows}
    assert any(form in change.forms for change in found.rows)


def test_what_no_fact_holds_is_told_by_its_place_in_the_file(bundle: Path):
    found = edited(bundle, "mjcf/scene.xml", 'pos="0 0 2.5"', 'pos="0 0 1"')
    notes = {change.note for change in found.rows if change.quantity == "light pos"}
    assert notes == {"mjcf/scene.xml"}


def test_a_comment_is_a_file_written_differently(bundle: Path):
    found = edited(bundle, "mjcf/tiny.xml", "<!-- ", "<!-- indeed: ")
    assert (found.rows, found.rewritten) == ((), ("mjcf/tiny.xml",))
    assert counts(found) == "no fact differs; 1 file is written differently"


def test_a_page_that_no_fact_explains_is_told_by_its_lines(bundle: Path):
    (change,) = edited(bundle, "report/index.html", "A robot", "A toaster").rows
    assert (change.subjects, change.quantity) == (("file report/index.html",), "line 2")
    assert "toaster" in change.after


def test_a_file_that_its_simulator_refuses_is_critical(bundle: Path):
    found = edited(bundle, "mjcf/tiny.xml", "<option ", "<option wings='2' ").rows
    assert {(c.rank, c.quantity) for c in found} == {("CRITICAL", "can be read")}
    assert all("wings" in change.note for change in found)


def test_a_file_that_is_gone_is_told(bundle: Path):
    (bundle.with_name("copy") / "report/index.html").unlink()
    (change,) = changes(bundle_side(bundle), bundle_side(bundle.with_name("copy"))).rows
    assert (change.subjects, change.before, change.after) == (
        ("file report/index.html",), "yes", "no")  # fmt: skip


# --- models in other formats ----------------------------------------------------------------


@pytest.mark.parametrize("target", [Mjcf, Usd, Urdf])
def test_our_own_files_say_the_same_as_the_robot(
    target: type, side: Callable[..., Side], tmp_path: Path
):
    """Masses, axes, limits and gains by another road: MuJoCo, pxr, the reader of sources."""
    inputs = write_robot_ports(tmp_path / "in", ROBOT)
    run_step(target(robot="tiny"), inputs, tmp_path / "out")
    name = {Mjcf: "mjcf/tiny.xml", Usd: "usd/tiny.usda", Urdf: "urdf/tiny.urdf"}[target]
    found = changes(side(), foreign_side(tmp_path / "out" / name)).rows
    assert [c for c in found if c.rank in ("CRITICAL", "HIGH")] == []


STAGE = """#usda 1.0
(defaultPrim = "bot"; metersPerUnit = 1; upAxis = "Z")
def Xform "bot" {{
    def Xform "torso" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {{
        float physics:mass = 4.1887902
        float3 physics:diagonalInertia = (0.01675516, 0.01675516, 0.01675516)
        double3 xformOp:translate = (0, 0, {height})
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Sphere "torso_geom" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {{
            double radius = {radius}
        }}
    }}
}}
"""
MODEL = """<mujoco><worldbody><body name="torso" pos="0 0 0.3"><freejoint/>
<geom name="torso_geom" size="0.1"/></body></worldbody></mujoco>"""


def test_masses_that_differ_in_the_seventh_digit_are_shown_as_short_as_can_be(tmp_path: Path):
    files = [tmp_path / "a.xml", tmp_path / "b.xml"]
    for file, mass in zip(files, ("0.25457647", "0.254576"), strict=True):
        body = f'<body name="a"><geom name="g" size="0.1" mass="{mass}"/></body>'
        file.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    (mass_row,) = (row for row in changes(*map(foreign_side, files)).rows if row.quantity == "mass")
    assert (mass_row.before, mass_row.after) == ("0.25457647 kg", "0.254576 kg")
    assert mass_row.note == ""  # not `x 1`


def test_an_unnamed_geom_more_leaves_those_of_other_bodies_alone(tmp_path: Path):
    before, after = tmp_path / "before.xml", tmp_path / "after.xml"
    body = '<body name="{0}"><geom size="{1}"/>{2}</body>'
    for file, more in ((before, ""), (after, '<geom size="0.3"/>')):
        bodies = body.format("a", 0.1, more) + body.format("b", 0.2, "")
        file.write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    shapes = [row.subjects for row in changes(foreign_side(before), foreign_side(after)).rows
              if row.subjects[0].startswith("shape ")]  # fmt: skip
    assert shapes == [("shape geom 1 of a",)]


@pytest.mark.parametrize(
    ("radius", "worst"), [("0.10000000149011612", {"LOW", "MEDIUM"}), ("0.11", {"HIGH"})]
)
def test_another_s_usd_is_as_exact_as_float32(radius: str, worst: set[str], tmp_path: Path):
    """Group 0 of MuJoCo collides as any other."""
    usd, rounded, mjcf = (tmp_path / name for name in ("a.usda", "b.usda", "torso.xml"))
    usd.write_text(STAGE.format(height=0.3, radius=0.1))
    rounded.write_text(STAGE.format(height=0.30000001192092896, radius=radius))
    mjcf.write_text(MODEL)
    for other in (usd, mjcf):
        ranks = {row.rank for row in changes(foreign_side(rounded), foreign_side(other)).rows}
        assert ranks & {"CRITICAL", "HIGH"} == worst & {"HIGH"}


@pytest.mark.parametrize("coupled", [True, False])
def test_a_usd_without_any_mimic_is_critical_beside_a_urdf_with_one(coupled: bool, tmp_path: Path):
    led = "FL_hip_joint", "FR_hip_joint", -1.0, 0.1
    links = with_mimic(replace(ROBOT, tree=ROBOT.links), *led).tree
    inputs = write_robot_ports(tmp_path / "in", replace(with_mimic(ROBOT, *led), links=links))
    options = UsdOptions.model_validate({"mimics": coupled})
    for target in (Usd(robot="bot", options=options), Urdf(robot="bot")):
        run_step(target, inputs, tmp_path / type(target).__name__)
    usd, urdf = (next(tmp_path.rglob(name)) for name in ("usd/bot.usda", "urdf/bot.urdf"))
    found = changes(foreign_side(usd), foreign_side(urdf)).rows
    lost = [(row.rank, row.subjects) for row in found if row.quantity == "mimics"]
    assert lost == ([] if coupled else [("CRITICAL", ("joint FL_hip_joint",))])


@pytest.mark.parametrize("content", ["", "[1, 2]", "<html/>"])
def test_what_is_no_model_is_refused_with_a_hint(content: str, tmp_path: Path):
    file = tmp_path / "x.xml"
    file.write_text(content)
    with pytest.raises(UsageError):
        foreign_side(file)
    with pytest.raises(UsageError):
        bundle_side(tmp_path)


def test_what_is_fixed_to_the_world_is_part_of_it_as_in_a_build(tmp_path: Path):
    held = joint("held", "world", "base", "fixed", xyz="0 0 0.1")
    text = robot(link("world", ""), link("base", inertial()), link("tip", inertial()), held,
                 joint("j", "base", "tip"))  # fmt: skip
    (tmp_path / "arm.urdf").write_text(text)
    (form,) = foreign_side(tmp_path / "arm.urdf").forms.values()
    assert form.read().of("body", "world")["mass"] == 1.0
