"""What the recipe adds to the geometry: actuators, poses, excludes, contact, simulation."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from pydantic import Field

from assetbuild.control.close_loops import (
    check_locked,
    check_start,
    closed_pose,
    driven_joints,
    placed_loops,
    solved_findings,
    source_findings,
)
from assetbuild.control.findings import actuator_findings, contact_findings, row_findings
from assetbuild.control.ground import Ground, placed_base, with_reach
from assetbuild.control.senses import (
    check_sensors,
    check_surfaces,
    placed_cameras,
    placed_sensors,
)
from assetbuild.control.source_control import StatedControl, join, source_keyframes
from assetbuild.engine.step import Files, Step
from assetbuild.errors import Gather, meant_pattern
from assetbuild.findings import Finding, Rule
from assetbuild.robot import model
from assetbuild.robot.actuator_table import ActuatorRow, Motor
from assetbuild.robot.actuators import RowError, resolve
from assetbuild.robot.chains import find_chains
from assetbuild.robot.codec import encode
from assetbuild.robot.contact import Contacts, Exclude
from assetbuild.robot.files import RobotFiles, SourceControl
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.loops import LoopRow, resolve_loops, row_numbers
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.mjcf_only import joint_springs, root_pose
from assetbuild.robot.sections import Camera, Feet, Imu, Keyframe, Sensor, Simulation
from assetbuild.robot.shapes import Shapes
from assetbuild.robot.sides import Side, moving_by_source, side_of
from assetbuild.robot.softness import CouplingError, LimitError, softened
from assetbuild.robot.tree import link_placement, unit_of

LIMIT_TOLERANCE = 1e-9
"""rad or m; a value that was rounded from the limit itself is inside."""

SAME_BODY = Rule(
    "exclude.same_body", "info", "merging put both links of a pair into one body", "remove the pair"
)
KEYFRAME_LIMITS = Rule(
    "keyframe.limits", "error", "a joint value is outside its limits", "choose a value inside"
)
KEYFRAME_TURNS = Rule(
    "keyframe.turns",
    "warning",
    "a keyframe turns a joint without limits by more than one turn",
    "check whether degrees were written for radians",
)


class ControlStep(Step):
    """`control.json`: the recipe's tables, resolved on this robot.

    Reads `tree.json`, `shapes.json` and the collision files of `meshes/`; of an MJCF also
    `source_control.json`, whose words hold where the recipe has none.
    """

    shares = True
    outputs = ("control.json",)

    rows: tuple[ActuatorRow, ...] = ()
    motors: dict[str, Motor] = Field(default_factory=dict)
    keyframes: dict[str, Keyframe] = Field(default_factory=dict)
    contact: Contacts = Contacts.model_validate({})
    simulation: Simulation = Simulation.model_validate({})
    limit_error: LimitError = LimitError.model_validate({})
    coupling_error: CouplingError = CouplingError.model_validate({})
    exclude: Exclude = Exclude.model_validate({})
    feet: Feet | None = None
    imu: Imu | None = None
    sensors: dict[str, Sensor] = Field(default_factory=dict)
    cameras: dict[str, Camera] = Field(default_factory=dict)
    loops: tuple[LoopRow, ...] = ()
    sides: tuple[Side, ...] = (Side(),)
    """The robot, or each of those it is composed of: who decides what, the source or the recipe."""
    poses: dict[str, dict[str, float]] = Field(default_factory=dict)
    """Joints of parts in keyframes that only the base's MJCF has; rad or m."""
    common_surfaces: tuple[str, ...] = ()
    """Patterns of `contact.links` for all of a part: nobody has written them, they may be idle."""

    def check(self, tree: model.Tree) -> None:
        """Raise every RowError that `run` would raise; for a plan that knows tree and lines."""
        wrong, poses = Gather(RowError), []
        for name, keyframe in self.keyframes.items():
            with wrong:
                poses.append(_pose(tree, name, keyframe))
        loops: tuple[model.Loop, ...] = ()
        with wrong:
            loops = resolve_loops(tree, self.loops)
            if not any(side.from_mjcf for side in self.sides):  # whose loops are not known yet
                poses = self._closed(tree, poses, loops, driven_joints(tree, self.rows))
        with wrong:
            self._resolved(tree, poses, loops)
        with wrong:
            _excludes(tree, Shapes(), self.exclude, self.sides, loops)
        with wrong:
            check_sensors(tree, self.imu, self.sensors, self.cameras)
        wrong.stop()

    def _resolved(
        self,
        tree: model.Tree,
        keyframes: Iterable[model.Keyframe],
        loops: tuple[model.Loop, ...],
    ) -> tuple[model.Actuator, ...]:
        """The actuator table; gains by frequency are for the initial pose."""
        start = initial_pose(tree, model.Control(keyframes=tuple(keyframes)))
        driven = moving_by_source(self.sides, (joint.name for joint in tree.moving_joints))
        return resolve(tree, self.rows, self.motors, dict(start.joints), driven, loops)

    def _closed(
        self,
        tree: model.Tree,
        poses: list[model.Keyframe],
        loops: tuple[model.Loop, ...],
        driven: Collection[str],
        sprung: Collection[str] = (),
    ) -> list[model.Keyframe]:
        """The recipe's keyframes with their loops closed, springs and drives left alone where that
        is possible. Raises RowError."""
        if not loops:
            return poses
        rows, closed = row_numbers(self.loops), []
        for pose in poses:
            stated = _joint_values(tree, pose.name, self.keyframes[pose.name])
            closed.append(closed_pose(tree, loops, pose, stated, rows, (driven, sprung)))
        if not any(side.from_mjcf for side in self.sides):
            start = initial_pose(tree, model.Control(keyframes=tuple(closed)))
            check_start(tree, loops, start)
            check_locked(tree, loops, start, driven, rows)
        return closed

    def _poses(self, tree: model.Tree, source: Sequence[model.Keyframe]) -> list[model.Keyframe]:
        """Return the pose of each keyframe; without joints, that of the source's of its name."""
        of_source = {key.name: key for key in source_keyframes(source, tree)}
        return [
            of_source[name]
            if not keyframe.joints and name in of_source
            else _pose(tree, name, keyframe)
            for name, keyframe in self.keyframes.items()
        ]

    def _of_parts(self, tree: model.Tree, pose: Mapping[str, float]) -> dict[str, float]:
        """The value of each joint of the parts; 0 where the pose says none."""
        whole = with_mimics(tree, pose)
        return {name: q for name, q in whole.items() if side_of(self.sides, name).prefix}

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises RowError, with the key of the recipe, where a table does not fit the robot."""
        robot = RobotFiles(files.inputs)
        tree, shapes = robot.tree, robot.shapes
        source = robot.source_control or SourceControl()
        said = source.control
        stated = self._poses(tree, said.keyframes)
        driven = driven_joints(tree, self.rows, self.sides, said.actuators)
        loops = resolve_loops(tree, self.loops)
        loops += placed_loops(tree, said.loops, loops)
        poses = self._closed(tree, stated, loops, driven, joint_springs(said.mjcf_only))
        for before, after in zip(stated, poses, strict=True):
            yield from solved_findings(before, after)
        parts = {name: self._of_parts(tree, pose) for name, pose in self.poses.items()}
        of_source = source_keyframes(said.keyframes, tree, parts)
        kept = [key for key in of_source if key.name not in self.keyframes]
        actuators = self._resolved(tree, [*poses, *kept], loops)
        yield from row_findings(self.rows, tree, actuators)

        ground = Ground(tree, shapes, robot.mesh_dir, said.mjcf_only)
        turn = root_pose(said.mjcf_only).quat
        keyframes = []
        for before, pose in zip(stated, poses, strict=True):
            keyframe, q = self.keyframes[pose.name], dict(pose.joints)
            solved = q.keys() - {name for name, v in before.joints if v == q[name]}
            yield from _limit_findings(tree, pose.name, keyframe, q, solved)
            base, findings = placed_base(tree, pose.name, keyframe, q, ground, turn)
            yield from findings
            keyframes.append(replace(pose, base=base))

        yield from _same_body_findings(tree, self.exclude)
        check_surfaces(shapes, self.contact, self.common_surfaces)
        control = model.Control(
            actuators=actuators,
            keyframes=(*keyframes, *kept),
            excludes=_excludes(tree, shapes, self.exclude, self.sides, loops),
            contact=self.contact.common,
            sensors=placed_sensors(tree, shapes, self.imu, self.feet, self.sensors),
            cameras=placed_cameras(tree, self.cameras),
            simulation=self.simulation,
            loops=loops,
        )
        recipe = StatedControl(self.sides, self.rows, self.contact.links)
        control, findings = join(control, source, tree, shapes, recipe)
        yield from findings
        if loops and any(side.from_mjcf for side in self.sides):
            start = initial_pose(tree, control)
            yield from source_findings(tree, loops, kept, start, driven)
        control = _with_sampled(control, files.inputs / "sampled_pairs.json")
        control, below = with_reach(tree, control, ground)
        yield from below
        control = softened(tree, control, self.sides, self.limit_error, self.coupling_error)
        yield from actuator_findings(tree, control, has_table=bool(self.rows))
        yield from contact_findings(shapes, control)
        (files.outputs / "control.json").write_bytes(encode(control))


# --- keyframes ------------------------------------------------------------------------------


def _pose(tree: model.Tree, name: str, keyframe: Keyframe) -> model.Keyframe:
    """Every moving joint at what the patterns say, else 0; those that mimic others follow."""
    q = with_mimics(tree, _joint_values(tree, name, keyframe))
    return model.Keyframe(name, tuple(q.items()))


def _joint_values(tree: model.Tree, name: str, keyframe: Keyframe) -> dict[str, float]:
    """The value of each joint that a pattern matches. RowError: none, or two patterns for one."""
    free = [joint.name for joint in tree.moving_joints if joint.mimic is None]
    mimics = [joint.name for joint in tree.moving_joints if joint.mimic is not None]
    chosen: dict[str, str] = {}
    for pattern in keyframe.joints:
        key = ("keyframes", name, "joints", pattern)
        names = [joint for joint in free if re.fullmatch(pattern, joint)]
        if not names:
            if any(re.fullmatch(pattern, joint) for joint in mimics):
                message, hint = "matches only joints that mimic others", "set the joint they mimic"
            else:
                message, hint = "matches no moving joint", meant_pattern(pattern, free)
            raise RowError(f"keyframes.{name}: pattern `{pattern}` {message}", key=key, hint=hint)
        for joint in names:
            if joint in chosen:
                raise RowError(
                    f"keyframes.{name}: joint `{joint}` is matched by "
                    f"`{chosen[joint]}` and `{pattern}`",
                    key=key,
                    hint="narrow one of the two patterns",
                )
            chosen[joint] = pattern
    return {joint: keyframe.joints[pattern] for joint, pattern in chosen.items()}


def _limit_findings(
    tree: model.Tree,
    name: str,
    keyframe: Keyframe,
    q: Mapping[str, float],
    solved: Collection[str],
) -> Iterator[Finding]:
    for joint in tree.moving_joints:
        value = q[joint.name]
        is_wide = joint.kind != "prismatic" and abs(value) > 2.0 * math.pi
        if joint.range is None:
            if is_wide:  # no limit says that the number is degrees
                turns = abs(value) / (2.0 * math.pi)
                yield KEYFRAME_TURNS(
                    f"joint {joint.name}",
                    f"keyframe `{name}`: {value:g} rad are {turns:.1f} turns",
                    f"angles are in radians: {value:g} degrees would be {math.radians(value):.4g}",
                    data={"keyframe": name, "value": value},
                )
            continue
        lower, upper = joint.range
        if lower - LIMIT_TOLERANCE <= value <= upper + LIMIT_TOLERANCE:
            continue
        unit = unit_of(joint)
        if joint.mimic is not None:
            hint = f"it follows `{joint.mimic.joint}`"
        elif joint.name in solved:
            hint = "the loops ask for it: state other values of the driven joints"
        elif any(re.fullmatch(pattern, joint.name) for pattern in keyframe.joints):
            hint = "choose a value inside the limits"
            if is_wide:
                hint += f"; angles are in radians: {value:g} degrees are {math.radians(value):.4g}"
        else:
            hint = "no pattern of the keyframe matches it, so it is 0"
        yield KEYFRAME_LIMITS(
            f"joint {joint.name}",
            f"keyframe `{name}`: {value:g} {unit} is outside {lower:g}..{upper:g} {unit}",
            hint=hint,
            data={"keyframe": name, "value": value, "lower": lower, "upper": upper},
        )


# --- excludes -------------------------------------------------------------------------------


def _excludes(
    tree: model.Tree,
    shapes: Shapes,
    exclude: Exclude,
    sides: tuple[Side, ...],
    loops: tuple[model.Loop, ...],
) -> tuple[tuple[str, str], ...]:
    """Sorted pairs of bodies. Raises RowError for an unknown link."""
    pairs = {_bodies(tree, index, pair) for index, pair in enumerate(exclude.pairs)}
    joined = [(joint.parent, joint.child) for joint in tree.joints]
    # A ball joint of three hinges is one joint to the two bodies that it connects.
    chains = find_chains(tree, {shape.link for shape in shapes.shapes})
    joined += [(chain.parent, chain.body) for chain in chains]
    joined += [(loop.a.body, loop.b.body) for loop in loops]
    for a, b in joined:
        of_a, of_b = side_of(sides, a), side_of(sides, b)
        if of_b.adjacent or of_a != of_b:  # what a mount holds together
            pairs.add(_sorted(a, b))
    return tuple(sorted(pair for pair in pairs if pair[0] != pair[1]))


def _bodies(tree: model.Tree, index: int, pair: tuple[str, str]) -> tuple[str, str]:
    place, key = f"collision.exclude.pairs[{index}]", ("collision", "exclude", "pairs", index)
    a, b = (link_placement(tree, link, place, (*key, side)) for side, link in enumerate(pair))
    return _sorted(a[0], b[0])


def _with_sampled(control: model.Control, path: Path) -> model.Control:
    """The excludes and the pairs that sampling found, where it ran."""
    if not path.is_file():
        return control
    sampled = json.loads(path.read_bytes())
    pairs = {_sorted(*pair) for kind in ("always", "never") for pair in sampled[kind]}
    return replace(control, excludes=tuple(sorted({*control.excludes, *pairs})))


def _same_body_findings(tree: model.Tree, exclude: Exclude) -> Iterator[Finding]:
    for index, pair in enumerate(exclude.pairs):
        body, other = _bodies(tree, index, pair)
        if body == other:
            yield SAME_BODY(
                f"link {pair[0]}",
                f"excluding `{pair[0]}` and `{pair[1]}` changes nothing: "
                f"fixed joints merged both into `{body}`",
                data={"other": pair[1], "body": body},
            )


def _sorted(a: str, b: str) -> tuple[str, str]:
    return (a, b) if a <= b else (b, a)
