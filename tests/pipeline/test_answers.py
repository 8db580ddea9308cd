"""What an edit or the actuator table answers is information; what they leave open still warns."""

from __future__ import annotations

from pathlib import Path

import pytest
from urdfs import LIMIT, inertial, joint, link, robot, tensor

from assetbuild.cli.check import check
from assetbuild.findings import Finding

OPEN = '<limit effort="9" velocity="5"/>'
LOCKED = '<limit lower="0" upper="0" effort="9" velocity="5"/>'
WEAK = '<limit lower="-1" upper="1" effort="0" velocity="5"/>'


def found(
    tmp_path: Path, limit: str, edits: str = "[]", weight: str = "", rows: str = "", mimic: str = ""
) -> dict[str, Finding]:
    """What `check` says of an arm of two joints, by rule and subject."""
    text = robot(
        link("base"),
        link("one", weight or inertial()),
        joint("j1", "base", "one", content=limit),
        link("two"),
        joint("j2", "one", "two", content=(limit if mimic else LIMIT) + mimic),
    )
    (tmp_path / "r.urdf").write_text(text)
    recipe = tmp_path / "r.yaml"
    recipe.write_text(
        "schema: assetbuild/v1\nrobot: r\nsource: {path: ., urdf: r.urdf, license: MIT}\n"
        f"base: fixed\nedits: {edits}\ntargets: [urdf]\n{rows}"
    )
    return {f"{f.rule} {f.subject}": f for f in check(recipe)}


FREED = "[{set_limits: {joint: j1, unlimited: true}}]"
GIVEN = "[{set_limits: {joint: j1, lower: -1, upper: 1}}]"
TENSOR = "[{set_inertia: {link: one, inertia: {ixx: 0.01, iyy: 0.01, izz: 0.01}}}]"
FLAT = inertial(1.0, tensor(0.01, 0.01, 0.0201))
"""Beyond the triangle by 0.5 %, which MuJoCo refuses and we only warn of."""
BAD = inertial(1.0, tensor(0.01, 0.01, 0.1))
HALF = '<inertial><mass value="1"/></inertial>'
PASSIVE = "actuators: [{joints: 'j.', model: passive}]\n"
ROW = "actuators: [{joints: 'j.', model: pd, kp: 9, kd: 1, effort: 3}]\n"


@pytest.mark.parametrize(
    ("limit", "weight", "edits", "rows", "key", "by"),
    [
        (OPEN, "", FREED, "", "joint.locked joint j1", "set_limits"),
        (LOCKED, "", GIVEN, "", "joint.locked joint j1", "set_limits"),
        (LIMIT, FLAT, "[{balance_inertia: {link: one}}]", "", "inertia.triangle link one",
         "balance_inertia"),
        (LIMIT, BAD, "[{balance_inertia: {link: one}}]", "", "inertia.triangle link one",
         "balance_inertia"),
        (LIMIT, HALF, TENSOR, "", "urdf.inertial.incomplete link one", "set_inertia"),
        (WEAK, "", "[]", ROW, "joint.effort_zero joint j1", "actuators"),
        (WEAK, "", "[]", PASSIVE, "joint.effort_zero joint j1", "actuators"),
        (WEAK, "", "[{set_limits: {joint: j1, effort: 3}}]", "", "joint.effort_zero joint j1",
         "set_limits"),
    ],
)  # fmt: skip
def test_what_an_edit_answers_is_information_that_names_it(
    limit: str, weight: str, edits: str, rows: str, key: str, by: str, tmp_path: Path
):
    before = found(tmp_path, limit, weight=weight)[key]
    assert before.severity == ("error" if weight == BAD else "warning")
    after = found(tmp_path, limit, edits, weight, rows)[key]
    assert (after.severity, after.data["answered_by"]) == ("info", (by,))
    assert f"`{by}`" in after.message


@pytest.mark.parametrize(
    ("limit", "weight", "edits", "key"),
    [
        (LOCKED, "", "[{set_limits: {joint: j1, effort: 3}}]", "joint.locked joint j1"),
        (OPEN, "", "[{set_limits: {joint: j1, velocity: 3}}]", "urdf.limit.omitted joint j1"),
        (LIMIT, FLAT, "[{set_mass: {link: one, mass: 2}}]", "inertia.triangle link one"),
        (WEAK, "", GIVEN, "joint.effort_zero joint j1"),
    ],
)
def test_an_edit_of_something_else_answers_nothing(
    limit: str, weight: str, edits: str, key: str, tmp_path: Path
):
    assert found(tmp_path, limit, edits, weight)[key].severity == "warning"


def test_a_joint_that_mimics_is_answered_by_an_edit_of_a_joint(tmp_path: Path):
    unit = '<limit lower="-1" upper="1" effort="9" velocity="5"/>'
    edits = "[{balance_inertia: {link: one}}, {set_limits: {joint: j1, lower: -0.5, upper: 0.5}}]"
    said = found(tmp_path, unit, edits, BAD, mimic='<mimic joint="j1" multiplier="2"/>')
    assert said["joint.mimic_limits joint j2"].data["answered_by"] == ("set_limits",)


def test_what_an_edit_breaks_is_found(tmp_path: Path):
    wide = "[{set_limits: {joint: j1, lower: -20, upper: 20}}]"
    assert found(tmp_path, LIMIT, wide)["joint.range joint j1"].severity == "warning"


def test_a_link_that_was_renamed_is_the_same_link(tmp_path: Path):
    said = found(tmp_path, LIMIT, "[{rename: {links: {one: uno}}}]", FLAT)
    assert "inertia.triangle link one" not in said
    assert said["inertia.triangle link uno"].severity == "warning"
