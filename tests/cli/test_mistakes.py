"""A recipe with several mistakes, or a file that is no recipe: one run names all that is wrong."""

from __future__ import annotations

import json

import pytest
from defusedxml.ElementTree import parse

from .conftest import LEGS, Place


def errors(said: str) -> list[str]:
    """The first line of each error."""
    lines = said.splitlines()
    return [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]


def test_every_name_that_is_not_in_the_robot_is_named(legs: Place):
    row = "  - {joints: '.*', model: pd, kp: 20, kd: 1, effort: 10, velocity: 20}"
    legs.edit(row.replace("'", '"'), row.replace("'.*'", "'.*_knee_joint'") + "\n" + row)
    legs.edit(
        "{default: {method: keep}}", "{default: {method: keep}, links: {tial: {method: none}}}"
    )
    legs.edit("base:", "fixed_joints: {merge: true, keep_bodies: [fot]}\nbase:")
    legs.edit("targets:", "imu: {link: trunkk}\nkeyframes: {home: {joints: {nobody: 0}}}\ntargets:")
    done = legs.run("build", "legs.yaml")
    assert done.returncode == 2
    assert [line.partition(": ")[2] for line in errors(done.stderr)] == [
        "fixed_joints.keep_bodies[0]: pattern `fot` matches no link of the source",
        "collision.links.tial: pattern `tial` matches no link of the source",
        "actuators[0]: pattern `.*_knee_joint` matches no moving joint",
        "imu.link: no link `trunkk`",
        "keyframes.home: pattern `nobody` matches no moving joint",
    ]


def test_mistakes_of_several_recipes_are_told_together(legs: Place):
    text = legs.recipe.read_text()
    legs.edit("kp: 20", "kp: x")
    (legs.folder / "other.yaml").write_text(text.replace("robot: legs", "robto: legs"))
    done = legs.run("build", "legs.yaml", "other.yaml")
    assert done.returncode == 2
    assert [line.split(":")[0] for line in errors(done.stderr)] == ["legs.yaml", "other.yaml"]


def test_each_mistake_is_a_case_of_the_report_for_ci(legs: Place):
    legs.edit("kp: 20", "kp: x")
    legs.edit("targets: [urdf]", "targets: [mcjf]")
    assert legs.build("--report-junit", "junit.xml").returncode == 2
    cases = parse(legs.folder / "junit.xml").iter("error")
    assert [case.get("message").split(": ")[0] for case in cases] == [
        "legs.yaml:7:35", "legs.yaml:8:11"
    ]  # fmt: skip


def test_a_rule_waived_by_the_name_it_had_before_is_named_anew(legs: Place):
    legs.edit("targets:", "rules: {urdf.reload.mass: {severity: info, because: known}}\ntargets:")
    assert legs.build().returncode == 0
    report = json.loads((legs.bundle / "report/report.json").read_text())
    told = [one for one in report["findings"] if one["rule"].startswith("rules.")]
    assert [(one["rule"], one["where"]) for one in told] == [("rules.renamed", "legs.yaml:8:9")]
    assert "is called `equal.urdf.mass`" in told[0]["message"]


@pytest.mark.parametrize(
    ("verb", "name", "text", "kind"),
    [
        ("build", "legs.urdf", LEGS.read_text(), "a URDF"),
        ("lock", "legs.urdf", LEGS.read_text(), "a URDF"),
        ("plan", "legs.xacro", LEGS.read_text(), "a xacro file"),
        ("build", "robot.xml", "<?xml version='1.0'?>\n<!-- a robot -->\n<mujoco/>", "an MJCF"),
        ("build", "page.yaml", "<html></html>", ""),
    ],
)
def test_a_robot_in_the_place_of_a_recipe_leads_to_init(legs: Place, verb, name, text, kind):
    (legs.folder / name).write_text(text)
    done = legs.run(verb, name)
    assert done.returncode == 2
    if kind:
        assert done.stderr == (
            f"error: {name}: this is {kind}, not a recipe\n"
            f"hint: write a recipe for it: `assetbuild init {name}`\n"
        )
    else:
        assert "init" not in done.stderr
