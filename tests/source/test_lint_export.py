"""A package as sw2urdf writes it, with its known defects planted: each is found and has a fix."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import trimesh
from tiny import run_step

from assetbuild.cli import main
from assetbuild.findings import Finding
from assetbuild.init import propose, write
from assetbuild.kinds import Edit
from assetbuild.plugins import plugin_names
from assetbuild.robot.codec import encode
from assetbuild.robot.model import Body, Joint, Limits, Tree
from assetbuild.source.urdf.lint_export import LintExport

HEADER = """<?xml version="1.0" encoding="utf-8"?>
<!-- This URDF was automatically created by SolidWorks to URDF Exporter! Originally created by
     Stephen Brawner (brawner@gmail.com)
     Commit Version: 1.6.0-1-g15f4949  Build Version: 1.6.7594.29634 -->
"""
EDGES = (0.1, 0.05, 0.04)
BOX_KG = 1000 * 0.1 * 0.05 * 0.04
"""What a part without a material weighs in SolidWorks."""


@dataclass
class Link:
    """A box with the mass that its volume has at 1000 kg/m3, unless a test says otherwise."""

    mass: float = BOX_KG
    moments: tuple[float, float, float] = field(
        default_factory=lambda: (
            BOX_KG * (0.05**2 + 0.04**2) / 12,
            BOX_KG * (0.1**2 + 0.04**2) / 12,
            BOX_KG * (0.1**2 + 0.05**2) / 12,
        )
    )
    collision: bool = True

    def urdf(self, name: str) -> str:
        xx, yy, zz = self.moments
        mesh = f"<geometry><mesh filename='package://arm/meshes/{name}.STL'/></geometry>"
        solid = f"<collision>{mesh}</collision>" if self.collision else ""
        return (
            f"<link name='{name}'><inertial><mass value='{self.mass}'/><inertia ixx='{xx}' "
            f"iyy='{yy}' izz='{zz}' ixy='0' ixz='0' iyz='0'/></inertial>"
            f"<visual>{mesh}</visual>{solid}</link>"
        )

    def row(self, name: str) -> str:
        xx, yy, zz = self.moments
        return f"{name},0,0,0,{self.mass},{xx},0,0,{yy},0,{zz}"


COLUMNS = (
    "Link Name,Center of Mass X,Center of Mass Y,Center of Mass Z,Mass,"
    "Moment Ixx,Moment Ixy,Moment Ixz,Moment Iyy,Moment Iyz,Moment Izz"
)


def joint(name: str, child: str, y: float, axis: str, limit: str) -> str:
    return (
        f"<joint name='{name}' type='revolute'><origin xyz='0 {y} 0.1'/><parent link='base_link'/>"
        f"<child link='{child}'/><axis xyz='{axis}'/><limit {limit}/></joint>"
    )


GOOD = "lower='-0.5' upper='2' effort='9' velocity='3'"


def export(folder: Path, limits: str = GOOD, right_axis: str = "0 1 0", **links: Link) -> Path:
    """`arm/{package.xml,urdf,config,meshes}`; returns the URDF."""
    parts = {name: links.get(name, Link()) for name in ("base_link", "left_arm", "right_arm")}
    package = folder / "arm"
    for name in ("urdf", "config", "meshes"):
        (package / name).mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>arm</name></package>")
    joints = joint("left_joint", "left_arm", 0.1, "0 1 0", GOOD)
    joints += joint("right_joint", "right_arm", -0.1, right_axis, limits)
    body = "".join(link.urdf(name) for name, link in parts.items())
    (package / "urdf/arm.urdf").write_text(f"{HEADER}<robot name='arm'>{body}{joints}</robot>")
    rows = [Link().row(name) for name in parts]
    (package / "urdf/arm.csv").write_text("\r\n".join([COLUMNS, *rows]) + "\r\n")
    names = "controller_joint_names: ['', 'left_joint', 'right_joint', ]"
    (package / "config/joint_names_arm.yaml").write_text(names)
    for name in parts:
        trimesh.creation.box(EDGES).export(package / f"meshes/{name}.STL")
    return package / "urdf/arm.urdf"


def told(urdf: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, dict[str, object]]:
    """Findings of a build by `rule subject`, the last of each."""
    monkeypatch.setenv("ASSETBUILD_CACHE", str(folder / "cache"))
    recipe = folder / "arm.yaml"
    write(propose(urdf, recipe, {}), force=True)
    text = re.sub(r"(?m)^targets:.*", "targets: [urdf]", recipe.read_text())
    recipe.write_text(re.sub(r"(?ms)^edits:.*?\n\n", "", text))
    main(["build", str(recipe), "-o", str(folder / "out")])
    bundle = folder / "out" if (folder / "out").is_dir() else folder / "out.failed"
    report = json.loads((bundle / "report/report.json").read_text())
    return {f"{f['rule']} {f['subject']}": f for f in report["findings"]}


@pytest.mark.slow
def test_a_clean_export_is_named_and_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    findings = told(export(tmp_path), tmp_path, monkeypatch)
    (found,) = (f for key, f in findings.items() if key.startswith("export."))
    assert found["rule"] == "export.solidworks"
    assert "1.6.0-1-g15f4949" in str(found["message"])
    assert "urdf/arm.csv, config/joint_names_arm.yaml" in str(found["message"])
    assert "inertia.default_density robot" in findings  # all of it was planted at 1000 kg/m3


@pytest.mark.slow
def test_each_planted_defect_is_found_and_its_fix_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    findings = told(
        export(
            tmp_path,
            limits="lower='0' upper='0' effort='0' velocity='0'",
            left_arm=Link(mass=0.0, collision=False),
            right_arm=Link(moments=(0.01, 0.02, 0.02), collision=False),
        ),
        tmp_path,
        monkeypatch,
    )
    fixes = {
        "joint.locked joint right_joint": "set_limits",
        "joint.effort_zero joint right_joint": "actuator table",
        "joint.velocity_zero joint right_joint": "actuator table",
        "inertia.mass link left_arm": "set_mass",
        "link.no_collision link right_arm": "from: visual",
        "inertia.default_density robot": "set_mass",
        "export.table link left_arm": "set_inertia",
        "export.table link right_arm": "set_inertia",
        "export.solidworks robot": "findings beside",
    }
    for key, fix in fixes.items():
        assert key in findings
        assert fix in str(findings[key]["hint"])
    edits = plugin_names(Edit)
    assert {"set_limits", "set_mass", "set_inertia", "flip_axis"} <= set(edits)


@pytest.mark.slow
def test_a_list_of_other_joints_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    urdf = export(tmp_path)
    names = tmp_path / "arm/config/joint_names_arm.yaml"
    names.write_text("controller_joint_names: ['', 'left_joint', 'elbow']")
    found = told(urdf, tmp_path, monkeypatch)["export.joint_names robot"]
    assert "`elbow`" in str(found["message"])


@pytest.mark.slow
def test_without_its_comment_the_files_beside_tell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    urdf = export(tmp_path)
    urdf.write_text(urdf.read_text().removeprefix(HEADER))
    assert "export.solidworks robot" in told(urdf, tmp_path, monkeypatch)


# --- the step alone -------------------------------------------------------------------------


def linted(head: str, folder: Path, *limits: Limits) -> list[Finding]:
    bodies = [Body("base")] + [Body(f"link{i}") for i in range(len(limits))]
    joints = [
        Joint(f"j{i}", "revolute", bodies[i].name, bodies[i + 1].name, limits=limit)
        for i, limit in enumerate(limits)
    ]
    folder.mkdir(exist_ok=True)
    (folder / "robot.urdf").write_text(head + "<robot/>")
    tree = Tree("bot", "fixed", tuple(bodies), tuple(joints))
    (folder / "links.json").write_bytes(encode(tree))
    return run_step(LintExport(), folder, folder)


ONSHAPE = "<!-- Generated using onshape-to-robot -->"


def test_an_export_of_onshape_with_one_limit_for_all(tmp_path: Path):
    same = Limits(-1.0, 1.0, 10.0, 10.0)
    found = linted(ONSHAPE, tmp_path, same, same, same)
    assert [f.rule for f in found] == ["export.onshape", "export.limits_alike"]
    assert "effort 10 and velocity 10" in found[1].message


def test_chosen_limits_are_no_finding(tmp_path: Path):
    same, other = Limits(-1.0, 1.0, 10.0, 10.0), Limits(-1.0, 1.0, 12.0, 10.0)
    assert [f.rule for f in linted(ONSHAPE, tmp_path, same, same, other)] == ["export.onshape"]


def test_a_urdf_by_hand_is_not_judged(tmp_path: Path):
    same = Limits(-1.0, 1.0, 10.0, 10.0)
    assert linted("<!-- by hand -->", tmp_path, same, same, same) == []
