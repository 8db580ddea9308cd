"""URDF texts: a robot of links and joints in as few words as a test needs, and what is read."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest
from robot_files import run_step

from assetbuild.errors import SourceError
from assetbuild.findings import Finding
from assetbuild.robot.codec import decode
from assetbuild.robot.model import Base, Tree
from assetbuild.robot.shapes import SourceShapes
from assetbuild.source.urdf.read_urdf import ReadUrdf

FILE = "pkg/urdf/robot.urdf"
PACKAGES = {"robot_pkg": "pkg"}
LIMIT = '<limit lower="-1" upper="1" effort="9" velocity="5"/>'


def tensor(xx: float, yy: float, zz: float) -> str:
    """Moments of inertia along the link's axes, kg m²."""
    return f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/>'


SOUND = tensor(0.01, 0.01, 0.01)


def inertial(mass: float = 1.0, inertia: str = SOUND, xyz: str = "0 0 0") -> str:
    """mass: kg. xyz: the centre of mass, m."""
    return f'<inertial><origin xyz="{xyz}"/><mass value="{mass}"/>{inertia}</inertial>'


def shape(role: str, geometry: str, xyz: str = "0 0 0") -> str:
    """role: `visual` or `collision`. xyz: m."""
    return f'<{role}><origin xyz="{xyz}"/><geometry>{geometry}</geometry></{role}>'


def box(edge: float = 0.1) -> str:
    """edge: m."""
    return f'<box size="{edge} {edge} {edge}"/>'


def mesh(filename: str) -> str:
    return f'<mesh filename="{filename}"/>'


def link(name: str, *content: str) -> str:
    """A link; a sound inertia unless it says what it holds."""
    return f'<link name="{name}">{"".join(content or (inertial(),))}</link>\n'


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    content: str = LIMIT,
    *,
    xyz: str = "0 0 0.4",
    axis: str | None = "0 1 0",
) -> str:
    """xyz: the child's place in its parent, m. axis: None leaves it out."""
    turns = f'<axis xyz="{axis}"/>' if axis else ""
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}"/><parent link="{parent}"/>'
        f'<child link="{child}"/>{turns}{content}</joint>\n'
    )


def robot(*parts: str, name: str = "r") -> str:
    return f'<robot name="{name}">\n{"".join(parts)}</robot>\n'


@dataclass
class Reading:
    """What the reader wrote. source: the tidy text that checks read."""

    tree: Tree
    shapes: SourceShapes
    meshes: list[dict[str, object]]
    lines: dict[str, int]
    findings: list[Finding]
    source: str

    def rules(self) -> list[str]:
        return [finding.rule for finding in self.findings]

    def told(self, rule: str) -> Finding:
        (found,) = (f for f in self.findings if f.rule == rule)
        return found


def read(
    text: str | bytes,
    folder: Path,
    *,
    base: Base = "fixed",
    file: str = FILE,
    packages: Mapping[str, str] = PACKAGES,
) -> Reading:
    """A URDF through the reader; what it wrote stays in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_bytes(text.encode() if isinstance(text, str) else text)
    findings = run_step(ReadUrdf(file=file, base=base, packages=dict(packages)), folder, folder)
    return Reading(
        decode(Tree, (folder / "links.json").read_bytes()),
        decode(SourceShapes, (folder / "shapes.json").read_bytes()),
        json.loads((folder / "meshes.json").read_text()),
        json.loads((folder / "source_map.json").read_text())["lines"],
        findings,
        (folder / "source.urdf").read_text(),
    )


def refused(text: str | bytes, folder: Path) -> str:
    """The error of a URDF that cannot be read."""
    with pytest.raises(SourceError) as caught:
        read(text, folder)
    return str(caught.value)
