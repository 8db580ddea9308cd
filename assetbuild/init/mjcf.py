"""A recipe for an MJCF: short, since the file itself says most of what a recipe can say."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from assetbuild.control.close_loops import closed_pose, placed_loops
from assetbuild.control.ground import Ground
from assetbuild.engine.scratch import scratch
from assetbuild.errors import SourceError, Where, quoted
from assetbuild.facts.mjcf_grammar import NEWEST, OLDEST, newer_words_of
from assetbuild.init.anatomy import Anatomy, study
from assetbuild.init.collision import (
    hand_of,
    lying_inside,
    put_own_loops,
    put_own_shapes,
    put_pads,
    soles_of,
)
from assetbuild.init.draft import Draft, Proposal, patterns_of, some
from assetbuild.init.home import DEEP_M, home_pose, on_its_legs
from assetbuild.init.look import InspectedRobot, carried, judge, not_in_usd, usual_targets
from assetbuild.init.packages import above, is_file, lacking
from assetbuild.init.repairs import Repair, put_repairs, repairs
from assetbuild.init.sections import put_actuators, put_head, put_home, put_source, put_validation
from assetbuild.init.strength import bounds, with_efforts
from assetbuild.init.trial import Trial, Tuning, staged, tune
from assetbuild.robot.actuator_table import RowError
from assetbuild.robot.files import RobotFiles, SourceControl
from assetbuild.robot.loops import joints_of
from assetbuild.robot.mjcf_only import joint_springs, lost_in_usd, no_drives
from assetbuild.robot.model import Control, Joint, Keyframe, Tree
from assetbuild.source.mjcf.flatten_mjcf import FOLDER, FlattenMjcf
from assetbuild.source.mjcf.includes import ListIncludes
from assetbuild.source.mjcf.opaque import keys
from assetbuild.source.mjcf.read_mjcf import ReadMjcf
from assetbuild.source.mjcf.scenery import SeveralRobotsError
from assetbuild.source.urdf.xml import MAX_BYTES

VAGUE = {
    "",
    *keys("assets scene mjx robot model models mujoco mjcf urdf xml xmls world main"),
    *keys("flat rough terrain"),
}
"""Words that name no robot."""
ABSENT = "add the file, or remove the mesh and its geoms from the MJCF"
DRIVES = "The source drives no joint; mjlab's robots, for one, are driven from Python."


@dataclass(frozen=True)
class MjcfSource:
    """An MJCF that can be read. root: the lowest folder that holds it and its meshes.

    robot, built: with merged fixed joints, and as the recipe has it built: with all that the source
    calls a body, except what is merged into the bodies `weak`.
    bodies: of the robots in its world, where there are several; the first is read.
    newer: words that MuJoCo 3.11 does not know.
    """

    root: Path
    file: str
    robot: InspectedRobot
    built: InspectedRobot
    control: Control
    weak: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()
    newer: tuple[str, ...] = ()


def is_mjcf(data: bytes) -> bool:
    """Tell it by its root element, whatever its name; what is something else is left to others."""
    start = data[:4096]
    return b"<mujoco" in start and b"<robot" not in start


def find_mjcf(file: Path) -> MjcfSource:
    """Read the MJCF, from the lowest folder that holds all its files.

    Raises SourceError with file and line, as a build would.
    """
    real = Path(os.path.realpath(file))
    problem: SourceError | None = None
    for root in above(real):
        try:
            return _read(root, real.relative_to(root).as_posix())
        except SeveralRobotsError as several:
            return _read(root, real.relative_to(root).as_posix(), several.names)
        except SourceError as error:
            if "leads out of the source" not in error.message:
                raise
            problem = problem or error
    assert problem is not None  # noqa: S101 # every path has a folder
    raise problem


def _read(root: Path, name: str, bodies: tuple[str, ...] = ()) -> MjcfSource:
    """The build's own steps, run on the spot."""
    with scratch() as ports:
        beside = [root / name, *sorted((root / name).parent.rglob("*.xml"))]  # may be an include
        files = [path for path in beside if is_file(path) and path.stat().st_size <= MAX_BYTES]
        while files:
            for path in files:
                ports.link(f"tree/{path.relative_to(root)}", path)
            ports.run(ListIncludes(file=name))  # those that it names elsewhere
            files = [root / path for path in json.loads(ports.read("includes.json"))]
            files = [path for path in files if is_file(path)]
        body, newest = bodies[0] if bodies else None, float(NEWEST)
        ports.run(FlattenMjcf(file=name, body=body, grammar=newest))
        newer = newer_words_of(ports.read("source.xml"))
        absent = []
        for mesh in json.loads(ports.read("meshes.json")):
            path = root / mesh["path"]
            if mesh["path"].startswith(FOLDER):
                path = ports.folder / "inline" / path.name
            if path.is_file():
                ports.link(f"files/{mesh['path']}", path)
            else:
                absent.append(mesh)
        if absent:
            raise _absent(root, absent)
        ports.run(ReadMjcf())
        read = RobotFiles(ports.folder)
        stated = read.source_control or SourceControl()
        whole = InspectedRobot(read.links, read.links, read.source_shapes, root=root)
        robot, built = (judge(whole, read.links.base, kept) for kept in ((), stated.bodies))
        weak = _weak(built)
        if weak:
            mended = next(_mended(built, stated.bodies, weak), None)
            built, weak = (mended, weak) if mended else (built, ())
    called = robot_name(robot.links.name, root / name)
    robot = replace(robot, links=replace(robot.links, name=called))
    return MjcfSource(root, name, robot, built, stated.control, weak, bodies, newer)


