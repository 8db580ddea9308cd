"""Does a robot stand by its drives? Held at home in MuJoCo, on the hulls of its soles alone.

What else collides is left to the build: a robot that stands touches the floor with its soles.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from assetbuild.control.control import ControlStep
from assetbuild.engine.scratch import Scratch, scratch
from assetbuild.errors import AssetBuildError
from assetbuild.init.drives import DriveRow
from assetbuild.init.look import InspectedRobot
from assetbuild.init.mesh_points import mesh_of, scaled_points
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.obj import obj_bytes
from assetbuild.robot.actuator_table import ActuatorRow
from assetbuild.robot.actuators import RowError
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control
from assetbuild.robot.poses import Keyframe
from assetbuild.robot.shapes import Geometry, Mesh, MeshAsset, MeshFile, Shape, Shapes, SourceShape
from assetbuild.robot.simulation import Simulation
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco_stand import Gains, Stand, outcome, outcome_figures, stand
from assetbuild.targets.mjcf import Mjcf

SECONDS, FALL, UPRIGHT_RAD = 2.0, 0.5, 0.1
"""As the check `stand` judges by default: how long, what is a fall, and what tilt is too much."""
CORNERS = 64
"""Most vertices of a sole's hull."""


@dataclass(frozen=True)
class Trial:
    """What came of it. stands: None where it could not be tried; sentence: what it did, or why."""

    stands: bool | None
    sentence: str


def try_to_stand(
    robot: InspectedRobot,
    root: Path,
    soles: Sequence[str],
    control: ControlStep,
    driven_by: Control | None = None,
) -> Trial:
    """Two seconds at `home` on the soles. root: of the source's files; soles: source links.

    control: the tables of the recipe; driven_by: the drives of a source that has its own.
    """
    try:
        with scratch() as ports:
            shapes = _soles(robot, root, soles, ports)
            if not shapes.shapes:
                return Trial(None, "no shape of its soles can be read")
            for name, value in (("links", robot.links), ("tree", robot.tree), ("shapes", shapes)):
                ports.put(f"{name}.json", encode(value))
            ports.run(control)
            made = RobotFiles(ports.folder).control
            if driven_by is not None:
                made = replace(made, actuators=driven_by.actuators)
                ports.put("control.json", encode(made))
            ports.run(Mjcf(robot="robot"))
            model = mujoco.load(ports.folder / "mjcf" / "scene.xml", visuals=False).model
            laws = {
                a.joint: Gains(a.kp, a.kd, a.effort)
                for a in made.actuators
                if a.model in ("ideal_pd", "dc_motor", "motor")
            }
            stood = stand(model, "home", SECONDS, laws)
    except (AssetBuildError, RowError) as error:
        return Trial(None, error.message)
    return _judged(stood)


def _judged(stood: Stand) -> Trial:
    """A robot that leans may fall on the shapes of the build; below the floor is no height."""
    did = outcome(stood, FALL)
    if did == "stands" and stood.tilt_rad <= UPRIGHT_RAD:
        return Trial(True, str(outcome_figures(stood, FALL)["sentence"]))
    leans = f"leans by {stood.tilt_rad:.2g} rad after {SECONDS:g} s, more than {UPRIGHT_RAD:g}"
    falls = f"{'becomes unstable' if did == 'unstable' else 'falls'} within {SECONDS:g} s"
    return Trial(False, leans if did == "stands" else falls)


def tables(
    drives: Sequence[DriveRow], pose: Mapping[str, float], simulation: Mapping[str, object]
) -> ControlStep:
    """The step that a build of the recipe would run."""
    rows = [
        ActuatorRow.model_validate({"joints": "|".join(map(re.escape, row.joints)), **_keys(row)})
        for row in drives
    ]
    joints = {re.escape(name): value for name, value in pose.items()}
    home = Keyframe.model_validate({"base": "on_ground", "joints": joints})
    return ControlStep(
        rows=tuple(rows),
        keyframes={"home": home},
        simulation=Simulation.model_validate(simulation),
    )


def _keys(row: DriveRow) -> dict[str, object]:
    if row.locked or row.effort is None:
        return {"model": "passive"}
    return {"model": "pd", **row.gains, **dict.fromkeys(row.drops, 0)}


def _soles(robot: InspectedRobot, root: Path, soles: Sequence[str], ports: Scratch) -> Shapes:
    """The soles' collision shapes; of a robot that has none, what is drawn of them."""
    (ports.folder / "meshes").mkdir()
    solid = robot.shapes.of("collision") or robot.shapes.of("visual")
    shapes, assets = [], []
    for index, shape in enumerate(one for one in solid if one.link in soles):
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
