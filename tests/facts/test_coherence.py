"""A robot of a bundle that tells one thing in two ways, or names what is not there."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from gripper import gripper
from tiny import write_robot_ports

from assetbuild.errors import UsageError
from assetbuild.facts.coherence import incoherent, other_sections
from assetbuild.facts.reference import Reference


def changed(folder: Path, change: Callable[[Any], object]) -> Reference:
    """The gripper of a bundle whose `robot.json` somebody changed."""
    reference = Reference.of_ports(write_robot_ports(folder / "ports", gripper()), {})
    raw = json.loads(reference.to_json())
    change(raw)
    (folder / "report").mkdir()
    (folder / "report/robot.json").write_text(json.dumps(raw))
    return Reference.of_bundle(folder)


def test_an_untouched_robot_agrees_with_itself(tmp_path: Path):
    assert list(incoherent(changed(tmp_path, lambda raw: None))) == []


def twice(entries: list[Any], name: str) -> None:  # Any: JSON
    entries.append(next(entry for entry in entries if name in str(entry)))


@pytest.mark.parametrize(
    ("quantity", "subject", "change"),
    [
        ("mass", "body slide", lambda r: r["links"]["bodies"][1]["inertial"].update(mass_kg=3.0)),
        ("axis", "joint lift", lambda r: r["links"]["joints"][0].update(axis=[0.0, 0.0, 1.0])),
        ("axis", "joint hold", lambda r: r["tree"]["joints"][1].update(axis=[0.0, 1.0, 0.0])),
        ("source's_damping", "joint a_joint", lambda r: r["tree"]["joints"][2].update(damping=9.0)),
        ("triangles", "mesh block", lambda r: r["shapes"]["meshes"][1].update(faces=13)),
        ("vertices", "mesh block", lambda r: r["shapes"]["meshes"][1].update(vertices=0)),
        ("convex", "mesh tile", lambda r: r["shapes"]["meshes"][0].update(convex=True)),
        ("file", "mesh block", lambda r: r["shapes"]["meshes"][1].update(file="skin.obj")),
        ("entries", "shapes.shapes skin", lambda r: twice(r["shapes"]["shapes"], "skin")),
        ("entries", "control.actuators lift", lambda r: twice(r["control"]["actuators"], "lift")),
        ("entries", "assets.surfaces block", lambda r: twice(r["assets"]["surfaces"], "block")),
        (
            "entries",
            "control.excludes base slide",
            lambda r: r["control"].update(excludes=[["base", "slide"]] * 2),
        ),
        ("bodies", "pair base base", lambda r: r["control"].update(excludes=[["base", "base"]])),
        ("order", "pair base slide", lambda r: r["control"].update(excludes=[["slide", "base"]])),
        (
            "length_of_axis",
            "link's joint lift",
            lambda r: r["links"]["joints"][0].update(axis=[0.0, 0.0, -1000.0]),
        ),
        ("name", "robot", lambda r: r["tree"].update(name="other")),
    ],
)
def test_links_and_bodies_that_differ_are_found(
    quantity: str, subject: str, change: Callable[[Any], object], tmp_path: Path
):
    findings = [*incoherent(changed(tmp_path, change))]
    assert (f"equal.robot.{quantity}", subject) in {(f.rule, f.subject) for f in findings}
    assert all(f.data["expected"] != f.data["found"] for f in findings)


@pytest.mark.parametrize(
    ("quantity", "change"),
    [
        ("mjlab.njmax", lambda o: o["mjlab"].update(njmax=301)),
        ("mjlab.foot_scan.radius", lambda o: o["mjlab"].pop("foot_scan")),
        ("mjlab.pose.walking[2]", lambda o: o["mjlab"]["pose"]["walking"].append(0.6)),
        ("feet", lambda o: o.update(feet=1.0)),
        ("feet", lambda o: o.pop("feet")),
    ],
)
def test_sections_are_those_that_the_build_recorded(
    quantity: str, change: Callable[[Any], object], tmp_path: Path
):
    mjlab = {"njmax": 300, "foot_scan": {"radius": 0.04}, "pose": {"walking": [0.3, 0.6]}}
    sections = {"mjlab": mjlab, "feet": None}
    parameters = {"externalParameters": {"sections": sections}}
    statement = {"predicate": {"buildDefinition": parameters}}
    (tmp_path / "provenance.json").write_text(json.dumps(statement))
    told = json.loads(json.dumps(sections))

    def said(raw: Any) -> None:  # Any: JSON
        raw["options"] = told

    reference = changed(tmp_path, said)
    assert list(other_sections(reference, tmp_path)) == []
    change(told)
    (found,) = other_sections(replace(reference, options=told), tmp_path)
    assert (found.rule, found.subject) == (f"equal.robot.{quantity}", "recipe")


@pytest.mark.parametrize(
    "change",
    [
        lambda r: r["tree"]["joints"][0].update(parent="nobody"),
        lambda r: r["links"]["bodies"].pop(),
        lambda r: r["shapes"]["shapes"][0].update(link="nobody"),
        lambda r: r["control"]["actuators"][0].update(joint="nobody"),
        lambda r: r["assets"]["surfaces"][0][1].update(mean=[0.0, 0.0]),
        lambda r: r.pop("options"),
    ],
)
def test_a_robot_with_a_dangling_name_is_refused(change: Callable[[Any], object], tmp_path: Path):
    with pytest.raises(UsageError, match=r"robot\.json"):
        changed(tmp_path, change)
