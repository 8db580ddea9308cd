"""The recipe's drives and pose, tried before they are written, by the code of the checks.

In MuJoCo, on the hulls of the robot's soles alone: a robot that stands touches the floor with them.
What else collides is left to the build.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from assetbuild.checks.gains import Gains
from assetbuild.checks.trials import Trials
from assetbuild.control.control import ControlStep
from assetbuild.engine.scratch import Scratch, scratch
from assetbuild.errors import AssetBuildError
from assetbuild.findings import Finding
from assetbuild.init.drives import DriveRow
from assetbuild.init.look import InspectedRobot
from assetbuild.init.mesh_points import mesh_of, scaled_points
from assetbuild.init.patterns import patterns_of
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.obj import obj_bytes
from assetbuild.robot.actuator_table import ActuatorRow
from assetbuild.robot.actuators import RowError
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.poses import Keyframe
from assetbuild.robot.shapes import Geometry, Mesh, MeshAsset, MeshFile, Shape, Shapes, SourceShape
from assetbuild.robot.simulation import Simulation
from assetbuild.simulators import mujoco
from assetbuild.simulators import mujoco_stand as held
from assetbuild.simulators.mujoco_stand import Stand, outcome, outcome_figures, stand
from assetbuild.targets.mjcf import Mjcf

SECONDS, FALL, UPRIGHT_RAD = 2.0, 0.5, 0.1
"""As the check `stand` judges by default: how long, what is a fall, and what tilt is too much."""
CORNERS = 64
"""Most vertices of a sole's hull."""


@dataclass(frozen=True)
class Trial:
    """What came of it. stands: None where it could not be tried; sentence: what it did, or why.

    errors: what the checks say of drives and pose that a build would stop at.
    refused: the key of the recipe that no build takes, and why.
    """

    stands: bool | None
    sentence: str
    errors: tuple[Finding, ...] = ()
    refused: RowError | None = None

    @property
    def is_fine(self) -> bool:
        """Whether a build has nothing against it."""
        return not self.errors and self.refused is None


def try_to_stand(
    robot: InspectedRobot,
    root: Path,
    soles: Sequence[str],
    control: ControlStep,
    driven_by: Control | None = None,
) -> Trial:
    """Two seconds at `home` on the soles. root: of the source's files; soles: source links.

    Without soles nothing is to stand, or nothing can. control: the tables of the recipe;
    driven_by: the drives of a source that has its own, which are not judged here.
    """
    try:
        with scratch() as ports:
            shapes = _soles(robot, root, soles, ports)
            for name, value in (("links", robot.links), ("tree", robot.tree), ("shapes", shapes)):
                ports.put(f"{name}.json", encode(value))
            said = list(ports.run(control))
            made = RobotFiles(ports.folder).control
            if driven_by is not None:
                made = replace(made, actuators=driven_by.actuators)
                ports.put("control.json", encode(made))
            else:
                said += ports.run(Gains(feet="|".join(map(re.escape, soles)) or None))
            ports.run(Mjcf(robot="robot"))
            model = mujoco.load(ports.folder / "mjcf" / "scene.xml", visuals=False).model
            if driven_by is None:
                said += Trials().dangers(model)
            errors = tuple(finding for finding in said if finding.severity == "error")
            if not soles:
                return Trial(False, "has no shape on its feet to stand on", errors)
            if not shapes.shapes:
                return Trial(None, "no shape of its soles can be read", errors)
            laws = {
                a.joint: held.Gains(a.kp, a.kd, a.effort)
                for a in made.actuators
                if a.model in ("ideal_pd", "dc_motor", "motor")
            }
            return replace(_judged(stand(model, "home", SECONDS, laws)), errors=errors)
    except RowError as error:
        return Trial(None, error.message, refused=error)
    except AssetBuildError as error:
        return Trial(None, error.message)


def _judged(stood: Stand) -> Trial:
    """A robot that leans may fall on the shapes of the build; below the floor is no height."""
    did = outcome(stood, FALL)
    if did == "stands" and stood.tilt_rad <= UPRIGHT_RAD:
        return Trial(True, str(outcome_figures(stood, FALL)["sentence"]))
    leans = f"leans by {stood.tilt_rad:.2g} rad after {SECONDS:g} s, more than {UPRIGHT_RAD:g}"
    falls = f"{'becomes unstable' if did == 'unstable' else 'falls'} within {SECONDS:g} s"
    return Trial(False, leans if did == "stands" else falls)


def tables(
    tree: Tree,
    drives: Sequence[DriveRow],
    pose: Mapping[str, float],
    simulation: Mapping[str, object],
) -> ControlStep:
    """The step that a build of the recipe would run, with a row for each drive's pattern."""
    everything = [joint.name for joint in tree.moving_joints]
    rows = [
        ActuatorRow.model_validate({"joints": pattern, **row.keys})
        for row in drives
        for pattern in patterns_of(row.joints, everything)
    ]
    joints = {re.escape(name): value for name, value in pose.items()}
    home = Keyframe.model_validate({"base": "on_ground", "joints": joints})
    return ControlStep(
        rows=tuple(rows),
        keyframes={"home": home},
        simulation=Simulation.model_validate(simulation),
    )


def _soles(robot: InspectedRobot, root: Path, soles: Sequence[str], ports: Scratch) -> Shapes:
    """The soles as `collision` of the recipe makes them."""
    (ports.folder / "meshes").mkdir()
    shapes, assets = [], []
    for index, shape in enumerate(_shapes_of(robot, soles)):
        name, source = f"sole_{index}", shape.geometry
        geometry: Geometry
        if isinstance(source, MeshFile):
            asset = _hull(shape, source, root, name, ports)
            if asset is None:
                continue
            assets.append(asset)
            geometry = Mesh(asset.name)
        else:
            geometry = source
        shapes.append(Shape(name, shape.link, "collision", geometry, shape.X_link_shape))
    return Shapes(tuple(shapes), (), tuple(assets))


def _shapes_of(robot: InspectedRobot, links: Sequence[str]) -> Iterator[SourceShape]:
    """The collision shapes of each link; of one that has none, what is drawn of it."""
    for link in links:
        own = [shape for shape in robot.shapes.shapes if shape.link == link]
        yield from [s for s in own if s.role == "collision"] or own


def _hull(
    shape: SourceShape, mesh: MeshFile, root: Path, name: str, ports: Scratch
) -> MeshAsset | None:
    """Written to `meshes/`; None for a mesh that cannot be read."""
    read = mesh_of(root, mesh)
    if read is None:
        return None
    hull = convex_hull(scaled_points(read, mesh), max_vertices=CORNERS, subject=shape.name)
    asset = MeshAsset(name, f"{name}.obj", len(hull.vertices), len(hull.faces), convex=True)
    ports.put(f"meshes/{asset.file}", obj_bytes(hull))
    return asset
