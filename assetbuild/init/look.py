"""The robot as the build will read it: the same steps, run on the spot."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from assetbuild.body.lint_bodies import LintBodies
from assetbuild.body.lint_links import LintLinks
from assetbuild.engine.step import Files, Step
from assetbuild.errors import SourceError, Where, did_you_mean
from assetbuild.findings import Finding
from assetbuild.init.packages import is_file
from assetbuild.init.source import Found
from assetbuild.init.words import some
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.model import Base, SourceShapes, Tree
from assetbuild.robot.tree import merge_fixed_joints
from assetbuild.source.urdf.read_urdf import ReadUrdf


@dataclass(frozen=True)
class Looked:
    """links: before merging fixed joints; tree: after; link_findings, body_findings: the lints'."""

    links: Tree
    tree: Tree
    shapes: SourceShapes
    link_findings: tuple[Finding, ...] = ()
    body_findings: tuple[Finding, ...] = ()


def look(source: Found) -> Looked:
    """Read. Raises SourceError with file and line, as a build would."""
    step = ReadUrdf(file=source.shown, base="floating", packages=dict(source.packages))
    read, _ = _run(step, {"robot.urdf": source.data})
    _refuse_absent(source, json.loads(read["meshes.json"]))
    links, shapes = decode(Tree, read["links.json"]), decode(SourceShapes, read["shapes.json"])
    tree, _ = merge_fixed_joints(links, True, ())
    return Looked(links, tree, shapes)


def _refuse_absent(source: Found, meshes: list[dict[str, str]]) -> None:
    """A build would stop there too, at the first; here all are named."""
    absent = [mesh for mesh in meshes if not is_file(source.root / mesh["path"])]
    if not absent:
        return
    first, others = absent[0], [f"`{mesh['path']}`" for mesh in absent[1:]]
    near = (source.root / first["path"]).parent
    names = [str(PurePosixPath(first["path"]).parent / f.name) for f in _listing(near)]
    more = f" (and {len(others)} more: {some(others)})" if others else ""
    raise SourceError(
        f"{first['subject']}: no file `{first['path']}`{more}",
        where=Where(source.shown, int(first["line"])),
        hint=did_you_mean(first["path"], names) or f"no folder `{near.name}` lies there",
    )


def _listing(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []


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