def robot_name(stated: str, file: Path) -> str:
    """What an MJCF calls its robot; a scene that says no more is called like its file or folder."""
    for name in (stated, file.stem, file.parent.name, file.parent.parent.name):
        words = [word for word in re.split(r"[ _.-]+", name) if word.lower() != "scene"]
        if not VAGUE.issuperset(word.lower() for word in words):
            return "_".join(words) if "scene" in name.lower() else name
    return stated


def _absent(root: Path, meshes: Sequence[Mapping[str, str]]) -> SourceError:
    """The error for missing meshes: the first, how many more, and where a file of its name is."""
    first, others = meshes[0], [mesh["path"] for mesh in meshes[1:]]
    more = f" (and {len(others)} more: {quoted(others, 3)})" if others else ""
    _, meant = lacking(root, first["path"].lstrip("/"))
    return SourceError(
        f"no file `{first['path']}`{more}",
        where=Where(first["file"], int(first["line"])),
        hint=f"{meant} Correct `file` or `meshdir` in the MJCF" if meant else ABSENT,
    )


def _weak(robot: InspectedRobot) -> tuple[str, ...]:
    """Bodies that cannot be simulated alone: without mass, or with an inertia that is an error."""
    return tuple(dict.fromkeys([*carried(robot), *_wrong(robot)]))


def _wrong(robot: InspectedRobot) -> list[str]:
    subjects = [finding.subject for finding in robot.body_findings if finding.severity == "error"]
    return [text.removeprefix("link ") for text in subjects if text.startswith("link ")]


def _mended(
    built: InspectedRobot, bodies: Collection[str], weak: Collection[str]
) -> Iterator[InspectedRobot]:
    """The robot with weak bodies merged, where that leaves none and is worth it.

    First with what fixed joints hold to them, then with what they are held to, as a foot without
    inertia is to its shank, then with both.
    """
    fixed = [joint for joint in built.links.joints if joint.kind == "fixed"]
    held = set(weak)
    for joint in fixed:  # a parent before its children
        if joint.parent in held:
            held.add(joint.child)
    weak_on_others = {joint.child for joint in fixed} & set(weak)
    for merged in (held - set(weak), weak_on_others, held | weak_on_others):
        mended = judge(built, built.links.base, [name for name in bodies if name not in merged])
        if not _weak(mended) and (_wrong(built) or not not_in_usd(mended)):
            yield mended


