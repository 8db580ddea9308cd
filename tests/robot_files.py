"""Robots laid out as the engine would, and steps run on them."""

from __future__ import annotations

import json
import pickle
import shutil
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from tiny import TinyRobot

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding
from assetbuild.geometry.measure_assets import MeasureAssets, ReadMeshes
from assetbuild.plugin_types import Check, Target
from assetbuild.robot.codec import encode
from assetbuild.robot.shapes import Mesh, MeshFile, Shapes, SourceShape, SourceShapes


def write_robot_ports(folder: Path, robot: TinyRobot) -> Path:
    """Write the files of the robot ports of `assetbuild.plugin_types` into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "links.json").write_bytes(encode(robot.links))
    (folder / "tree.json").write_bytes(encode(robot.tree))
    (folder / "shapes.json").write_bytes(encode(robot.shapes))
    for name in ("control.json", "ratings.json"):
        (folder / name).write_bytes(encode(robot.control))
    (folder / "meshes").mkdir(exist_ok=True)
    for name, data in robot.meshes.items():
        (folder / "meshes" / name).write_bytes(data)
    if isinstance(robot.shapes, Shapes):
        run_step(ReadMeshes(), folder, folder)
        run_step(MeasureAssets(), folder, folder)
    return folder


def write_source_ports(folder: Path, robot: TinyRobot) -> Path:
    """Write the same ports with the meshes as files of a source, as before `assemble`."""
    return write_robot_ports(folder, replace(robot, shapes=as_source(robot.shapes)))


def as_source(shapes: Shapes | SourceShapes) -> SourceShapes:
    """The same geometry before `assemble`: each mesh is a file of its own."""
    return SourceShapes(
        tuple(
            SourceShape(**vars(shape) | {"geometry": MeshFile(f"{shape.geometry.mesh}.obj")})
            if isinstance(shape.geometry, Mesh)
            else SourceShape(**vars(shape))
            for shape in shapes.shapes
        ),
        shapes.materials,
    )


def run_step(step: Step, inputs: Path, outputs: Path) -> list[Finding]:
    """Runs `step` on two folders, as the engine would, and returns its findings."""
    outputs.mkdir(parents=True, exist_ok=True)
    if isinstance(step, Target) and step.preparation is not None:
        run_step(step.preparation(), inputs, inputs)
    return list(step.run(Files(inputs=inputs, outputs=outputs)))


def emit(target: Step, robot: TinyRobot, folder: Path) -> list[Finding]:
    """The findings of a target, which writes the robot's files into `folder/out`."""
    return run_step(target, write_robot_ports(folder / "in", robot), folder / "out")


def compiled(robot: TinyRobot, folder: Path, file: str = "robot.xml") -> Any:
    """A file of the robot's MJCF, as MuJoCo compiles it. Any: mujoco.MjModel."""
    import mujoco

    from assetbuild.targets.mjcf import Mjcf

    emit(Mjcf(robot="robot"), robot, folder)
    return mujoco.MjModel.from_xml_path(str(folder / "out/mjcf" / file))


def checked(check: Step, inputs: Path, outputs: Path) -> tuple[list[Finding], dict[str, Any]]:
    """The findings of a check, and its figures."""
    findings = run_step(check, inputs, outputs)
    return findings, figures(outputs)


def figures(outputs: Path) -> dict[str, Any]:
    """What a check measured."""
    found: dict[str, Any] = json.loads((outputs / "figures.json").read_text())
    return found


def rules(findings: Iterable[Finding]) -> set[str]:
    """The ids of what was found."""
    return {finding.rule for finding in findings}


def ranked(findings: Iterable[Finding]) -> list[tuple[str, str]]:
    """The id and the severity of each."""
    return [(finding.rule, finding.severity) for finding in findings]


def about(findings: Iterable[Finding]) -> set[tuple[str, str]]:
    """The id of each, with every subject that it names."""
    return {(f.rule, s) for f in findings for s in (f.subject, *f.data.get("subjects", ()))}


def configured(check: type[Check], **keys: object) -> Check | None:
    """The check that a recipe with these keys asks for."""
    from assetbuild.pipeline.recipes import whole_model

    head = {"schema": "assetbuild/v1", "robot": "robot", "source": {"path": ".", "urdf": "r.urdf"}}
    return check.configure(whole_model().model_validate(head | keys))


def check_inputs(folder: Path, robot: TinyRobot, target: Step, name: str) -> Path:
    """The ports of `robot`, its measured meshes and the folder `<name>/` that `target` writes."""
    return laid_out(folder / "inputs", robot, (target, name))


def models(folder: Path, robot: TinyRobot) -> Path:
    """The inputs of a check that reads the robot, its MJCF and its USD."""
    from assetbuild.targets.mjcf import Mjcf
    from assetbuild.targets.usd import Usd

    written = (Mjcf(robot="robot"), "mjcf"), (Usd(robot="robot"), "usd")
    return laid_out(folder / "inputs", robot, *written)


def mjcf_inputs(folder: Path, robot: TinyRobot) -> Path:
    """The inputs of a check that reads the robot and its MJCF, `mjcf/robot.xml`."""
    from assetbuild.targets.mjcf import Mjcf

    return check_inputs(folder, robot, Mjcf(robot="robot"), "mjcf")


def usd_inputs(
    folder: Path, robot: TinyRobot, spoil: Callable[[Any], object] | None = None
) -> Path:
    """The same with its USD, `usd/robot.usda`, whose stage `spoil` edits. Any: Usd.Stage."""
    from assetbuild.targets.usd import Usd

    inputs = check_inputs(folder, robot, Usd(robot="robot"), "usd")
    if spoil is not None:
        spoil_stage(inputs / "usd/robot.usda", spoil)
    return inputs


def laid_out(inputs: Path, robot: TinyRobot, *written: tuple[Step, str]) -> Path:
    """The ports of `robot` and what targets write, made once in this process and then copied."""
    key = pickle.dumps((robot, written))
    if key not in _LAID_OUT:
        with tempfile.TemporaryDirectory() as name:
            made = write_robot_ports(Path(name) / "inputs", robot)
            for target, folder in written:
                run_step(target, made, Path(name) / "outputs")
                shutil.copytree(Path(name) / "outputs" / folder, made / folder)
            _LAID_OUT[key] = contents(made)
    (inputs / "meshes").mkdir(parents=True, exist_ok=True)
    for path, data in _LAID_OUT[key].items():
        (inputs / path).parent.mkdir(parents=True, exist_ok=True)
        (inputs / path).write_bytes(data)
    return inputs


_LAID_OUT: dict[bytes, dict[str, bytes]] = {}


def contents(folder: Path) -> dict[str, bytes]:
    """The files of a folder, by their paths in it."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def spoil_stage(path: Path, spoil: Callable[[Any], object]) -> None:
    """Edit a stage's main layer. Any: Usd.Stage."""
    from pxr import Usd

    stage = Usd.Stage.Open(str(path))
    spoil(stage)
    stage.Save()
    del stage


def edit(path: Path, *edits: tuple[str, str]) -> None:
    """Replace the first of each text of a file."""
    text = path.read_text()
    for old, new in edits:
        assert old in text, f"`{old}` is not in {path.name}"
        text = text.replace(old, new, 1)
    path.write_text(text)
