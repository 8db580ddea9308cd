"""The recipe's drives and pose, tried before they are written, by the code of the checks.

In MuJoCo, with the hulls of all its links, which may lie inside each other at home and throw the
robot over. What random commands do to its drives is tried on the hulls of its soles alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from assetbuild.checks.gains import Gains
from assetbuild.checks.stand import Stand as StandCheck
from assetbuild.checks.trials import Trials
from assetbuild.control.control import ControlStep
from assetbuild.control.ground import Ground
from assetbuild.engine.scratch import Scratch, scratch
from assetbuild.errors import AssetBuildError
from assetbuild.findings import Finding
from assetbuild.init.draft import patterns_of, with_remedy
from assetbuild.init.drives import DriveRow
from assetbuild.init.home import DEEP_M, Depths, Pair, nothing_deep
from assetbuild.init.look import InspectedRobot
from assetbuild.mesh.hull import capped
from assetbuild.mesh.obj import obj_bytes
from assetbuild.recipe_types import listed
from assetbuild.robot.actuator_table import ActuatorRow
from assetbuild.robot.actuators import RowError
from assetbuild.robot.codec import encode
from assetbuild.robot.contact import Exclude
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Control
from assetbuild.robot.sections import Keyframe, Simulation
from assetbuild.robot.shapes import Geometry, Mesh, MeshAsset, MeshFile, Shape, Shapes
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import trials as mujoco_trials
from assetbuild.simulators.mujoco.drives import servoed
from assetbuild.simulators.mujoco.stand import Stand, outcome, outcome_figures, stand
from assetbuild.simulators.mujoco.trials import support
from assetbuild.targets.mjcf import Mjcf

JUDGE = StandCheck()
"""The check `stand` with its defaults, by which a build judges what `init` tries here."""
CORNERS = 64
"""Most vertices of a hull."""
SOLE_M = 0.02
"""What of a foot is so near to the floor may carry the robot: not every sole is drawn level."""
PUSHED_RAD = JUDGE.max_tilt / 2.0
"""Tilt of the base at which `init` asks whether overlapping bodies push the robot askew."""

ADJACENT = Exclude(adjacent=True)


@dataclass(frozen=True)
class Trial:
    """What came of it. stands: None where it could not be tried; sentence: what it did, or why.

    lean: how far its base tilted, rad.
    off: centre of mass beyond the middle of what stands on the floor at the start, x and y, m.
    errors: what the checks say of drives and pose that a build would stop at.
    refused: why no build takes a key of the recipe, and what to do.
    overlaps: bodies whose hulls must not collide, for else the robot falls or leans, and how deep
    one is inside the other at home, m.
    tried: what did not make it stand, each with what it did then.
    points: whether its feet touch the floor in points that span no area, so that no drive keeps it.
    """

    stands: bool | None
    sentence: str
    lean: float = 0.0
    off: tuple[float, float] = (0.0, 0.0)
    errors: tuple[Finding, ...] = ()
    refused: str = ""
    overlaps: Mapping[Pair, float] = field(default_factory=dict)
    tried: tuple[str, ...] = ()
    points: bool = False

    @property
    def unmended(self) -> tuple[str, ...]:
        """Return what a build has against it, each with the edit that mends it."""
        return (*map(with_remedy, self.errors), *filter(None, (self.refused,)))


@dataclass(frozen=True)
class Stage:
    """The robot as a build has it, with a hull or primitive for each shape, in a folder of its own.

    soles: source links that it stands on; without any nothing is to stand, or nothing can.
    whole: whether all its links touch the floor and each other, or its soles alone.
    """

    robot: InspectedRobot
    soles: Sequence[str]
    shapes: Shapes
    ports: Scratch
    whole: bool

    def attempt(
        self,
        drives: Sequence[DriveRow],
        pose: Mapping[str, float],
        timestep: float,
        exclude: Exclude = ADJACENT,
        driven_by: Control | None = None,
    ) -> Trial:
        """Two seconds at `home`, with the tables of the recipe, a row for each drive's pattern.

        driven_by: the drives of a source that has its own, which are not judged here.
        """
        everything = [joint.name for joint in self.robot.tree.moving_joints]
        rows = [
            ActuatorRow.model_validate({"joints": pattern, **row.keys})
            for row in drives
            for pattern in patterns_of(row.joints, everything)
        ]
        joints = {re.escape(name): value for name, value in pose.items()}
        home = Keyframe.model_validate({"base": "on_ground", "joints": joints})
        control = ControlStep(
            rows=tuple(rows),
            keyframes={"home": home},
            simulation=Simulation(timestep=timestep),
            exclude=exclude,
        )
        try:
            findings = list(self.ports.run(control))
            made = RobotFiles(self.ports.folder).control
            if driven_by is not None:
                made = replace(made, actuators=driven_by.actuators)
                self.ports.put("control.json", encode(made))
            model = self._compiled()
            if driven_by is None:
                gains = Gains(feet=listed(self.soles) or None)
                findings += (*self.ports.run(gains), *Trials().dangers(self._on_soles(model)))
            errors = tuple(finding for finding in findings if finding.severity == "error")
            if not self.soles:
                return Trial(False, "has no shape on its feet to stand on", errors=errors)
            if not any(shape.link in self.soles for shape in self.shapes.shapes):
                return Trial(None, "no shape of its soles can be read", errors=errors)
            trial = self._tried(model, control, made)
            points = not support(model).is_area
            return replace(trial, errors=errors, off=support(model, SOLE_M).off_m, points=points)
        except RowError as error:
            return Trial(None, error.message, refused=f"{error.message} ({error.hint})")
        except AssetBuildError as error:
            return Trial(None, error.message)

    def depths(self, exclude: Exclude) -> Depths:
        """How deep bodies lie in each other, in any pose, or of a fixed robot that is drawn to
        stand on z = 0 below it: the scenes' floor gives way, its own does not. {} without shapes.
        """
        home = {"home": Keyframe.model_validate({})}
        try:
            list(self.ports.run(ControlStep(keyframes=home, exclude=exclude)))
            model = self._compiled()
        except AssetBuildError:  # what only the build can read, it judges
            return nothing_deep
        tree = self.robot.tree
        ground = Ground(tree, self.shapes, self.ports.folder / "meshes")
        scenery = [floor for floor in mujoco.floors(model) if model.geom_bodyid[floor] == 0]
        stands = tree.base == "fixed" and (not scenery or ground.base_stands_on_zero)
        model.geom_pos[scenery, 2] = 0.0

        def measured(pose: Mapping[str, float]) -> dict[Pair, float]:
            between = mujoco_trials.depths(model, with_mimics(tree, pose))
            deepest = self._deepest({pair: d for pair, d in between.items() if stands or pair[0]})
            return {pair: depth for pair, depth in deepest.items() if depth > DEEP_M}

        return measured

    def _deepest(self, depths: Mapping[Pair, float]) -> dict[Pair, float]:
        """The largest depth of each two bodies, by those of two shapes; "" is the floor."""
        shapes = self.shapes.shapes
        bodies = {shape.name: self.robot.tree.placement(shape.link)[0] for shape in shapes}
        deepest: dict[Pair, float] = {}
        for pair, depth in depths.items():
            one, other = sorted(bodies[shape] if shape else "" for shape in pair)
            deepest[one, other] = max(depth, deepest.get((one, other), 0.0))
        return deepest

    def _compiled(self) -> mujoco.Model:
        self.ports.run(Mjcf(robot="robot"))
        return mujoco.load(self.ports.folder / "mjcf" / "scene.xml", visuals=False).model

    def _on_soles(self, model: mujoco.Model) -> mujoco.Model:
        """The same with no other link of the robot that touches anything."""
        soles = {shape.name for shape in self.shapes.shapes if shape.link in self.soles}
        alone = mujoco.without(model)
        for geom in mujoco.collision_geoms(model):
            if mujoco.name_of(model, "geom", geom) not in soles:
                alone.geom_contype[geom] = alone.geom_conaffinity[geom] = 0
        return alone

    def _tried(self, model: mujoco.Model, control: ControlStep, made: Control) -> Trial:
        """A mesh becomes smaller pieces than its hull, so overlaps count only where they push the
        robot over or askew. It is then tried without the collisions of these pairs.
        """
        scene = model if self.whole else self._on_soles(model)
        stood = stand(servoed(scene, made), "home", JUDGE.seconds)
        found = self._deepest(stood.overlapping)
        deep = {pair: depth for pair, depth in found.items() if depth > JUDGE.sole}
        if deep and self.whole and not _is_upright(stood):
            without = Exclude(adjacent=True, pairs=(*control.exclude.pairs, *deep))
            list(self.ports.run(control.model_copy(update={"exclude": without})))
            freed = stand(servoed(self._compiled(), made), "home", JUDGE.seconds)
            if _is_upright(freed):
                return replace(self._judged(freed), overlaps=deep)
        return self._judged(stood)

    def _judged(self, stood: Stand) -> Trial:
        """A robot that leans may fall on the shapes of the build, and so may one whose soles are
        not on the floor; below the floor is no height.
        """
        did = outcome(stood, JUDGE.fall)
        if did != "stands":
            verb = "becomes unstable" if did == "unstable" else "falls"
            return Trial(False, f"{verb} within {JUDGE.seconds:g} s")
        if stood.tilt_rad > JUDGE.max_tilt:
            leans = f"leans by {stood.tilt_rad:.2g} rad after {JUDGE.seconds:g} s"
            return Trial(False, f"{leans}, more than {JUDGE.max_tilt:g}")
        if self.whole:
            judge = JUDGE.model_copy(update={"feet": listed(self.soles)})
            findings = judge.evaluate(stood, self.robot.tree, self.shapes)
            error = next((finding for finding in findings if finding.severity == "error"), None)
            if error is not None:
                return Trial(False, f"stands, but {error.subject}: {error.message}")
        sentence = str(outcome_figures(stood, JUDGE.fall)["sentence"])
        return Trial(True, sentence, stood.tilt_rad)


def _is_upright(stood: Stand) -> bool:
    return outcome(stood, JUDGE.fall) == "stands" and stood.tilt_rad <= PUSHED_RAD


@contextmanager
def staged(robot: InspectedRobot, soles: Sequence[str], *, whole: bool = True) -> Iterator[Stage]:
    """Lay the robot out. soles: source links."""
    links = sorted(robot.solid_links | set(soles))
    with scratch() as ports:
        shapes = _shapes_of(robot, links, ports)
        for name, value in (("links", robot.links), ("tree", robot.tree), ("shapes", shapes)):
            ports.put(f"{name}.json", encode(value))
        yield Stage(robot, soles, shapes, ports, whole)


def _shapes_of(robot: InspectedRobot, links: Sequence[str], ports: Scratch) -> Shapes:
    """Write the hulls to `meshes/`; shapes that are flat or cannot be read are left out.

    The shapes are those of the links that collide; a link without any is taken as it is drawn.
    """
    (ports.folder / "meshes").mkdir()
    of_links = [[shape for shape in robot.shapes.shapes if shape.link == link] for link in links]
    used = (s for all in of_links for s in [s for s in all if s.role == "collision"] or all)
    shapes, assets = [], []
    for index, shape in enumerate(used):
        name, source = f"shape_{index}", shape.geometry
        geometry: Geometry
        if isinstance(source, MeshFile):
            hull = robot.hull_of(source, "honour" if source.path in robot.turned else "ignore")
            if hull is None or not len(hull.faces):
                continue
            hull = capped(hull, CORNERS, None, subject=name)
            asset = MeshAsset(name, f"{name}.obj", len(hull.vertices), len(hull.faces), convex=True)
            ports.put(f"meshes/{asset.file}", obj_bytes(hull))
            assets.append(asset)
            geometry = Mesh(asset.name)
        else:
            geometry = source
        shapes.append(Shape(name, shape.link, "collision", geometry, shape.X_link_shape))
    return Shapes(tuple(shapes), (), tuple(assets))
