"""What can be compared between two robots, whatever they came from: facts by subject.

A fact is `(group, subject, quantity) -> value`: `("joint", "FR_hip_joint", "kp") -> 80.0`.
Bodies are those after merging fixed joints; axes are in the body that the joint moves, at zero.
SI units, radians.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from assetbuild.errors import UsageError
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.inertia import principal_moments, total_mass
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.shapes import Mesh, MeshFile, Placed, Shapes, SourceShapes
from assetbuild.simulators.readings import FALL, HEIGHT, fall_m

Value = float | str | tuple[float, ...] | None
Facts = dict[tuple[str, str, str], Value]


@dataclass(frozen=True)
class Snapshot:
    """A robot to compare. findings: (rule, subject) -> severity; files: path -> (sha256, size).

    precision: relative; a format with fewer digits says no more than they do.
    """

    name: str
    facts: Facts
    ready: bool | None = None
    findings: Mapping[tuple[str, str], str] = field(default_factory=dict)
    files: Mapping[str, tuple[str, int]] = field(default_factory=dict)
    precision: float = 1e-9


def robot_json(tree: Tree, shapes: Shapes, control: Control) -> str:
    """`report/robot.json`: the robot itself, for `assetbuild diff` and for other tools."""
    parts = {"tree": tree, "shapes": shapes, "control": control}
    plain = {name: json.loads(encode(part)) for name, part in parts.items()}
    return json.dumps(plain, sort_keys=True, separators=(",", ":")) + "\n"


def bundle_snapshot(bundle: Path) -> Snapshot:
    """Of a folder that `build` wrote; UsageError when it is none."""
    try:
        raw = json.loads((bundle / "report" / "robot.json").read_bytes())
        report = json.loads((bundle / "report" / "report.json").read_bytes())
        manifest = json.loads((bundle / "manifest.json").read_bytes())
        parts = {name: json.dumps(raw[name]).encode() for name in ("tree", "shapes", "control")}
        tree, shapes = decode(Tree, parts["tree"]), decode(Shapes, parts["shapes"])
        control = decode(Control, parts["control"])
        facts = robot_facts(tree, shapes, control) | _motion_facts(
            tree, control, report.get("checks", {})
        )
        return Snapshot(
            str(bundle),
            facts,
            bool(report["verdict"]["ready"]),
            {(f["rule"], f["subject"]): f["severity"] for f in report["findings"]},
            {row["path"]: (row["sha256"], int(row["size"])) for row in manifest["files"]},
        )
    except FileNotFoundError as error:
        missing = Path(str(error.filename)).relative_to(bundle)
        raise UsageError(
            f"`{bundle}` is no bundle of this version: it has no {missing}",
            hint="build it again, or give the MJCF or URDF in it",
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(f"`{bundle}` is not a readable bundle: {error}") from None


def _motion_facts(tree: Tree, control: Control, checks: Mapping[str, Any]) -> Facts:
    """What is asked of a simulator too: a fall by formula, the height of the check `stand`."""
    if tree.base != "floating":
        return {}
    simulation = control.simulation
    pull = float(np.linalg.norm(simulation.gravity))
    facts: Facts = {("robot", "robot", FALL): fall_m(pull, simulation.timestep)}
    height = checks.get("stand", {}).get("figures", {}).get("height_m")
    if isinstance(height, float):
        facts["robot", "robot", HEIGHT] = height
    return facts


def robot_facts(tree: Tree, shapes: Shapes | SourceShapes, control: Control | None) -> Facts:
    """Of the robot model; without control (a bare URDF) nothing is said of drives and time."""
    facts: Facts = {
        ("robot", "robot", "base"): tree.base,
        ("robot", "robot", "total mass, kg"): total_mass(tree),
    }
    for body in tree.bodies:
        if body.inertial is not None:
            facts["body", body.name, "mass, kg"] = body.inertial.mass_kg
            facts["body", body.name, "centre of mass, m"] = body.inertial.com_m
            moments = principal_moments(body.inertial.inertia_com_kg_m2)
            facts["body", body.name, "principal moments, kg m2"] = moments
        else:
            facts["body", body.name, "mass, kg"] = 0.0
    for joint in tree.moving_joints:
        own = ("joint", joint.name)
        facts[*own, "kind"] = "hinge" if joint.kind != "prismatic" else "slide"
        facts[*own, "axis"] = joint.axis
        facts[*own, "lower"] = None if joint.kind == "continuous" else joint.limits.lower
        facts[*own, "upper"] = None if joint.kind == "continuous" else joint.limits.upper
    _collision_facts(tree, shapes, facts)
    if control is not None:
        _control_facts(control, facts)
    return facts


def _collision_facts(tree: Tree, shapes: Shapes | SourceShapes, facts: Facts) -> None:
    sizes: dict[str, list[str]] = {}
    kinds: dict[str, dict[str, int]] = {body.name: {} for body in tree.bodies}
    for shape in shapes.of("collision"):
        of_body = kinds[tree.placement(shape.link)[0]]
        kind = type(shape.geometry).__name__.lower().removesuffix("file")
        of_body[kind] = of_body.get(kind, 0) + 1
        sizes.setdefault(tree.placement(shape.link)[0], []).append(_size_text(shape))
    for body, found in kinds.items():
        facts["body", body, "collision"] = kinds_text(found)
        facts["body", body, "collision sizes, m"] = _shortened("; ".join(sizes.get(body, [])))


def _size_text(shape: Placed) -> str:
    """Size and place of one piece; of a mesh its name, which holds part of its digest."""
    geometry = shape.geometry
    if isinstance(geometry, Mesh):
        size = geometry.mesh
    elif isinstance(geometry, MeshFile):
        size = geometry.path
    else:
        numbers = np.ravel([np.asarray(value) for value in vars(geometry).values()])
        size = " x ".join(f"{value:.4g}" for value in numbers)
    return f"{size} at {', '.join(f'{value:.4g}' for value in shape.X_link_shape.xyz)}"


def _shortened(text: str) -> str:
    """Long texts keep a digest, so that they still differ where they differ."""
    if len(text) <= 70:
        return text
    return f"{text[:54]}... ({hashlib.sha256(text.encode()).hexdigest()[:8]})"


def kinds_text(kinds: Mapping[str, int]) -> str:
    """`2 box, 1 mesh`."""
    return ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())) or "none"


def _control_facts(control: Control, facts: Facts) -> None:
    for drive in control.actuators:
        own = ("joint", drive.joint)
        for name in ("kp", "kd", "damping", "friction", "armature", "effort", "velocity"):
            facts[*own, name] = getattr(drive, name)
        if drive.model == "dc_motor":
            facts[*own, "stall"] = drive.saturation
        facts[*own, "model"] = drive.model
    for keyframe in control.keyframes:
        for joint, value in keyframe.joints:
            facts["joint", joint, f"keyframe {keyframe.name}"] = value
        if keyframe.base is not None:
            facts["robot", "robot", f"keyframe {keyframe.name}, base, m"] = keyframe.base.xyz
    simulation = control.simulation
    facts["robot", "robot", "timestep, s"] = simulation.timestep
    facts["robot", "robot", "decimation"] = float(simulation.decimation)
    facts["robot", "robot", "gravity, m/s2"] = simulation.gravity
    facts["robot", "robot", "contact friction"] = control.contact.friction
    facts["robot", "robot", "excluded pairs"] = float(len(control.excludes))
