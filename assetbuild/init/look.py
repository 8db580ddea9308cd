"""The robot as the build will read it: the same steps, run on the spot."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding
from assetbuild.init.source import Found
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.model import Base, Shapes, Tree
from assetbuild.robot.tree import merge_fixed_joints
from assetbuild.steps.lint_bodies import LintBodies
from assetbuild.steps.lint_links import LintLinks
from assetbuild.steps.read_urdf import ReadUrdf


@dataclass(frozen=True)
class Looked:
    """links: before merging fixed joints; tree: after; link_findings, body_findings: the lints'."""

    links: Tree
    tree: Tree
    shapes: Shapes
    link_findings: tuple[Finding, ...] = ()
    body_findings: tuple[Finding, ...] = ()


def look(source: Found) -> Looked:
    """Read. Raises SourceError with file and line, as a build would."""
    step = ReadUrdf(file=source.shown, base="floating", packages=dict(source.packages))
    read, _ = _run(step, {"robot.urdf": source.data})
    links, shapes = decode(Tree, read["links.json"]), decode(Shapes, read["shapes.json"])
    tree, _ = merge_fixed_joints(links, True, ())
    return Looked(links, tree, shapes)


def judge(robot: Looked, base: Base) -> Looked:
    """The robot on this base, with what the lints say of it there."""
    links = replace(robot.links, base=base)
    tree, _ = merge_fixed_joints(links, True, ())
    shapes = encode(robot.shapes)
    _, of_links = _run(LintLinks(), {"links.json": encode(links), "shapes.json": shapes})
    _, of_bodies = _run(LintBodies(), {"tree.json": encode(tree), "shapes.json": shapes})
    return Looked(links, tree, robot.shapes, of_links, of_bodies)


def _run(step: Step, inputs: dict[str, bytes]) -> tuple[dict[str, bytes], tuple[Finding, ...]]:
    """A light step without store or child process: what it wrote, and what it said."""
    with tempfile.TemporaryDirectory(prefix="assetbuild-init-") as folder:
        files = Files(inputs=Path(folder) / "in", outputs=Path(folder) / "out")
        files.inputs.mkdir()
        files.outputs.mkdir()
        for name, data in inputs.items():
            (files.inputs / name).write_bytes(data)
        findings = tuple(step.run(files))
        return {path.name: path.read_bytes() for path in files.outputs.iterdir()}, findings
