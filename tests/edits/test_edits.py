"""Each edit does what its name says, exactly, and tells before and after."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robot_files import as_source, run_step
from tiny import box_inertial, box_obj, flat_obj, tiny_quadruped

from assetbuild.errors import RecipeError
from assetbuild.geometry.convert_mesh import ConvertMesh
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.triangles import solid_moments
from assetbuild.plugin_types import Edit
from assetbuild.plugins import load_plugin
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.inertia import matrix_of, principal_moments, tensor_of, triangle_violation
from assetbuild.robot.model import Body, Inertial, Joint, Limits, Mimic, Tree
from assetbuild.robot.pose import IDENTITY, Pose, rotation_of
from assetbuild.robot.shapes import (
    Box,
    Capsule,
    Cylinder,
    MeshFile,
    SourceShape,
    SourceShapes,
    Sphere,
)

EMPTY = SourceShapes()


def edited(tmp_path: Path, rule: str, tree: Tree, shapes=EMPTY, meshes=(), **fields):
    """(Tree, SourceShapes, findings) after the edit that reports `rule`.

    meshes: (shape, OBJ bytes) it reads.
    """
    inputs, outputs = tmp_path / "in", tmp_path / "out"
    inputs.mkdir(exist_ok=True)
    (inputs / "links.json").write_bytes(encode(tree))
    (inputs / "shapes.json").write_bytes(encode(shapes))
    for index, (shape, data) in enumerate(meshes):
        source = tmp_path / f"source {shape}"
        source.mkdir()
        (source / "mesh").write_bytes(data)
        run_step(ConvertMesh(format="obj"), source, inputs / "mesh" / str(index))
    step = load_plugin(Edit, rule.removeprefix("edit.")).model_validate(fields, strict=True)
    findings = run_step(step, inputs, outputs)
    assert {f.rule for f in findings} == {rule}
    made = decode(Tree, (outputs / "links.json").read_bytes())
    return made, decode(SourceShapes, (outputs / "shapes.json").read_bytes()), findings


def one(inertial: Inertial | None) -> Tree:
    """A robot of one link `a`."""
    return Tree("r", "floating", (Body("a", inertial),), ())


BOX = box_inertial(2.0, (0.1, 0.2, 0.3), com=(0.01, 0.02, 0.03))


def test_set_mass_makes_the_same_shape_denser(tmp_path):
    tree, _, (finding,) = edited(tmp_path, "edit.set_mass", one(BOX), link="a", mass=5.0)
    expected = box_inertial(5.0, (0.1, 0.2, 0.3))
    assert tree.bodies[0].inertial.mass_kg == 5.0
    assert tree.bodies[0].inertial.com_m == BOX.com_m
    assert tree.bodies[0].inertial.inertia_com_kg_m2 == pytest.approx(expected.inertia_com_kg_m2)
    assert (finding.data["before_kg"], finding.data["after_kg"]) == (2.0, 5.0)


def test_set_mass_can_keep_the_inertia_and_needs_one(tmp_path):
    tree, _, _ = edited(tmp_path, "edit.set_mass", one(BOX), link="a", mass=5.0, inertia="keep")
    assert tree.bodies[0].inertial == replace(BOX, mass_kg=5.0)
    with pytest.raises(RecipeError, match="`a` has no inertial"):
        edited(tmp_path, "edit.set_mass", one(None), link="a", mass=5.0)


def test_set_inertia_changes_what_is_given(tmp_path):
    moments = {"ixx": 1.0, "iyy": 2.0, "izz": 2.5, "ixy": 0.1}
    tree, _, _ = edited(tmp_path, "edit.set_inertia", one(BOX), link="a", inertia=moments)
    assert tree.bodies[0].inertial == replace(BOX, inertia_com_kg_m2=(1, 2, 2.5, 0.1, 0, 0))
    with pytest.raises(RecipeError, match="no mass"):
        edited(tmp_path, "edit.set_inertia", one(None), link="a", inertia=moments)
    whole = {"inertia": moments, "mass": 3.0, "com": (0.0, 0.0, 1.0)}
    tree, _, _ = edited(tmp_path, "edit.set_inertia", one(None), link="a", **whole)
    assert tree.bodies[0].inertial == Inertial(3.0, (0, 0, 1), (1, 2, 2.5, 0.1, 0, 0))


@given(
    st.tuples(*[st.floats(1e-6, 10.0)] * 2),
    st.floats(1.01, 5.0),
    st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
)
def test_balance_inertia_raises_the_smallest_moment_and_nothing_else(
    tmp_path_factory, small, excess, turn
):
    low, middle = sorted(small)
    high = (low + middle) * excess
    quat = tuple(float(v) for v in np.asarray(turn) / np.linalg.norm(turn))
    axes = rotation_of(quat)
    tensor = tensor_of(axes @ np.diag([low, middle, high]) @ axes.T)
    if triangle_violation(tensor) < 1e-6:
        return
    tree, _, _ = edited(
        tmp_path_factory.mktemp("e"), "edit.balance_inertia", one(Inertial(1.0, (0, 0, 0), tensor)),
        link="a",
    )  # fmt: skip
    after = tree.bodies[0].inertial.inertia_com_kg_m2
    assert triangle_violation(after) <= 0.0
    assert sorted(principal_moments(after)) == pytest.approx(
        sorted((high - middle + 1e-9 * high, middle, high)), rel=1e-12, abs=1e-14 * high
    )
    numbers = " ".join(map(repr, after))
    mujoco.MjModel.from_xml_string(  # refuses it where its own turned axes break A + B >= C
        '<mujoco><worldbody><body><joint/><inertial pos="0 0 0" mass="1" fullinertia="'
        f'{numbers}"/></body></worldbody></mujoco>'
    )
    change = matrix_of(after) - matrix_of(tensor)  # one moment: a matrix of rank 1
    assert np.linalg.norm(change) == pytest.approx(high - middle - low, rel=1e-9, abs=2e-9 * high)


def test_balance_inertia_leaves_a_good_link_alone_and_says_so(tmp_path):
    tree, _, (finding,) = edited(tmp_path, "edit.balance_inertia", one(BOX), link="a")
    assert tree == one(BOX)
    assert finding.severity == "warning"


# --- inertia from geometry -------------------------------------------------------------------


def shown_by(geometry, pose: Pose = IDENTITY) -> SourceShapes:
    return SourceShapes((SourceShape("a_visual", "a", "visual", geometry, pose),))


PRIMITIVES = [Box((0.1, 0.2, 0.3)), Sphere(0.2), Cylinder(0.1, 0.5), Capsule(0.1, 0.5)]


@pytest.mark.parametrize("primitive", PRIMITIVES, ids=lambda p: type(p).__name__)
def test_the_formula_of_a_primitive_is_that_of_its_own_mesh(tmp_path, primitive):
    shape = shown_by(primitive)
    tree, _, _ = edited(
        tmp_path, "edit.inertia_from_geometry", one(None), shape, link="a", density=1000.0
    )
    # The inscribed mesh of 64 corners misses less than 1 % of volume and moments.
    volume, _, inertia = solid_moments(tessellate(primitive))
    found = tree.bodies[0].inertial
    assert found.mass_kg == pytest.approx(1000.0 * volume, rel=0.01)
    assert matrix_of(found.inertia_com_kg_m2) == pytest.approx(1000.0 * inertia, rel=0.01)


def test_a_mesh_gets_the_mass_and_the_place_it_is_given(tmp_path):
    pose = Pose((1.0, 0.0, 0.0), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))  # x of the box along y
    tree, _, (finding,) = edited(
        tmp_path, "edit.inertia_from_geometry", one(BOX), shown_by(MeshFile("box.obj"), pose),
        [("a_visual", box_obj((0.1, 0.2, 0.3)))], link="a", mass=3.0,
    )  # fmt: skip
    expected = box_inertial(3.0, (0.2, 0.1, 0.3))
    found = tree.bodies[0].inertial
    assert found.mass_kg == pytest.approx(3.0, rel=1e-12)
    assert found.com_m == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)
    assert found.inertia_com_kg_m2 == pytest.approx(expected.inertia_com_kg_m2, abs=1e-12)
    assert finding.data["density_kg_m3"] == pytest.approx(3.0 / 0.006)


def test_an_open_mesh_has_no_volume_unless_its_hull_is_meant(tmp_path):
    text, _, _ = box_obj((0.1, 0.2, 0.3)).rstrip().rpartition(b"\n")  # without its last face
    arguments = (one(None), shown_by(MeshFile("m.obj")), [("a_visual", text)])
    fields = {"link": "a", "density": 1000.0}
    with pytest.raises(RecipeError, match="is open") as caught:
        edited(tmp_path, "edit.inertia_from_geometry", *arguments, **fields)
    assert "open: hull" in caught.value.hint
    again = tmp_path / "again"
    again.mkdir()
    tree, _, _ = edited(again, "edit.inertia_from_geometry", *arguments, **fields, open="hull")
    assert tree.bodies[0].inertial.mass_kg == pytest.approx(6.0)


def test_a_flat_mesh_has_no_volume_and_the_hint_is_of_this_edit(tmp_path):
    arguments = (one(None), shown_by(MeshFile("m.obj")), [("a_visual", flat_obj())])
    fields = {"link": "a", "density": 1000.0, "open": "hull"}
    with pytest.raises(RecipeError, match="spans no volume") as caught:
        edited(tmp_path, "edit.inertia_from_geometry", *arguments, **fields)
    assert caught.value.hint == "take `from: collision`, or state it: edit `set_inertia`"


# --- names, axes, limits ---------------------------------------------------------------------


def test_rename_moves_every_mention(tmp_path):
    robot = tiny_quadruped()
    links, joints = robot.links.bodies, robot.links.joints
    tree, shapes, findings = edited(
        tmp_path, "edit.rename", robot.links, as_source(robot.shapes),
        links={"(.*)": r"r_\1"}, joints={"(.*)_joint": r"\1"},
    )  # fmt: skip
    assert [b.name for b in tree.bodies] == [f"r_{b.name}" for b in links]
    assert [(j.parent, j.child) for j in tree.joints] == [
        (f"r_{j.parent}", f"r_{j.child}") for j in joints
    ]
    assert [j.name for j in tree.joints] == [j.name.removesuffix("_joint") for j in joints]
    assert {s.link for s in shapes.shapes} == {f"r_{s.link}" for s in robot.shapes.shapes}
    assert findings[0].data["after"] == f"r_{findings[0].data['before']}"


def pair(first: Limits, mimic: Mimic) -> Tree:
    bodies = tuple(Body(name, BOX) for name in "abc")
    joints = (
        Joint("j", "revolute", "a", "b", axis=(0.0, 0.0, 1.0), limits=first),
        Joint("k", "revolute", "b", "c", limits=Limits(-1.0, 1.0), mimic=mimic),
    )
    return Tree("r", "fixed", bodies, joints)


def test_flip_axis_mirrors_limits_and_couplings(tmp_path):
    tree, _, (finding,) = edited(
        tmp_path, "edit.flip_axis", pair(Limits(-0.5, 2.0), Mimic("j", 2.0, 0.1)), joint="j"
    )
    j, k = tree.joints
    assert j.axis == (0.0, 0.0, -1.0)
    assert (j.limits.lower, j.limits.upper) == (-2.0, 0.5)
    assert k.mimic == Mimic("j", -2.0, 0.1)  # the same motion of k for the same motion of j
    assert finding.data["before_limits"] == (-0.5, 2.0)
    kept, _, _ = edited(
        tmp_path, "edit.flip_axis", pair(Limits(-0.5, 2.0), Mimic("j")), joint="j", limits="keep"
    )
    assert kept.joints[0].limits == Limits(-0.5, 2.0)
    assert kept.joints[1].mimic == Mimic("j")


def test_set_limits_keeps_what_is_not_given(tmp_path):
    tree = pair(Limits(-0.5, 2.0, effort=1.0), Mimic("j"))
    done, _, (finding,) = edited(
        tmp_path, "edit.set_limits", tree, joint="j", upper=1.0, velocity=3.0
    )
    assert done.joints[0].limits == Limits(-0.5, 1.0, 1.0, 3.0)
    assert finding.data["before"] == (-0.5, 2.0, 1.0, None)
    with pytest.raises(RecipeError, match=r"from -0\.5 to -1"):
        edited(tmp_path, "edit.set_limits", tree, joint="j", upper=-1.0)


def test_a_hinge_without_limits_is_continuous_and_a_wheel_with_limits_a_hinge(tmp_path):
    tree = pair(Limits(0.0, 0.0, effort=1.0), Mimic("j"))
    done, _, (finding,) = edited(tmp_path, "edit.set_limits", tree, joint="j", unlimited=True)
    assert (done.joints[0].kind, done.joints[0].limits) == ("continuous", Limits(effort=1.0))
    assert "revolute -> continuous" in finding.message
    back, _, _ = edited(tmp_path, "edit.set_limits", done, joint="j", lower=-1.0, upper=1.0)
    assert back.joints[0].kind == "revolute"
    slide = replace(tree, joints=tuple(replace(j, kind="prismatic") for j in tree.joints))
    with pytest.raises(RecipeError, match="cannot be unlimited"):
        edited(tmp_path, "edit.set_limits", slide, joint="j", unlimited=True)


def perturbed(tmp_path, axis):
    """The axis after the edit, and its finding."""
    joint = Joint("j", "revolute", "a", "b", axis=axis)
    tree = Tree("r", "fixed", (Body("a"), Body("b")), (joint,))
    made, _, (finding,) = edited(tmp_path, "edit.perturb_axis", tree, joint="j", eps=1e-4)
    return made.joints[0].axis, finding


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)])
def test_perturb_axis_turns_a_plain_axis_by_eps(tmp_path, axis):
    made, finding = perturbed(tmp_path, axis)
    turned = np.array(made)
    assert np.linalg.norm(turned) == pytest.approx(1.0, abs=1e-15)
    angle = math.acos(float(turned @ np.array(axis)))
    assert angle == pytest.approx(1e-4, rel=1e-6)
    assert finding.data["before"] == axis


def test_perturb_axis_leaves_a_slanted_axis_alone(tmp_path):
    made, finding = perturbed(tmp_path, (0.6, 0.0, 0.8))
    assert made == (0.6, 0.0, 0.8)
    assert "left as it is" in finding.message
