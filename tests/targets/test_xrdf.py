"""What a planner is told: spheres, limits and pairs, and what nobody stated is an error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from tiny import TinyRobot, run_step, tiny_quadruped, with_mimic, write_robot_ports

from assetbuild.facts.readers.xrdf import Xrdf as Reader
from assetbuild.robot.shapes import Shapes, Sphere
from assetbuild.targets.xrdf import Xrdf, XrdfOptions

ASKED: dict[str, Any] = {
    "acceleration": {".*_calf_joint": 20.0, ".*": 10.0},
    "jerk": {".*": 500.0},
    "tool_frames": ["FR_calf"],
}


def of_spheres(robot: TinyRobot) -> TinyRobot:
    """The same robot whose collision shapes are balls, in their places."""
    shapes = tuple(
        replace(shape, geometry=Sphere(0.02 + 0.001 * number))
        if shape.role == "collision"
        else shape
        for number, shape in enumerate(robot.shapes.shapes)
    )
    return replace(robot, shapes=Shapes(shapes, robot.shapes.materials))


def written(
    folder: Path, robot: TinyRobot, asked: dict[str, Any]
) -> tuple[Any, list[tuple[str, str, str]], Path]:
    """(the file's content, (severity, rule, subject) of each finding, the inputs of a check)."""
    inputs = write_robot_ports(folder / "in", robot)
    step = Xrdf(robot="robot", options=XrdfOptions.model_validate(asked))
    found = [(f.severity, f.rule, f.subject) for f in run_step(step, inputs, folder / "out")]
    (folder / "out/xrdf").rename(inputs / "xrdf")
    return yaml.safe_load((inputs / "xrdf/robot.xrdf").read_text()), found, inputs


def proven(inputs: Path, asked: dict[str, Any], folder: Path) -> list[str]:
    options = {"xrdf": XrdfOptions.model_validate(asked).model_dump(mode="json")}
    return [f.rule for f in run_step(Reader(robot="robot", options=options), inputs, folder)]


def test_the_file_tells_the_robot_and_no_more(tmp_path: Path) -> None:
    robot = of_spheres(with_mimic(tiny_quadruped(), "FR_calf_joint", "FR_thigh_joint", -2.0, 0.1))
    said, found, inputs = written(tmp_path, robot, ASKED)
    assert found == []
    names = said["cspace"]["joint_names"]
    assert "FR_calf_joint" not in names
    assert len(names) == 11
    limits = dict(zip(names, said["cspace"]["acceleration_limits"], strict=True))
    assert limits["FL_calf_joint"] == 20.0
    assert limits["FL_hip_joint"] == 10.0
    spheres = said["geometry"]["spheres"]["spheres"]
    wanted = {shape.link for shape in robot.shapes.of("collision")}
    assert set(spheres) == wanted
    for shape in robot.shapes.of("collision"):
        ball = {"center": list(shape.X_link_shape.xyz), "radius": shape.geometry.radius}  # type: ignore[union-attr] # spheres all
        assert ball in spheres[shape.link]
    assert proven(inputs, ASKED, tmp_path / "same") == []


def test_bodies_of_a_joint_may_overlap_and_those_of_two_legs_may_not(tmp_path: Path) -> None:
    said, _, _ = written(tmp_path, of_spheres(tiny_quadruped()), ASKED)
    ignored = {
        frozenset((one, other))
        for one, others in said["self_collision"]["ignore"].items()
        for other in others
    }
    assert frozenset(("FR_thigh", "FR_calf")) in ignored
    assert frozenset(("FR_calf", "FL_calf")) not in ignored


def test_what_nobody_stated_is_an_error_and_not_invented(tmp_path: Path) -> None:
    said, found, inputs = written(tmp_path, tiny_quadruped(), {"tool_frames": ["wrist"]})
    rules = [(severity, rule) for severity, rule, _ in found]
    assert rules.count(("error", "xrdf.limit")) == 2
    assert ("error", "xrdf.frame", "link wrist") in found
    assert ("error", "xrdf.shape") in rules
    assert set(said["cspace"]) == {"joint_names"}
    assert "tool_frames" not in said
    assert proven(inputs, {}, tmp_path / "same") == []


SPOILT: dict[str, tuple[Callable[[Any], object], str]] = {
    "a sphere elsewhere": (
        lambda said: said["geometry"]["spheres"]["spheres"]["FR_calf"][0]["center"].__setitem__(
            2, 0.1
        ),
        "equal.xrdf.spheres_0_center",
    ),
    "a smaller sphere": (
        lambda said: said["geometry"]["spheres"]["spheres"]["FR_calf"][0].update(radius=0.019),
        "equal.xrdf.spheres_0_radius",
    ),
    "a link without spheres": (
        lambda said: said["geometry"]["spheres"]["spheres"].pop("FR_calf"),
        "equal.xrdf.spheres_0_center",
    ),
    "two joints exchanged": (
        lambda said: said["cspace"]["joint_names"].reverse(),
        "equal.xrdf.cspace_joint_names",
    ),
    "another limit": (
        lambda said: said["cspace"]["jerk_limits"].__setitem__(0, 501.0),
        "equal.xrdf.cspace_jerk_limits",
    ),
    "another pose": (
        lambda said: said["default_joint_positions"].update(FR_calf_joint=-1.0),
        "equal.xrdf.default_position",
    ),
    "a pair more that may overlap": (
        lambda said: said["self_collision"]["ignore"]["FL_calf"].append("FR_calf"),
        "equal.xrdf.ignored",
    ),
    "a key of another format": (lambda said: said.update(modifiers=[{"a": 1}]), "equal.unread"),
}


@pytest.mark.parametrize("what", SPOILT)
def test_another_file_is_told(what: str, tmp_path: Path) -> None:
    spoil, rule = SPOILT[what]
    said, _, inputs = written(tmp_path, of_spheres(tiny_quadruped()), ASKED)
    spoil(said)
    (inputs / "xrdf/robot.xrdf").write_text(yaml.safe_dump(said, sort_keys=False))
    assert rule in proven(inputs, ASKED, tmp_path / "spoilt")


def test_a_key_that_stands_twice_is_told(tmp_path: Path) -> None:
    _, _, inputs = written(tmp_path, of_spheres(tiny_quadruped()), ASKED)
    with (inputs / "xrdf/robot.xrdf").open("a") as file:
        file.write("format: xrdf\n")
    assert proven(inputs, ASKED, tmp_path / "twice") == ["equal.unread"]
