"""Mistakes of users: one run names all that is wrong, with the place and the right exit code."""

from __future__ import annotations

from pathlib import Path

import pytest

from .conftest import LEGS, Place


def errors(said: str) -> list[str]:
    """The first line of each error."""
    lines = said.splitlines()
    return [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]


def test_every_name_that_is_not_in_the_robot_is_named(legs: Place):
    row = "  - {joints: '.*', model: pd, kp: 20, kd: 1, effort: 10, velocity: 20}"
    legs.edit(row.replace("'", '"'), row.replace("'.*'", "'.*_knee_joint'") + "\n" + row)
    legs.edit("{method: keep}}", "{method: keep}, links: {tial: {method: none}}}")
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


def test_a_missing_mesh_is_named_with_its_line_and_the_bundle_stays(built_legs: Place):
    def stamps() -> dict[Path, int]:
        files = built_legs.bundle.rglob("*")
        return {path: path.stat().st_mtime_ns for path in files if path.is_file()}

    before = stamps()
    assert before
    shown = '</inertial><visual><geometry><mesh filename="trunk.stl"/></geometry></visual>'
    built_legs.urdf.write_text(built_legs.urdf.read_text().replace("</inertial>", shown, 1))
    told = built_legs.refused("build", built_legs.name)
    for part in ("four_legs.urdf:4", "trunk.stl", "hint: "):
        assert part in told
    assert stamps() == before


def test_a_key_that_a_step_refuses_is_named_with_its_line(legs: Place):
    legs.edit("targets: [urdf]", "mjx: {touching: wing}\ntargets: [mjx]")
    line = legs.recipe.read_text().splitlines().index("mjx: {touching: wing}") + 1
    told = legs.refused("build", "legs.yaml", code=1)
    assert f"\nerror: legs.yaml:{line}:7: mjx.touching: pattern `wing` leaves no" in told


def test_a_joint_that_a_format_does_not_have_is_named_with_its_line(legs: Place):
    loose = '"LF_foot" type="floating"'
    text = legs.urdf.read_text().replace('"LF_foot_fixed" type="fixed"', loose)
    legs.urdf.write_text(text)
    legs.edit("targets: [urdf]", "targets: [mjcf]")
    line = text[: text.index(loose)].count("\n") + 1
    told = legs.refused("build", "legs.yaml", code=1)
    assert f"\nerror: four_legs.urdf:{line}: joint LF_foot: MJCF allows a floating" in told


def test_a_stale_lock_is_out_of_date(legs: Place):
    legs.edit("path: robot", "pypi: example-robot-data==6.0.0")
    legs.recipe.with_name("legs.lock.yaml").write_text(
        "schema: assetbuild-lock/v1\nsource:\n  pypi: example-robot-data==5.0.0\n"
        f'  file: example_robot_data-5.0.0-py3-none-any.whl\n  sha256: "{"0" * 64}"\n  size: 1\n'
    )
    for words in (["check"], ["build", "--frozen"]):
        told = legs.refused(*words, "legs.yaml", code=3)
        assert "legs.lock.yaml" in told and "assetbuild lock" in told


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
    told = legs.refused(verb, name)
    if kind:
        assert told == (
            f"error: {name}: this is {kind}, not a recipe\n"
            f"hint: write a recipe for it: `assetbuild init {name}`\n"
        )
    else:
        assert "init" not in told
