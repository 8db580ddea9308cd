"""The recipe's drives and pose, tried before they are written, by the code of the checks.

In MuJoCo, first on the hulls of the robot's soles alone, for that is quick: a robot that stands
touches the floor with them. One that stands so is tried once more with the hulls of all its links,
which may lie inside each other at home and throw the robot over.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from assetbuild.checks.gains import Gains
from assetbuild.checks.stand import Stand as StandCheck
from assetbuild.checks.trials import Trials
from assetbuild.control.control import ControlStep
from assetbuild.engine.scratch import Scratch, scratch
from assetbuild.errors import AssetBuildError, StepError
from assetbuild.findings import Finding
from assetbuild.init.drives import DriveRow
from assetbuild.init.look import InspectedRobot
from assetbuild.init.mesh_points import mesh_of, scaled_points
from assetbuild.init.patterns import patterns_of
from assetbuild.mesh.hull import convex_hull
from assetbuild.mesh.material import SourceMesh
from assetbuild.mesh.obj import obj_bytes
from assetbuild.mesh.read import UpAxis
from assetbuild.robot.actuator_table import ActuatorRow
from assetbuild.robot.actuators import RowError
from assetbuild.robot.codec import encode
from assetbuild.robot.contact import Exclude
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.loops import LoopRow
from assetbuild.robot.model import Control, Tree
from assetbuild.robot.poses import Keyframe
from assetbuild.robot.shapes import Geometry, Mesh, MeshAsset, MeshFile, Shape, Shapes, SourceShape
from assetbuild.robot.simulation import Simulation
from assetbuild.simulators import mujoco
from assetbuild.simulators import mujoco_stand as held
from assetbuild.simulators.mujoco_stand import Stand, outcome, outcome_figures, stand
from assetbuild.targets.mjcf import Mjcf

JUDGE = StandCheck()
"""The check `stand` with its defaults, by which a build judges what `init` tries here."""
CORNERS = 64
"""Most vertices of a hull."""
PUSHED_RAD = JUDGE.max_tilt / 2.0
"""Tilt of the base at which `init` asks whether overlapping bodies push the robot askew."""

Pairs = Mapping[tuple[str, str], float]
"""Two bodies -> how deep one is inside the other at home, m."""


@dataclass(frozen=True)
class Trial:
    """What came of it. stands: None where it could not be tried; sentence: what it did, or why.

    drift: how far its base wandered, m.
    errors: what the checks say of drives and pose that a build would stop at.
    refused: the key of the recipe that no build takes, and why.
    overlaps: bodies whose hulls must not collide, for else the robot falls or leans.
    """

    stands: bool | None
    sentence: str
    drift: float = 0.0
    errors: tuple[Finding, ...] = ()
    refused: RowError | None = None
    overlaps: Pairs = field(default_factory=dict)

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
    turned: Collection[str] = (),
) -> Trial:
    """Two seconds at `home` on the soles. root: of the source's files; soles: source links.

    Without soles nothing is to stand, or nothing can. control: the tables of the recipe;
    driven_by: the drives of a source that has its own, which are not judged here.
    turned: paths of the meshes that the recipe turns as their files say.
    """
    try:
        with scratch() as ports:
            shapes = _laid_out(robot, root, soles, ports, turned)
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
                return Trial(False, "has no shape on its feet to stand on", errors=errors)
            if not shapes.shapes:
                return Trial(None, "no shape of its soles can be read", errors=errors)
            return replace(_judged(stand(model, "home", JUDGE.seconds, _laws(made))), errors=errors)
    except RowError as error:
        return Trial(None, error.message, refused=error)
    except AssetBuildError as error:
        return Trial(None, error.message)


def try_whole(
    robot: InspectedRobot,
    root: Path,
    soles: Sequence[str],
    control: ControlStep,
    trial: Trial,
    turned: Collection[str] = (),
) -> Trial:
    """The trial of a robot that stands on its soles, tried with the hulls of all its links.

    A mesh becomes smaller pieces than its hull, so overlaps count only where they push it over or
    askew. It is then tried without the collisions of these pairs.
    """
    if not trial.stands:
        return trial
    links = sorted(robot.solid_links | set(soles))
    try:
        with scratch() as ports:
            shapes = _laid_out(robot, root, links, ports, turned)
            body = {s.name: robot.tree.placement(s.link)[0] for s in shapes.shapes}
            stood = _stood(ports, control)
            if outcome(stood, JUDGE.fall) == "stands" and stood.tilt_rad <= PUSHED_RAD:
                return _objected(trial, stood, robot.tree, shapes, soles)
            deep: dict[tuple[str, str], float] = {}
            for (a, b), depth in stood.overlapping.items():
                pair = min(body[a], body[b]), max(body[a], body[b])
                if depth > JUDGE.sole:
                    deep[pair] = max(depth, deep.get(pair, 0.0))
            if deep:
                without = Exclude(adjacent=True, pairs=(*control.exclude.pairs, *deep))
                freed = _stood(ports, control.model_copy(update={"exclude": without}))
                if outcome(freed, JUDGE.fall) == "stands" and freed.tilt_rad <= PUSHED_RAD:
                    freely = replace(trial, overlaps=deep)
                    return _objected(freely, freed, robot.tree, shapes, soles)
            if outcome(stood, JUDGE.fall) == "stands":
                return _objected(trial, stood, robot.tree, shapes, soles)
    except AssetBuildError:  # what only the build can read, it judges
        return trial
    falls = "becomes unstable" if outcome(stood, JUDGE.fall) == "unstable" else "falls"
    with_all = f"stands, but {falls} within {JUDGE.seconds:g} s with the hulls of all its links"
    return replace(trial, stands=False, sentence=with_all)


def _objected(
    trial: Trial, stood: Stand, tree: Tree, shapes: Shapes, soles: Sequence[str]
) -> Trial:
    """Return the trial of a robot that stands, as one that does not where the check objects."""
    judge = JUDGE.model_copy(update={"feet": "|".join(map(re.escape, soles))})
    said = judge.judged(stood, tree, shapes)
    error = next((finding for finding in said if finding.severity == "error"), None)
    if error is None:
        return trial
    return replace(trial, stands=False, sentence=f"stands, but {error.subject}: {error.message}")


def _stood(ports: Scratch, control: ControlStep) -> Stand:
    """What the robot that lies there does at `home`."""
    list(ports.run(control))
    ports.run(Mjcf(robot="robot"))
    model = mujoco.load(ports.folder / "mjcf" / "scene.xml", visuals=False).model
    return stand(model, "home", JUDGE.seconds, _laws(RobotFiles(ports.folder).control))


def _laws(control: Control) -> dict[str, held.Gains]:
    """The drives that a controller outside of the simulator computes."""
    return {
        a.joint: held.Gains(a.kp, a.kd, a.effort)
        for a in control.actuators
        if a.model in ("ideal_pd", "dc_motor", "motor")
    }


def _judged(stood: Stand) -> Trial:
    """A robot that leans may fall on the shapes of the build; below the floor is no height."""
    did = outcome(stood, JUDGE.fall)
    if did == "stands" and stood.tilt_rad <= JUDGE.max_tilt:
        return Trial(True, str(outcome_figures(stood, JUDGE.fall)["sentence"]), stood.drift_m)
    leans = (
        f"leans by {stood.tilt_rad:.2g} rad after {JUDGE.seconds:g} s, more than {JUDGE.max_tilt:g}"
    )
    falls = f"{'becomes unstable' if did == 'unstable' else 'falls'} within {JUDGE.seconds:g} s"
    return Trial(False, leans if did == "stands" else falls)


def tables(
    tree: Tree,
    drives: Sequence[DriveRow],
    pose: Mapping[str, float],
    simulation: Mapping[str, object],
    loops: tuple[LoopRow, ...] = (),
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
        loops=loops,
    )


def _laid_out(
    robot: InspectedRobot,
    root: Path,
    links: Sequence[str],
    ports: Scratch,
    turned: Collection[str],
) -> Shapes:
    """The robot as a build has it, with a hull or primitive for each shape of these links."""
    (ports.folder / "meshes").mkdir()
    shapes, assets = [], []
    for index, shape in enumerate(_shapes_of(robot, links)):
        name, source = f"shape_{index}", shape.geometry
        geometry: Geometry
        if isinstance(source, MeshFile):
            up_axis: UpAxis = "honour" if source.path in turned else "ignore"
            asset = _hull(shape, mesh_of(root, source, up_axis), name, ports)
            if asset is None:
                continue
            assets.append(asset)
            geometry = Mesh(asset.name)
        else:
            geometry = source
        shapes.append(Shape(name, shape.link, "collision", geometry, shape.X_link_shape))
    made = Shapes(tuple(shapes), (), tuple(assets))
    for name, value in (("links", robot.links), ("tree", robot.tree), ("shapes", made)):
        ports.put(f"{name}.json", encode(value))
    return made


def _shapes_of(robot: InspectedRobot, links: Sequence[str]) -> Iterator[SourceShape]:
    """The collision shapes of each link; of one that has none, what is drawn of it."""
    for link in links:
        own = [shape for shape in robot.shapes.shapes if shape.link == link]
        yield from [s for s in own if s.role == "collision"] or own


def _hull(
    shape: SourceShape, read: SourceMesh | None, name: str, ports: Scratch
) -> MeshAsset | None:
    """Written to `meshes/`; None for a mesh that cannot be read or is flat."""
    if read is None or not isinstance(mesh := shape.geometry, MeshFile):
        return None
    try:
        hull = convex_hull(scaled_points(read, mesh), max_vertices=CORNERS, subject=shape.name)
    except StepError:
        return None
    asset = MeshAsset(name, f"{name}.obj", len(hull.vertices), len(hull.faces), convex=True)
    ports.put(f"meshes/{asset.file}", obj_bytes(hull))
    return asset
