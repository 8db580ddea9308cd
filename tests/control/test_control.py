"""The recipe's tables on a robot: gains, poses on the ground, excludes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from robot_files import run_step
from tiny import standing_height, tiny_quadruped, with_mimic

from assetbuild.control.plan import control_step
from assetbuild.engine.step import Files
from assetbuild.pipeline.recipes import whole_model
from assetbuild.recipe.models import Recipe
from assetbuild.robot.actuators import RowError
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.model import Control, Limits, Tree
from assetbuild.robot.pose import Pose, quat_of_rpy
from assetbuild.robot.shapes import Mesh, MeshAsset, Shape, Shapes, Sphere

TREE = tiny_quadruped().tree
FEET = Shapes(tuple(s for s in tiny_quadruped().shapes.shapes if s.link.endswith("_foot")))


def recipe(**keys: object) -> Recipe:
    head = {"schema": "assetbuild/v1", "robot": "r", "source": {"path": "p", "urdf": "r.urdf"}}
    table = [{"joints": ".*", "kp": 80.0, "kd": 4.0}]
    return whole_model().model_validate({**head, "actuators": table, **keys})


@pytest.fixture
def run(tmp_path):
    """Run the control step; the control and its findings by rule."""
    (tmp_path / "in/meshes").mkdir(parents=True)
    (tmp_path / "out").mkdir()

    def run_step(tree: Tree, shapes: Shapes, said: Recipe, **meshes: str):
        (tmp_path / "in/tree.json").write_bytes(encode(tree))
        (tmp_path / "in/shapes.json").write_bytes(encode(shapes))
        for name, text in meshes.items():
            (tmp_path / f"in/meshes/{name}.obj").write_text(text)
        findings = list(control_step(said).run(Files(tmp_path / "in", tmp_path / "out")))
        control = decode(Control, (tmp_path / "out/control.json").read_bytes())
        return control, {finding.rule: finding for finding in findings}

    return run_step


def refused(tree: Tree, said: Recipe) -> RowError:
    with pytest.raises(RowError) as caught:
        control_step(said).check(tree)
    return caught.value


HOME = {".*_thigh_joint": 0.8, ".*_calf_joint": -1.6}


def test_soles_touch_the_ground_by_the_formula_of_a_two_link_leg(run):
    seen = Shape("v", "trunk", "visual", Sphere(5.0))  # only collision geometry counts
    shapes = Shapes((seen, *FEET.shapes))
    control, findings = run(TREE, shapes, recipe(keyframes={"home": {"joints": HOME}}))
    (home,) = control.keyframes
    assert home.base.xyz == pytest.approx((0.0, 0.0, standing_height(0.8)), abs=1e-12)
    assert home.base.quat == (1.0, 0.0, 0.0, 0.0)
    assert findings == {}


def test_a_mesh_touches_with_its_lowest_vertex(run):
    # A tetrahedron, turned by 90 deg about y: its x becomes -z. The last vertex has no face.
    text = "v 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 1\nv 9 9 9\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    shape = Shape("m", "trunk", "collision", Mesh("t-1"), Pose(quat=quat_of_rpy(0, math.pi / 2, 0)))
    shapes = Shapes((shape,), meshes=(MeshAsset("t-1", "t-1.obj", 5, 4, True),))
    said = recipe(keyframes={"home": {}})
    control, _ = run(TREE, shapes, said, **{"t-1": text})
    assert control.keyframes[0].base.xyz[2] == pytest.approx(2.0, abs=1e-12)


def test_without_collision_geometry_there_is_no_ground_and_it_is_said(run):
    control, findings = run(TREE, Shapes(), recipe(keyframes={"home": {}}))
    assert findings["keyframe.no_ground"].severity == "warning"
    assert control.keyframes[0].base == Pose()


def test_a_given_base_is_taken_as_it_is_and_a_fixed_one_stays_and_says_so(run):
    said = recipe(keyframes={"a": {}, "b": {"base": (0.1, 0.2, 1.0)}})
    control, _ = run(TREE, FEET, said)
    assert control.keyframes[1].base == Pose((0.1, 0.2, 1.0))
    control, findings = run(replace(TREE, base="fixed"), FEET, said)
    assert [k.base for k in control.keyframes] == [None, None]
    assert findings["keyframe.fixed_base"].data == {"keyframe": "b"}


def test_joints_stand_in_tree_order_and_unnamed_ones_are_zero(run):
    said = recipe(keyframes={"home": {"joints": {"RR_calf_joint": -1.0, "FL_.*": 0.5}}})
    control, _ = run(TREE, FEET, said)
    home = control.keyframes[0]
    assert [name for name, _ in home.joints] == [joint.name for joint in TREE.joints]
    values = dict(home.joints)
    assert (values["FL_thigh_joint"], values["RR_calf_joint"]) == (0.5, -1.0)
    assert values["FR_thigh_joint"] == 0.0


def with_calf_limits(lower: float | None, upper: float | None) -> Tree:
    limits = Limits(lower, upper, 9.0)
    joints = (replace(j, limits=limits) if j.name == "FL_calf_joint" else j for j in TREE.joints)
    return replace(TREE, joints=tuple(joints))


BENT, FREE = (-2.8, -0.8), (None, None)


@pytest.mark.parametrize(
    ("limits", "joints", "rule", "severity", "words"),
    [
        (BENT, {"FL_calf_joint": -3.2}, "keyframe.limits", "error", "-3.2 rad is outside"),
        (BENT, {"FL_calf_joint": -90}, "keyframe.limits", "error", "-90 degrees are -1.571"),
        (BENT, {}, "keyframe.limits", "error",
         "no pattern of the keyframe matches it, so it is 0"),
        (FREE, {"FL_calf_joint": -90}, "keyframe.turns", "warning", "14.3 turns"),
        (FREE, {"FL_calf_joint": -90}, "keyframe.turns", "warning", "-1.571"),
        (FREE, {"FL_calf_joint": 6.28}, None, None, None),
    ],
)  # fmt: skip
def test_angles_that_a_joint_does_not_reach_or_that_are_degrees_are_told(
    run, limits, joints, rule, severity, words
):
    bent = {"(FR|RR|RL)_calf_joint": -1.6}
    said = recipe(keyframes={"home": {"joints": bent | joints}})
    _, findings = run(with_calf_limits(*limits), FEET, said)
    assert list(findings) == ([rule] if rule else [])
    for finding in findings.values():
        assert (finding.severity, finding.subject) == (severity, "joint FL_calf_joint")
        assert words in f"{finding.message}: {finding.hint}"
        if rule == "keyframe.limits":
            value = joints.get("FL_calf_joint", 0.0)
            assert finding.data == {
                "keyframe": "home", "value": value, "lower": -2.8, "upper": -0.8,
            }  # fmt: skip


LED = with_mimic(tiny_quadruped(), "FL_thigh_joint", "FR_thigh_joint", 8.0, 0.0).tree


def test_mimic_joints_follow_and_are_checked_too(run):
    control, findings = run(LED, FEET, recipe(keyframes={"home": {"joints": HOME}}))
    assert dict(control.keyframes[0].joints)["FL_thigh_joint"] == 6.4
    assert findings["keyframe.limits"].subject == "joint FL_thigh_joint"
    assert findings["keyframe.limits"].hint == "it follows `FR_thigh_joint`"


@pytest.mark.parametrize(
    ("tree", "joints", "key", "said"),
    [
        (TREE, {".*_kalf": 1.0}, ".*_kalf", "matches no moving joint"),
        (TREE, {"FL_.*": 1, ".*_calf_.*": 2}, ".*_calf_.*", "`FL_calf_joint` is matched by"),
        (LED, {"FL_thigh_joint": 0.1}, "FL_thigh_joint", "mimic others"),
    ],
)
def test_a_pattern_of_no_joint_two_or_a_follower_is_an_error_with_its_key(tree, joints, key, said):
    error = refused(tree, recipe(keyframes={"home": {"joints": joints}}))
    assert error.key == ("keyframes", "home", "joints", key)
    assert said in error.message


def test_adjacent_bodies_and_pairs_of_links_are_excluded(run):
    pairs = (("trunk", "FL_foot"), ("FR_calf", "FL_foot"))
    control, _ = run(TREE, FEET, recipe(collision={"exclude": {"pairs": pairs}}))
    adjacent = {("FL_hip", "trunk"), ("FL_calf", "FL_thigh")}
    assert adjacent <= set(control.excludes)
    assert ("FL_calf", "trunk") in control.excludes
    assert ("FL_calf", "FR_calf") in control.excludes
    assert len(control.excludes) == 12 + 2
    assert list(control.excludes) == sorted(control.excludes)
    said = recipe(collision={"exclude": {"adjacent": False, "pairs": (("trunk", "FL_foot"),)}})
    assert run(TREE, FEET, said)[0].excludes == (("FL_calf", "trunk"),)


def test_a_pair_that_fixed_joints_made_one_body_is_reported(run):
    said = recipe(collision={"exclude": {"pairs": (("FL_calf", "FL_foot"),)}})
    _, findings = run(TREE, FEET, said)
    assert findings["exclude.same_body"].severity == "info"


def test_an_unknown_link_in_a_pair_is_an_error_with_its_key():
    error = refused(TREE, recipe(collision={"exclude": {"pairs": (("trunk", "FL_fot"),)}}))
    assert error.key == ("collision", "exclude", "pairs", 0, 1)
    assert error.hint == "did you mean `FL_foot`?"


@pytest.mark.parametrize("rows", [(), ({"joints": ".*", "model": "passive"},)])
def test_where_all_is_passive_it_is_said(run, rows):
    """Without a table, and by what `init` writes where the source states no effort."""
    control, findings = run(TREE, FEET, recipe(actuators=rows))
    assert {a.model for a in control.actuators} == {"passive"}
    found = findings["actuator.none"]
    assert (found.severity, found.data) == ("warning", {"joints": 12})
    assert "`actuators: []`" in found.hint


@pytest.mark.parametrize(
    ("contact", "said"),
    [
        ({"friction": [0.08, 0.02, 0.01]}, "0.08 is below"),
        ({"friction": [8.0, 0.02, 0.01]}, "8 is above"),
        ({"links": {"FR_foot": {"friction": [0.01, 0.0, 0.0]}}}, "0.01 is below"),
        ({"friction": [0.2, 0.02, 0.01]}, ""),
        ({"friction": [3.0, 0.02, 0.01]}, ""),
        ({"friction": [0.0, 0.0, 0.0], "condim": 1}, ""),  # no friction, and meant so
    ],
)
def test_a_surface_like_ice_or_glue_is_told_with_the_plausible_range(run, contact, said):
    _, findings = run(TREE, FEET, recipe(contact=contact))
    assert ("contact.friction" in findings) == bool(said)
    if said:
        found = findings["contact.friction"]
        assert (found.severity, found.subject) == ("warning", "link FR_foot")
        assert said in found.message
        assert (found.data["lower"], found.data["upper"]) == (0.2, 3.0)


@pytest.mark.parametrize(
    ("keys", "constant"),
    [
        ({"contact": {"solref": [0.004, 1], "priority": 1}}, 0.004),
        ({"contact": {"solref": [0.01, 1], "priority": 1}}, None),
        ({"contact": {"solref": [0.004, 1]}}, None),  # mixed with the floor's 0.02 s
        ({"contact": {"solref": [-4000, -100], "priority": 1}}, None),  # a spring, taken as it is
        ({"simulation": {"timestep": 0.02, "decimation": 1}}, 0.02),
        ({}, None),
    ],
)
def test_a_time_constant_that_mujoco_raises_is_said(run, keys, constant):
    _, findings = run(TREE, FEET, recipe(**keys))
    assert ("contact.softness" in findings) == (constant is not None)
    if constant is not None:
        found = findings["contact.softness"]
        step = keys.get("simulation", {}).get("timestep", 0.005)
        assert (found.severity, found.data["places"]) == ("info", 4)
        assert (found.data["stated_s"], found.data["taken_s"]) == (constant, 2 * step)


def test_some_joints_that_equal_limits_lock_need_no_drive(run):
    first, *others = TREE.joints
    locked = replace(TREE, joints=(replace(first, limits=Limits(0.0, 0.0)), *others))
    rows = [
        {"joints": first.name, "model": "passive"},
        {"joints": f"(?!{first.name}$).*", "model": "pd", "kp": 80, "kd": 2, "effort": 20},
    ]
    _, findings = run(locked, FEET, recipe(actuators=rows))
    assert "actuator.none" not in findings


def test_a_robot_whose_joints_are_all_locked_cannot_be_driven_and_it_is_said(run):
    """What an exporter writes that knows no limits: 0 and 0."""
    locked = [replace(joint, limits=Limits(0.0, 0.0)) for joint in TREE.joints]
    _, findings = run(replace(TREE, joints=tuple(locked)), FEET, recipe(actuators=()))
    assert "equal limits lock all 12" in findings["actuator.none"].message
    assert "set_limits" in findings["actuator.none"].hint


def test_a_guessed_row_is_a_warning_that_names_its_joints(run):
    rows = ({"joints": ".*", "model": "pd", "kp": 80, "kd": 2, "effort": 20, "guessed": True},)
    _, findings = run(TREE, FEET, recipe(actuators=rows))
    assert findings["actuator.guessed"].severity == "warning"
    assert len(findings["actuator.guessed"].data["joints"]) == 12


def test_what_a_row_states_over_the_source_is_told(tmp_path: Path):
    joints = tuple(replace(joint, damping=0.01, friction=None) for joint in TREE.joints)
    drive = {"model": "pd", "kp": 20.0, "kd": 1.0}
    rows = [
        drive | {"joints": ".*_(hip|thigh)_joint", "damping": 0.0, "friction": 0.2, "effort": 30.0},
        drive | {"joints": ".*_calf_joint", "damping": 0.01, "velocity": "unlimited"},
    ]
    for name, said in (("tree", replace(TREE, joints=joints)), ("shapes", FEET)):
        (tmp_path / f"{name}.json").write_bytes(encode(said))
    findings = run_step(control_step(recipe(actuators=rows)), tmp_path, tmp_path / "out")
    told = {(f.subject, f.message.split(": ", 1)[1]) for f in findings if "overr" in f.rule}
    assert told == {
        ("recipe actuators.0", "damping 0 in place of the source's 0.01 (8 joints)"),
        ("recipe actuators.0", "effort 30 in place of the source's 24 (8 joints)"),
        ("recipe actuators.1", "velocity unlimited in place of the source's 20 (4 joints)"),
    }
