"""MJCF texts through the reader, and on to the MJCF target, without a build."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from robot_files import run_step

from assetbuild.body.merge_fixed_joints import MergeFixedJoints
from assetbuild.checks.mjcf_source import MjcfSource
from assetbuild.control.plan import control_step
from assetbuild.findings import Finding
from assetbuild.geometry.assemble import Assemble, Use
from assetbuild.geometry.convert_mesh import ConvertMesh
from assetbuild.pipeline.recipes import whole_model
from assetbuild.robot.codec import decode
from assetbuild.robot.files import RobotFiles, SourceControl
from assetbuild.robot.model import Base, Control, Tree
from assetbuild.robot.shapes import MeshFile, SourceShapes
from assetbuild.simulators.usd_options import UsdOptions
from assetbuild.source.mjcf.flatten_mjcf import FOLDER, FlattenMjcf
from assetbuild.source.mjcf.read_mjcf import ReadMjcf
from assetbuild.targets.mjcf import Mjcf
from assetbuild.targets.usd.unsupported import unsupported

ROBOTS = Path(__file__).parent / "robots" / "mjcf"
MAIN = "arm/robot.xml"
TET = "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
"""An OBJ: a corner of a box of 1 x 2 x 3 m, 1 m3."""


@dataclass
class Reading:
    """What the reader wrote. flat, read: folders of the two steps' outputs."""

    links: Tree
    shapes: SourceShapes
    source: SourceControl
    lines: dict[str, int | str]
    meshes: list[dict[str, object]]
    findings: list[Finding]
    flat: Path
    read: Path
    files: Path

    @property
    def control(self) -> Control:
        return self.source.control

    def rules(self) -> set[str]:
        return {finding.rule for finding in self.findings}

    def only(self, place: str) -> dict[str, str]:
        """Elements that only MJCF has, by owner."""
        return {i.owner: i.element for i in self.control.mjcf_only if i.place == place}


def read(
    text: str,
    folder: Path,
    *,
    base: Base | None = None,
    body: str | None = None,
    grammar: float = 3.11,
    **files: str | bytes,
) -> Reading:
    """body: `source.body`; grammar: `mjcf.grammar`.

    files: beside the MJCF; `__` is a slash, the last `_` a dot.
    """
    tree = folder / "in" / "tree"
    (tree / MAIN).parent.mkdir(parents=True)
    (tree / MAIN).write_text(text)
    for name, content in files.items():
        path = tree / "arm" / ".".join(name.replace("__", "/").rsplit("_", 1))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    flat, out, inputs = folder / "flat", folder / "read", folder / "read_in"
    findings = run_step(FlattenMjcf(file=MAIN, body=body, grammar=grammar), folder / "in", flat)
    inputs.mkdir()
    for name in ("source.xml", "lines.json"):
        shutil.copyfile(flat / name, inputs / name)
    meshes = json.loads((flat / "meshes.json").read_text())
    for mesh in meshes:
        (inputs / "files" / mesh["path"]).parent.mkdir(parents=True, exist_ok=True)
        name = str(mesh["path"])
        file = flat / name.replace(FOLDER, "inline/") if name.startswith(FOLDER) else tree / name
        shutil.copyfile(file, inputs / "files" / name)
    findings += run_step(ReadMjcf(base=base), inputs, out)
    return Reading(
        decode(Tree, (out / "links.json").read_bytes()),
        decode(SourceShapes, (out / "shapes.json").read_bytes()),
        decode(SourceControl, (out / "source_control.json").read_bytes()),
        json.loads((flat / "source_map.json").read_text())["lines"],
        meshes,
        findings,
        flat,
        out,
        inputs / "files",
    )


def arm(joint: str = "", drive: str = "", *, geom: str = "", head: str = "", more: str = "") -> str:
    """A pendulum of one joint `j` with attributes, driven by `drive`. more: sections."""
    return f"""<mujoco><compiler angle="radian"/>{head}
    <worldbody><body name="base"><geom size=".1"/><body name="a" pos="0 0 .3">
    <joint name="j" axis="0 1 0" damping="1" {joint}/>
    <geom type="capsule" size=".03" fromto="0 0 0 .3 0 0" {geom}/></body></body></worldbody>
    <actuator>{drive}</actuator>{more}</mujoco>"""


def hard_arm(folder: Path) -> Reading:
    classes = (ROBOTS / "hard_arm_classes.xml").read_text()
    return read((ROBOTS / "hard_arm.xml").read_text(), folder, hard_arm_classes_xml=classes)


@dataclass
class Written:
    """inputs: the ports of a check, with `mjcf/robot.xml` and the source."""

    inputs: Path
    control: Control
    findings: list[Finding]

    @property
    def xml(self) -> Path:
        return self.inputs / "mjcf" / "robot.xml"


