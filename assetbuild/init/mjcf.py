"""A recipe for an MJCF: short, since the file itself says most of what a recipe can say."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from assetbuild.engine.step import Files
from assetbuild.errors import SourceError, Where
from assetbuild.init.anatomy import Anatomy, study
from assetbuild.init.home import home_pose
from assetbuild.init.look import Looked, judge
from assetbuild.init.packages import above, is_file
from assetbuild.init.patterns import patterns_of
from assetbuild.init.repairs import repairs
from assetbuild.init.targets import targets
from assetbuild.init.text import head, home
from assetbuild.init.words import quoted, some
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control
from assetbuild.robot.source import SourceControl
from assetbuild.robot.tree import merge_fixed_joints
from assetbuild.source.mjcf.flatten_mjcf import FlattenMjcf
from assetbuild.source.mjcf.read_mjcf import ReadMjcf
from assetbuild.source.urdf.xml import MAX_BYTES

DRIVES = """\
# The source drives no joint (mjlab's robots are driven from Python). A table here would:
# actuators:
#   - {joints: ".*", model: pd, kp: 40, kd: 2, effort: 20}   # your motors' numbers""".splitlines()


@dataclass(frozen=True)
class Found:
    """An MJCF that can be read. root: the lowest folder that holds it and its meshes."""

    root: Path
    file: str
    robot: Looked
    control: Control


def is_mjcf(file: Path, data: bytes) -> bool:
    """By its root element; an XML that is something else is left to others."""
    start = data[:4096].lstrip()
    return file.suffix.lower() == ".xml" and b"<mujoco" in start and b"<robot" not in start


def find_mjcf(file: Path) -> Found:
    """Read the MJCF, from the lowest folder that holds all its files.

    Raises SourceError with file and line, as a build would.
    """
    real = Path(os.path.realpath(file))
    problem: SourceError | None = None
    for root in above(real):
        try:
            return _read(root, real.relative_to(root).as_posix())
        except SourceError as error:
            if "leads out of the source" not in error.message:
                raise
            problem = problem or error
    assert problem is not None  # noqa: S101 # every path has a folder
    raise problem


def _read(root: Path, name: str) -> Found:
    """The build's own steps, run on the spot."""
    with tempfile.TemporaryDirectory(prefix="assetbuild-init-") as folder:
        flat, read = _files(folder, "flat"), _files(folder, "read")
        beside = (root / name).parent
        for path in sorted(beside.rglob("*.xml")):
            if is_file(path) and path.stat().st_size <= MAX_BYTES:  # what else may be an include
                _copy(path, flat.inputs / "tree" / path.relative_to(root))
        list(FlattenMjcf(file=name).run(flat))
        for made in ("source.xml", "lines.json"):
            _copy(flat.outputs / made, read.inputs / made)
        for mesh in json.loads((flat.outputs / "meshes.json").read_bytes()):
            path = root / mesh["path"]
            if not path.is_file():
                where = Where(str(mesh["file"]), int(mesh["line"]))
                raise SourceError(f"no file `{mesh['path']}`", where=where)
            _copy(path, read.inputs / "files" / mesh["path"])
        list(ReadMjcf().run(read))
        robot = RobotFiles(read.outputs)
        links, said = robot.links, robot.source_control or SourceControl()
        tree, _ = merge_fixed_joints(links, True, said.bodies)
        looked = Looked(links, tree, robot.shapes)
    return Found(root, name, judge(looked, links.base), said.control)


def _files(folder: str, name: str) -> Files:
    files = Files(Path(folder) / name / "in", Path(folder) / name / "out")
    files.inputs.mkdir(parents=True)
    files.outputs.mkdir()
    return files


def _copy(source: Path, dest: Path) -> None:
    dest.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, dest)


def mjcf_text(found: Found, path: Path) -> str:
    """The whole recipe, as it will lie at `path`."""
    robot, control = found.robot, found.control
    anatomy = study(robot)
    sections = (
        head(robot, anatomy, path),
        list(_source(found, path)),
        list(_taken(found)),
        repairs(robot, found.root),
        list(_collision(robot)),
        list(_drives(control)),
        list(_poses(robot, anatomy, control)),
        [targets(robot), *_validate(robot, anatomy, control)],
    )
    lines: list[str] = []
    for section in sections:
        if section:
            lines += [*section, ""]
    return "\n".join(lines).rstrip() + "\n"


def _source(found: Found, path: Path) -> Iterator[str]:
    relative = Path(os.path.relpath(found.root, os.path.realpath(path.parent))).as_posix()
    yield "source:"
    yield f"  path: {quoted(relative)}   # relative to this file"
    yield f"  mjcf: {quoted(found.file)}"
    yield "  # license: MIT   # the SPDX name of the source's licence; please state it"


def _taken(found: Found) -> Iterator[str]:
    """What the source says and the recipe therefore does not."""
    control, tree = found.control, found.robot.tree
    step = control.simulation.timestep
    yield "# What the MJCF says and this file does not repeat; a key here would win:"
    yield f"# base: {tree.base}"
    yield f"# simulation: {{timestep: {step:g}}}   # s"
    yield f"# collision pairs that are excluded: {len(control.excludes)}"
    if control.keyframes:
        yield f"# keyframes: {some([key.name for key in control.keyframes])}"
    if control.sensors:
        yield f"# sensors: {some([sensor.name for sensor in control.sensors])}"


def _collision(robot: Looked) -> Iterator[str]:
    count = len(robot.shapes.of("collision"))
    yield "collision:"
    if count:
        yield f"  default: {{method: keep, from: collision}}   # its {count} shapes as they are"
    else:
        yield "  default: {method: auto, from: visual}   # the source has no collision shapes"


def _drives(control: Control) -> Iterator[str]:
    driven = [a.name for a in control.actuators if a.model != "passive"]
    driven += ["others" for item in control.mjcf_only if item.place == "actuator"][:1]
    if driven:
        yield f"# Drives of the source: {some(driven)}"
        yield "# An `actuators:` table here would replace them all."
    else:
        yield from DRIVES


def _poses(robot: Looked, anatomy: Anatomy, control: Control) -> Iterator[str]:
    if not control.keyframes:
        yield from home(robot, anatomy, home_pose(robot.tree, anatomy.legs))


def _validate(robot: Looked, anatomy: Anatomy, control: Control) -> Iterator[str]:
    """Four legs or more with drives must stand."""
    named = {key.name for key in control.keyframes}
    driven = {a.joint for a in control.actuators if a.model in ("pd", "general")}
    legs = anatomy.legs
    if len(legs) < 4 or not all(j.name in driven for leg in legs for j in leg.joints):
        return
    if named and "home" not in named:
        return
    names = [body.name for body in robot.links.bodies]
    feet = patterns_of([sole for leg in legs for sole in leg.soles], names)
    pattern = feet[0] if len(feet) == 1 else f"({'|'.join(feet)})"
    yield "validate:"
    yield f"  stand: {{keyframe: home, seconds: 2, feet: {quoted(pattern)}}}   # must not fall"