def mjcf_recipe(source: MjcfSource, path: Path) -> Proposal:
    """The whole recipe, as it will lie at `path`."""
    robot, control = source.robot, source.control
    anatomy = replace(on_its_legs(robot.tree, study(robot)), doubt="")  # the source says its base
    # A few springs help the drives of a robot; more move it, as a soft foot, unless it walks.
    alone = [joint for joint in robot.tree.moving_joints if joint.mimic is None]
    stated = joint_springs(control.mjcf_only)
    is_sprung = 2 * len(stated) > len(alone) and not anatomy.walks_on
    idle = robot.tree.moving_joints and not (_driven(control) or is_sprung)
    tuning = _tuned(source, anatomy) if idle else None
    unmended = tuning.trial.unmended if tuning else ()
    hand = hand_of(robot, anatomy, _driven_joints(robot.tree, control, tuning))
    lost = lost_in_usd(control.mjcf_only)
    # Beside a guessed drive there is no room for a spring.
    springs = stated if tuning else no_drives(control)
    draft = Draft()
    put_head(draft, replace(robot, tree=source.built.tree), anatomy, path, unmended)
    put_source(draft, source.root, path, "mjcf", source.file)
    if source.bodies:
        why = f"or {some(source.bodies[1:])}: one recipe builds one robot"
        draft.put(source.bodies[0], "source", "body", beside=why)
    draft.note(*_taken(source, len(anatomy.legs)), at=("taken",))
    edits = repairs(source.built, usd=not (lost or springs))
    _put_solver(draft, source, anatomy, hand, edits)
    put_repairs(draft, robot, edits)
    _put_merging(draft, source)
    home = control.initial_keyframe
    pose = _pose(source, anatomy, tuning) if home is None else dict(home.joints)
    inside = lying_inside(source.root / source.file, source.built.tree, pose)
    put_own_shapes(draft, robot, inside)
    _put_drives(draft, source, tuning)
    trial, off_m = _stood(source, anatomy, pose)
    if home is None:
        commanded = replace(robot, tree=_commanded(robot.tree, control))
        put_home(draft, commanded, anatomy, pose)
    elif off_m < -DEEP_M or (off_m > DEEP_M and home.name == "home"):
        side = "inside" if off_m < 0.0 else "above"
        why = f"the source's is {1e3 * abs(off_m):.3g} mm {side} the floor; its joints stay"
        draft.put("on_ground", "keyframes", home.name, "base", beside=why)
    put_own_loops(draft, hand, control)
    surfaces = [control.contact, *(contact for _, contact in control.contacts)]
    put_pads(draft, robot, hand, control.simulation.timestep, surfaces)
    formats, why = usual_targets(source.built, springs, lost)
    draft.put(formats, "targets", beside=why)
    put_validation(draft, robot, anatomy.legs, trial, hand)
    return Proposal(path, draft.text, unmended)


def _tuned(source: MjcfSource, anatomy: Anatomy) -> Tuning:
    """Drives for a source that has none, with its own rotors and at most its own time step."""
    robot, control = source.robot, source.control
    rotors = {actuator.joint: actuator.armature for actuator in control.actuators}
    with staged(robot, soles_of(robot, anatomy), whole=False) as stage:
        return tune(stage, anatomy, rotors, control.simulation.timestep)


def _pose(source: MjcfSource, anatomy: Anatomy, tuning: Tuning | None) -> Mapping[str, float]:
    """The pose in which the drives were tried; of a source with drives, one for its limits.

    Without the joints that loops move, which a build finds; where drives of a loop would open it,
    without any of its joints: it closes as it is drawn.
    """
    tree, control = source.robot.tree, source.control
    pose = tuning.pose if tuning else home_pose(_commanded(tree, control), anatomy.legs)
    loops = placed_loops(tree, control.loops)
    if not loops:
        return pose
    chain = joints_of(tree, loops)
    driven = {row.joint for row in control.actuators if row.model != "passive"}
    stated = {name: q for name, q in pose.items() if name not in chain - driven}
    values = tuple((joint.name, stated.get(joint.name, 0.0)) for joint in tree.moving_joints)
    try:
        closed_pose(tree, loops, Keyframe("home", values), stated, {}, ())
    except RowError:
        return {name: q for name, q in stated.items() if name not in chain}
    return stated


def _commanded(tree: Tree, control: Control) -> Tree:
    """The tree with joints as narrow as the commands that their position drives take.

    Where nothing has a weight, no effort is too small to hold a pose.
    """
    if not any(control.simulation.gravity):
        tree = with_efforts(tree, dict.fromkeys(tree.by_joint))
    taken = {row.joint: row.ctrl for row in control.actuators if row.model == "pd" and row.ctrl}

    def narrowed(joint: Joint) -> Joint:
        (low, high), (lower, upper) = taken.get(joint.name, (-math.inf, math.inf)), bounds(joint)
        if max(low, lower) >= min(high, upper) or (low <= lower and upper <= high):
            return joint
        kind = "revolute" if joint.kind == "continuous" else joint.kind
        limits = replace(joint.limits, lower=max(low, lower), upper=min(high, upper))
        return replace(joint, kind=kind, limits=limits)

    return replace(tree, joints=tuple(map(narrowed, tree.joints)))


