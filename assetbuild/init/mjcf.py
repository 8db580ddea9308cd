"""A recipe for an MJCF: short, since the file itself says most of what a recipe can say."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from assetbuild.engine.scratch import scratch
from assetbuild.errors import SourceError, Where
from assetbuild.init.anatomy import Anatomy, study
from assetbuild.init.home import home_pose
from assetbuild.init.look import InspectedRobot, judge
from assetbuild.init.packages import above, is_file
from assetbuild.init.repairs import repairs, repairs_text
from assetbuild.init.targets import targets
from assetbuild.init.text import head, home, validation
from assetbuild.init.trial import tables, try_to_stand
from assetbuild.init.words import some, source_section, written
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control
from assetbuild.robot.source import SourceControl
from assetbuild.source.mjcf.flatten_mjcf import FlattenMjcf
from assetbuild.source.mjcf.read_mjcf import ReadMjcf
from assetbuild.source.urdf.xml import MAX_BYTES

DRIVES = """\
# The source drives no joint (mjlab's robots are driven from Python). A table here would:
# actuators:
#   - {joints: ".*", model: pd, kp: 40, kd: 2, effort: 20}   # your motors' numbers"""


@dataclass(frozen=True)
class MjcfSource:
    """An MJCF that can be read. root: the lowest folder that holds it and its meshes."""

    root: Path
    file: str
    robot: InspectedRobot
    control: Control


def is_mjcf(file: Path, data: bytes) -> bool:
    """By its root element; an XML that is something else is left to others."""
    start = data[:4096].lstrip()
    return file.suffix.lower() == ".xml" and b"<mujoco" in start and b"<robot" not in start


def find_mjcf(file: Path) -> MjcfSource:
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


def _read(root: Path, name: str) -> MjcfSource:
    """The build's own steps, run on the spot."""
    with scratch() as ports:
        for path in sorted((root / name).parent.rglob("*.xml")):
            if is_file(path) and path.stat().st_size <= MAX_BYTES:  # what else may be an include
                ports.link(f"tree/{path.relative_to(root)}", path)
        ports.run(FlattenMjcf(file=name))
        for mesh in json.loads(ports.read("meshes.json")):
            path = root / mesh["path"]
            if not path.is_file():
                where = Where(str(mesh["file"]), int(mesh["line"]))
                raise SourceError(f"no file `{mesh['path']}`", where=where)
            ports.link(f"files/{mesh['path']}", path)
        ports.run(ReadMjcf())
        read = RobotFiles(ports.folder)
        said = read.source_control or SourceControl()
        robot = judge(read.links, read.source_shapes, read.links.base)
    return MjcfSource(root, name, robot, said.control)


def mjcf_text(found: MjcfSource, path: Path) -> str:
    """The whole recipe, as it will lie at `path`."""
    robot, control = found.robot, found.control
    anatomy = study(robot)
    return written(
        head(robot, anatomy, path),
        source_section(found.root, path, "mjcf", found.file),
        _taken(found),
        repairs_text(robot, repairs(robot, found.root)),
        _collision(robot),
        _drives(control),
        () if control.keyframes else home(robot, anatomy, home_pose(robot.tree, anatomy.legs)),
        [targets(robot), *_validate(found, anatomy)],
    )


def _taken(found: MjcfSource) -> Iterator[str]:
    """What the source says and the recipe therefore does not."""
    control, tree = found.control, found.robot.tree
    step = control.simulation.timestep
    yield "# What the MJCF says and this file does not repeat; a key here would win:"
    yield f"# base: {tree.base}"
    yield f"# simulation: {{timestep: {step:g}}}   # s"
    yield f"# collision pairs that are excluded: {len(control.excludes)}"
    if control.keyframes:
        yield f"# its keyframes: {some([key.name for key in control.keyframes])}"
    if control.sensors:
        yield f"# its sensors: {some([sensor.name for sensor in control.sensors])}"


def _collision(robot: InspectedRobot) -> Iterator[str]:
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
        yield DRIVES


def _validate(found: MjcfSource, anatomy: Anatomy) -> Iterator[str]:
    """Legs with drives are tried; keyframes of the source are its own affair."""
    robot, control, legs = found.robot, found.control, anatomy.legs
    named = {key.name for key in control.keyframes}
    driven = {a.joint for a in control.actuators if a.model in ("pd", "general")}
    if not legs or not all(j.name in driven for leg in legs for j in leg.joints):
        return
    if named and "home" not in named:
        return
    soles = [sole for leg in legs for sole in leg.soles]
    step = {"timestep": control.simulation.timestep}
    home = control.initial_keyframe
    pose = dict(home.joints) if home else home_pose(robot.tree, legs)
    trial = try_to_stand(robot, found.root, soles, tables(robot.tree, (), pose, step), control)
    yield from validation(robot, legs, trial)
