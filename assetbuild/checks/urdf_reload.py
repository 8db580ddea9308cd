"""Does the URDF that we wrote say what the robot is? Read back by yourdfpy, not by us."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Check, write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import matrix_of
from assetbuild.robot.model import Body, Control, Joint, Tree
from assetbuild.robot.tree import forward_kinematics, held_by_world, sample_positions

DIFFERS = Rule(
    "urdf.reload.*",
    "error",
    "yourdfpy reads something else from the written URDF",
    "report it: this is a bug",
)


class UrdfReload(Check):
    """Structure, masses, limits, mesh files, and kinematics at random positions.

    Kinematics: largest difference of any entry of a link's 4 x 4 pose in the root link; metres
    and direction cosines.
    """

    version: ClassVar = "3"
    tools: ClassVar = ("yourdfpy", "trimesh")
    isolated: ClassVar = True
    preload: ClassVar = ("yourdfpy",)
    needs: ClassVar = ("urdf",)
    reads: ClassVar = ("links.json", "ratings.json")

    robot: str
    samples: int = 10
    tolerance: float = 1e-9

    def run(self, files: Files) -> Iterator[Finding]:
        """Writes figures.json even when something is off."""
        import yourdfpy

        robot = RobotFiles(files.inputs)
        links, control = held_by_world(robot.links), robot.ratings
        folder = files.inputs / "urdf"
        path = folder / f"{self.robot}.urdf"
        figures: dict[str, object] = {"samples": self.samples}
        findings: list[Finding] = []
        try:
            model = yourdfpy.URDF.load(str(path), build_scene_graph=False).robot
        except Exception as error:  # whatever a parser throws is the finding
            findings.append(_off("unreadable", "robot", f"yourdfpy cannot read it: {error}"))
        else:
            findings += _structure(links, model)
            figures |= {"links": len(model.links), "joints": len(model.joints)}
            findings += _meshes(model, folder, figures)
            if not any(finding.rule == "urdf.reload.structure" for finding in findings):
                findings += _masses(links, model, figures)
                findings += _limits(links, control, model)
                findings += self._kinematics(links, model, figures)
        write_figures(files, figures)
        yield from findings

    def _kinematics(
        self,
        links: Tree,
        model: Any,
        figures: dict[str, object],  # Any: yourdfpy has no types
    ) -> Iterator[Finding]:
        import yourdfpy

        for link in model.links:
            link.visuals, link.collisions = [], []  # no geometry is built, frames are enough
        for joint in model.joints:
            joint.mimic = None  # every joint moves by its own entry, as in our kinematics
        moving = yourdfpy.URDF(robot=model, load_meshes=False)
        worst, where = 0.0, links.root
        for positions in sample_positions(links, self.samples, seed=0):
            if positions:
                moving.update_cfg(positions)
            for name, X_root_link in forward_kinematics(links, positions).items():
                theirs = np.eye(4) if name == links.root else moving.get_transform(name)
                error = float(np.abs(theirs - X_root_link.matrix()).max())
                if not error <= worst:
                    worst, where = error, name
        figures["kinematics_error"] = worst
        if not worst <= self.tolerance:
            message = f"yourdfpy places it {worst:.3g} off (at most {self.tolerance:g})"
            yield _off("kinematics", f"link {where}", message, error=worst)


def _structure(links: Tree, model: Any) -> Iterator[Finding]:  # Any: yourdfpy has no types
    """Names and kinds; an order of the parser's own would change nothing."""
    wanted = {f"link {body.name}" for body in links.bodies}
    wanted |= {f"joint {joint.name}" for joint in links.joints}
    found = {f"link {link.name}" for link in model.links}
    found |= {f"joint {joint.name}" for joint in model.joints}
    for subject in sorted(wanted - found):
        yield _off("structure", subject, "it is missing in the URDF")
    for subject in sorted(found - wanted):
        yield _off("structure", subject, "the robot has no such thing, the URDF does")
    theirs = {joint.name: joint for joint in model.joints}
    for joint in links.joints:
        other = theirs.get(joint.name)
        if other is None:
            continue
        if (other.type, other.parent, other.child) != (joint.kind, joint.parent, joint.child):
            message = f"it is {other.type} from `{other.parent}` to `{other.child}` in the URDF"
            yield _off("structure", f"joint {joint.name}", message)
        if (other.mimic.joint if other.mimic else None) != _leader(joint):
            yield _off("structure", f"joint {joint.name}", "it mimics another joint in the URDF")


def _leader(joint: Joint) -> str | None:
    return joint.mimic.joint if joint.mimic else None


def _masses(
    links: Tree,
    model: Any,
    figures: dict[str, object],  # Any: yourdfpy has no types
) -> Iterator[Finding]:
    total = 0.0
    for link in model.links:
        body = links.by_body[link.name]
        mass = link.inertial.mass if link.inertial else 0.0
        total += mass
        if not _same_inertial(body, link.inertial):
            message = f"mass, centre of mass or inertia changed on the way, mass {mass!r} kg"
            yield _off("mass", f"link {link.name}", message, mass_kg=float(mass))
    figures["mass_kg"] = total


def _same_inertial(body: Body, other: Any) -> bool:  # Any: yourdfpy has no types
    if body.inertial is None or other is None:
        return body.inertial is None and other is None
    origin = np.eye(4) if other.origin is None else other.origin
    return bool(
        other.mass == body.inertial.mass_kg
        and np.array_equal(origin[:3, 3], body.inertial.com_m)
        and np.array_equal(origin[:3, :3], np.eye(3))
        and np.array_equal(other.inertia, matrix_of(body.inertial.inertia_com_kg_m2))
    )


def _limits(links: Tree, control: Control, model: Any) -> Iterator[Finding]:  # Any: as above
    """Effort and velocity are the actuator's where there is one, else the source's."""
    theirs = {joint.name: joint for joint in model.joints}
    for joint in links.moving_joints:
        row = control.by_joint.get(joint.name) or joint.limits
        effort = joint.limits.effort if row.effort is None else row.effort
        velocity = joint.limits.velocity if row.velocity is None else row.velocity
        wanted = (joint.limits.lower, joint.limits.upper, effort, velocity)
        limit = theirs[joint.name].limit
        found = (limit.lower, limit.upper, limit.effort, limit.velocity) if limit else (None,) * 4
        if found != wanted:
            message = f"limits (lower, upper, effort, velocity) are {found} and should be {wanted}"
            yield _off("limits", f"joint {joint.name}", message)


def _meshes(
    model: Any,
    folder: Path,
    figures: dict[str, object],  # Any: yourdfpy has no types
) -> Iterator[Finding]:
    names: dict[str, str] = {}
    for link in model.links:
        for shape in [*link.visuals, *link.collisions]:
            if shape.geometry.mesh is not None:
                names.setdefault(shape.geometry.mesh.filename, link.name)
    figures["meshes"] = len(names)
    for name in sorted(names):
        if not (folder / name).is_file():
            yield _off("mesh", f"link {names[name]}", f"its mesh file `{name}` is not there")


def _off(kind: str, subject: str, message: str, **data: float) -> Finding:
    hint = "this is a fault of assetbuild: please report it with the recipe"
    return DIFFERS.named(kind)(subject, message, hint, data=data)