def _put_solver(
    draft: Draft,
    source: MjcfSource,
    anatomy: Anatomy,
    hand: Sequence[str],
    edits: Sequence[Repair],
) -> None:
    """Words that are refused without the key, the cone of what grips or stands, and an integrator
    for links to which an edit gives less inertia than the source.
    """
    if source.newer:
        why = f"keeps {some(list(source.newer))}, which MuJoCo {OLDEST} does not know"
        draft.put(float(NEWEST), "mjcf", "grammar", beside=why)
    stated = [item.element for item in source.control.mjcf_only if item.place == "option"]
    option = "".join(stated)  # with what the source leaves to MuJoCo's defaults
    if (hand or anatomy.walks_on) and 'cone="elliptic"' not in option:
        slips = "what a hand holds slips" if hand else "feet creep"
        draft.put("elliptic", "mjcf", "cone", beside=f"with the source's pyramidal cone, {slips}")
    lighter = any(repair.edit == "inertia_from_geometry" for repair in edits)
    if lighter and 'integrator="Euler"' in option:
        why = "with the source's Euler, drives throw off links that an edit gives less inertia"
        draft.put("implicitfast", "mjcf", "integrator", beside=why)
    if hand and 'tolerance="1e-08"' in option:
        why = "with MuJoCo's default of 1e-8, light fingers of a heavy robot let go"
        draft.put(1e-12, "mjcf", "tolerance", beside=why)


def _taken(source: MjcfSource, legs: int) -> Iterator[str]:
    """What the source says and the recipe therefore does not. legs: on which it could walk."""
    control, tree = source.control, source.robot.tree
    freed = f"   # to let it walk on its {legs} legs, write `floating`" if legs else ""
    yield "The MJCF states the following; a key in this file overrides it:"
    yield f"base: {tree.base}{freed if tree.base == 'fixed' else ''}"
    yield f"simulation: {{timestep: {control.simulation.timestep:g}}}   # s"
    yield f"collision pairs that are excluded: {len(control.excludes)}"
    if control.keyframes:
        yield f"its keyframes: {some([key.name for key in control.keyframes])}"
    if control.sensors:
        yield f"its sensors: {some([sensor.name for sensor in control.sensors])}"


def _put_merging(draft: Draft, source: MjcfSource) -> None:
    """Bodies that cannot be simulated alone become one with what fixed joints hold to them."""
    if source.weak:
        why = f"{some(source.weak)} cannot be simulated alone: no mass, or no inertia"
        kept = [joint.child for joint in source.built.tree.joints if joint.kind == "fixed"]
        names = list(source.robot.links.by_body)
        more = {"keep_bodies": patterns_of(kept, names)} if kept else {}
        draft.put({"merge": True, **more}, "fixed_joints", above=[why])


def _driven(control: Control) -> list[str]:
    """What the source drives."""
    driven = [a.name for a in control.actuators if a.model != "passive"]
    others = [i for i in control.mjcf_only if i.place == "actuator" and not i.owner]
    return driven + ["others"] * bool(others)


def _driven_joints(tree: Tree, control: Control, tuning: Tuning | None) -> Collection[str]:
    """What the source or a table of ours drives; an actuator of a tendon may drive every joint."""
    if any(item.place == "actuator" and not item.owner for item in control.mjcf_only):
        return tree.by_joint
    driven = {row.joint for row in control.actuators if row.model != "passive"}
    return driven if tuning is None else driven | tuning.driven


def _put_drives(draft: Draft, source: MjcfSource, tuning: Tuning | None) -> None:
    """The source's drives by name, or a table for a source that has none."""
    if driven := _driven(source.control):
        line = f"Drives of the source: {some(driven)}"
        draft.note(line, "An `actuators:` table here would replace them all.", at=("actuators",))
    if tuning is not None:
        draft.note(DRIVES, at=("actuators",))
        put_actuators(draft, tuning)
        if tuning.timestep < source.control.simulation.timestep:
            draft.put(tuning.timestep, "simulation", "timestep")


def _stood(
    source: MjcfSource, anatomy: Anatomy, pose: Mapping[str, float]
) -> tuple[Trial | None, float]:
    """Whether legs whose drives hold them stand on the floor in `home`, and how far above it the
    initial keyframe is, m.
    """
    robot, control, legs = source.robot, source.control, anatomy.legs
    named = {key.name for key in control.keyframes}
    driven = {a.joint for a in control.actuators if a.model in ("pd", "general")}
    has_drives = all(j.name in driven for leg in legs for j in leg.joints)
    home = control.initial_keyframe
    stands = has_drives and (not named or "home" in named)
    if not legs or not (stands or home):
        return None, 0.0
    with staged(robot, [sole for leg in legs for sole in leg.soles], whole=False) as stage:
        step = control.simulation.timestep
        trial = stage.attempt((), pose, step, driven_by=control) if stands else None
        if home is None or home.base is None or home.turns or control.loops:
            return trial, 0.0
        meshes = stage.ports.folder / "meshes"
        ground = Ground(robot.tree, stage.shapes, meshes, control.mjcf_only)
        low = ground.lowest(pose, home.base.quat)
        return trial, 0.0 if low is None else home.base.xyz[2] + low