def write(reading: Reading, folder: Path, **recipe: object) -> Written:
    """The MJCF of a reading; recipe: further keys of the recipe."""
    given = {"schema": "assetbuild/v1", "robot": "robot", "source": {"path": ".", "mjcf": MAIN}}
    asked = whole_model().model_validate({**given, **recipe})
    ports = folder / "ports"
    ports.mkdir(parents=True)
    merged = _run(
        MergeFixedJoints(keep_source=True),
        folder / "merge",
        {"links.json": reading.read / "links.json", "source_control.json": _said(reading)},
    )
    shutil.copyfile(reading.read / "links.json", ports / "links.json")
    shutil.copyfile(merged / "tree.json", ports / "tree.json")
    _assemble(reading, folder, ports)
    files = {name: ports / name for name in ("tree.json", "shapes.json", "meshes")}
    files["source_control.json"] = _said(reading)
    step = control_step(asked)
    out = folder / "control" / "out"
    findings = run_step(step, _inputs(folder / "control", files), out)
    shutil.copyfile(out / "control.json", ports / "control.json")
    target = folder / "target"
    findings += run_step(Mjcf.configure(asked), ports, target)
    shutil.copytree(target / "mjcf", ports / "mjcf")
    shutil.copyfile(reading.flat / "source.xml", ports / "source.xml")
    if reading.files.is_dir():
        shutil.copytree(reading.files, ports / "files")
    control = decode(Control, (ports / "control.json").read_bytes())
    return Written(ports, control, findings)


def written(text: str, folder: Path, **recipe: object) -> Written:
    """The MJCF of the text of an MJCF."""
    return write(read(text, folder / "read"), folder / "out", **recipe)


def compared(done: Written) -> set[str]:
    """Rules by which the check objects to what we write of the source."""
    return {f.rule for f in run_step(MjcfSource(robot="robot"), done.inputs, done.inputs / "check")}


def usd_findings(done: Written) -> list[Finding]:
    """What a USD of the robot would lose."""
    files = RobotFiles(done.inputs)
    return list(unsupported(files.tree, files.control, UsdOptions()))


def _said(reading: Reading) -> Path:
    return reading.read / "source_control.json"


def _assemble(reading: Reading, folder: Path, ports: Path) -> None:
    inputs = {"shapes.json": reading.read / "shapes.json"}
    uses = []
    for number, shape in enumerate(reading.shapes.shapes):
        mesh = None
        if isinstance(shape.geometry, MeshFile):
            step = ConvertMesh(format=shape.geometry.path[-3:].lower(), scale=shape.geometry.scale)
            source = {"mesh": reading.files / shape.geometry.path}
            made = _run(step, folder / f"mesh{number}", source)
            mesh = f"mesh/{number}"
            inputs |= {f"{mesh}/{name}": made / name for name in ("parts", "mesh.json")}
        use = Use(shape.link, shape.role, shape.name, mesh=mesh, stem="mesh", named=True)
        uses.append(use)
    uses.sort(key=lambda use: use.role, reverse=True)  # what is seen comes first
    step = Assemble(uses=tuple(uses))
    done = _run(step, folder / "assemble", inputs)
    shutil.copyfile(done / "shapes.json", ports / "shapes.json")
    shutil.copytree(done / "meshes", ports / "meshes")


def _run(step, folder: Path, files: dict[str, Path]) -> Path:
    run_step(step, _inputs(folder, files), folder / "out")
    return folder / "out"


def _inputs(folder: Path, files: dict[str, Path]) -> Path:
    inputs = folder / "in"
    inputs.mkdir(parents=True)
    for name, path in files.items():
        place = inputs / name
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copytree(path, place) if path.is_dir() else shutil.copyfile(path, place)
    return inputs


def same_motion(
    source: str | mujoco.MjModel, result: Path, *, span: float = 1.0, keyframe: bool = False
) -> None:
    """200 steps under random commands. span: of the commands; keyframe: from the first one."""
    a = mujoco.MjModel.from_xml_string(source) if isinstance(source, str) else source
    b = mujoco.MjModel.from_xml_path(str(result))
    b.opt.timestep = a.opt.timestep
    one, other = mujoco.MjData(a), mujoco.MjData(b)
    if keyframe:
        mujoco.mj_resetDataKeyframe(a, one, 0)
        mujoco.mj_resetDataKeyframe(b, other, 0)
    names = [a.actuator(i).name for i in range(len(a.actuator_trntype))]
    drives = [b.actuator(name).id for name in names]
    if len(names) < a.nu:  # one of them takes several commands
        drives = list(range(a.nu))
    random, start = np.random.default_rng(1), one.qpos.copy()
    for _ in range(200):
        one.ctrl[:] = random.uniform(-span, span, a.nu)
        other.ctrl[drives] = one.ctrl
        mujoco.mj_step(a, one)
        mujoco.mj_step(b, other)
        np.testing.assert_allclose(other.qpos, one.qpos, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(other.qvel, one.qvel, rtol=1e-6, atol=1e-7)
    assert np.abs(one.qpos - start).max() > 1e-3
