"""A recipe for an MJCF: short, since the file itself says most of what a recipe can say."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from assetbuild.control.close_loops import placed_loops
from assetbuild.engine.scratch import Scratch, scratch
from assetbuild.errors import SourceError, Where
from assetbuild.facts.mjcf_grammar import NEWEST, OLDEST, newer_words_of
from assetbuild.init.anatomy import Anatomy, study
from assetbuild.init.collision import mjcf_hand, option_of, own_loops, own_pads, soles_of, tried
from assetbuild.init.home import home_pose
from assetbuild.init.licence import source_section
from assetbuild.init.look import InspectedRobot, carried, judge, not_in_usd, targets
from assetbuild.init.packages import above, is_file
from assetbuild.init.repairs import repairs, repairs_text
from assetbuild.init.strength import bounds
from assetbuild.init.text import actuators, head, home, validation
from assetbuild.init.trial import Trial, staged, tables
from assetbuild.init.tune import Tuning, tune
from assetbuild.init.words import Proposal, inline, patterns_of, plain, quoted, some, written
from assetbuild.robot.files import RobotFiles, SourceControl
from assetbuild.robot.loops import path_of
from assetbuild.robot.mjcf_only import joint_springs, lost_in_usd, no_drives
from assetbuild.robot.model import Control, Joint
from assetbuild.source.mjcf.flatten_mjcf import FOLDER, FlattenMjcf
from assetbuild.source.mjcf.includes import ListIncludes
from assetbuild.source.mjcf.opaque import keys
from assetbuild.source.mjcf.read_mjcf import ReadMjcf
from assetbuild.source.mjcf.scenery import SeveralRobotsError
from assetbuild.source.urdf.xml import MAX_BYTES

INCLUDE = re.compile(rb"""<include\s[^>]*?file\s*=\s*["']([^"']+)["']""")
VAGUE = {"", *keys("assets scene mjx robot model mujoco mjcf xml xmls world main")}
"""Words that name no robot."""
DRIVES = "# The source drives no joint; mjlab's robots, for one, are driven from Python."


@dataclass(frozen=True)
class MjcfSource:
    """An MJCF that can be read. root: the lowest folder that holds it and its meshes.

    robot, built: with merged fixed joints, and as the recipe has it built: with all that the source
    calls a body, except what is merged into the bodies `weak`.
    bodies: of the robots in its world, where there are several; the first is read.
    newer: words that MuJoCo 3.11 does not know.
    posed: pose of the keyframe in a scene beside it, where it has none itself, within the joints'
    limits; bounded: which it is not there; scene: its name.
    """

    root: Path
    file: str
    robot: InspectedRobot
    built: InspectedRobot
    control: Control
    weak: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()
    newer: tuple[str, ...] = ()
    posed: Mapping[str, float] = field(default_factory=dict)
    bounded: bool = False
    scene: str = ""


def _within(joint: Joint, value: float) -> float:
    lower, upper = bounds(joint)
    return min(max(value, lower), upper)


def is_mjcf(file: Path, data: bytes) -> bool:
    """By its root element; an XML that is something else is left to others."""
    start = data[:4096].lstrip()
    return file.suffix.lower() == ".xml" and b"<mujoco" in start and b"<robot" not in start


def find_mjcf(file: Path) -> MjcfSource:
    """Read the MJCF, from the lowest folder that holds all its files.

    Raises SourceError with file and line, as a build would.
    """
    real = Path(os.path.realpath(file))
    problem: SourceError | None = None
    for root in above(real):
        try:
            return _posed(_read(root, real.relative_to(root).as_posix()), real)
        except SeveralRobotsError as several:
            return _read(root, real.relative_to(root).as_posix(), several.names)
        except SourceError as error:
            if "leads out of the source" not in error.message:
                raise
            problem = problem or error
    assert problem is not None  # noqa: S101 # every path has a folder
    raise problem


def _posed(found: MjcfSource, file: Path) -> MjcfSource:
    """Return the source; without a keyframe, with that of a neighbouring scene that includes it."""
    if found.control.keyframes:
        return found
    for scene in sorted(set(file.parent.glob("*.xml")) - {file}):
        text = scene.read_bytes() if scene.stat().st_size <= MAX_BYTES else b""
        included = {
            name.decode(errors="replace").removeprefix("./") for name in INCLUDE.findall(text)
        }
        if b"<key" not in text or file.name not in included:
            continue
        try:
            there = _read(found.root, scene.relative_to(found.root).as_posix()).control
        except SourceError:
            continue
        pose = dict(key.joints) if (key := there.initial_keyframe) else {}
        joints = found.robot.tree.by_joint
        if pose and pose.keys() <= joints.keys():
            within = {name: _within(joints[name], q) for name, q in pose.items()}
            return replace(found, posed=within, scene=scene.name, bounded=within != pose)
    return found


def _read(root: Path, name: str, bodies: tuple[str, ...] = ()) -> MjcfSource:
    """The build's own steps, run on the spot."""
    with scratch() as ports:
        for path in sorted((root / name).parent.rglob("*.xml")):
            if is_file(path) and path.stat().st_size <= MAX_BYTES:  # what else may be an include
                ports.link(f"tree/{path.relative_to(root)}", path)
        while _included(ports, root, name):
            pass
        body, newest = bodies[0] if bodies else None, float(NEWEST)
        ports.run(FlattenMjcf(file=name, body=body, grammar=newest))
        newer = newer_words_of(ports.read("source.xml"))
        for mesh in json.loads(ports.read("meshes.json")):
            path = root / mesh["path"]
            if mesh["path"].startswith(FOLDER):
                path = ports.folder / "inline" / path.name
            if not path.is_file():
                where = Where(str(mesh["file"]), int(mesh["line"]))
                raise SourceError(f"no file `{mesh['path']}`", where=where)
            ports.link(f"files/{mesh['path']}", path)
        ports.run(ReadMjcf())
        read = RobotFiles(ports.folder)
        said = read.source_control or SourceControl()
        whole = InspectedRobot(read.links, read.links, read.source_shapes, root=root)
        robot, built = (judge(whole, read.links.base, kept) for kept in ((), said.bodies))
        weak = _weak(built)
        if weak:
            mended = next(_mended(built, said.bodies, weak), None)
            built, weak = (mended, weak) if mended else (built, ())
    called = robot_name(robot.links.name, root / name)
    robot = replace(robot, links=replace(robot.links, name=called))
    return MjcfSource(root, name, robot, built, said.control, weak, bodies, newer)


def robot_name(stated: str, file: Path) -> str:
    """What an MJCF calls its robot; of a scene, by what else names it.

    First without the word `scene`, then as the files that it includes and that have bodies, as
    itself, as its folder.
    """
    try:
        beside = [file.parent / name.decode() for name in INCLUDE.findall(file.read_bytes())]
        holders = [path.stem for path in beside if is_file(path) and b"<body" in path.read_bytes()]
    except (OSError, ValueError):
        holders = []
    for name in (stated, *holders, file.stem, file.parent.name, file.parent.parent.name):
        words = [word for word in re.split(r"[ _.-]+", name) if word.lower() != "scene"]
        if not VAGUE.issuperset(word.lower() for word in words):
            return "_".join(words) if "scene" in name.lower() else name
    return stated


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
    inertia is to its shank.
    """
    fixed = [joint for joint in built.links.joints if joint.kind == "fixed"]
    held = set(weak)
    for joint in fixed:  # a parent before its children
        if joint.parent in held:
            held.add(joint.child)
    without_held = [name for name in bodies if name not in held or name in weak]
    weak_on_others = {joint.child for joint in fixed} & set(weak)
    without_weak = [name for name in bodies if name not in weak_on_others]
    for kept in (without_held, without_weak):
        mended = judge(built, built.links.base, kept)
        if not _weak(mended) and (_wrong(built) or not not_in_usd(mended)):
            yield mended


def _included(ports: Scratch, root: Path, name: str) -> bool:
    """Link the files that the MJCF names elsewhere below the root; whether there were any."""
    ports.run(ListIncludes(file=name))
    paths = [path for path in json.loads(ports.read("includes.json")) if is_file(root / path)]
    for path in paths:
        ports.link(f"tree/{path}", root / path)
    return bool(paths)


def mjcf_recipe(found: MjcfSource, path: Path) -> Proposal:
    """The whole recipe, as it will lie at `path`."""
    robot, control = found.robot, found.control
    anatomy = replace(study(robot), doubt="")  # the source says its base
    idle = not _driven(control) and robot.tree.moving_joints
    tuning = _tuned(found, anatomy) if idle else None
    unmended = tuning.unmended if tuning else ()
    hand = mjcf_hand(robot, anatomy, control, tuning)
    lost = lost_in_usd(control.mjcf_only)
    # Beside a guessed drive there is no room for a spring.
    springs = joint_springs(control.mjcf_only) if tuning else no_drives(control)
    text = written(
        head(robot, anatomy, path, unmended),
        source_section(found.root, path, "mjcf", found.file, *_chosen(found.bodies)),
        _taken(found),
        _solver(found, anatomy, hand),
        repairs_text(robot, repairs(robot, usd=not (lost or springs))),
        _merging(found),
        _collision(robot),
        _drives(found, tuning),
        () if control.keyframes else _home(found, anatomy, tuning),
        own_loops(hand, control),
        own_pads(robot, hand, control),
        [targets(found.built, springs, lost), *tried(_validate(found, anatomy), hand)],
    )
    return Proposal(path, text, unmended)


def _tuned(found: MjcfSource, anatomy: Anatomy) -> Tuning:
    """Drives for a source that has none, with its own rotors and at most its own time step."""
    robot, control = found.robot, found.control
    rotors = {actuator.joint: actuator.armature for actuator in control.actuators}
    with staged(robot, soles_of(robot, anatomy), whole=False) as stage:

        def attempt(tuning: Tuning) -> Trial:
            step = {"timestep": tuning.timestep}
            return stage.attempt(tables(robot.tree, tuning.drives, tuning.pose, step))

        return tune(robot.tree, anatomy, attempt, rotors, control.simulation.timestep)[0]


def _home(found: MjcfSource, anatomy: Anatomy, tuning: Tuning | None) -> Iterator[str]:
    pose = _pose(found, anatomy, tuning)
    if not found.scene:
        return home(found.robot, anatomy, pose)
    why = f"as the keyframe of {plain(found.scene)} beside it"
    if found.bounded:
        why += ", within the limits"
    return home(found.robot, anatomy, pose, why=why)


def _pose(found: MjcfSource, anatomy: Anatomy, tuning: Tuning | None) -> Mapping[str, float]:
    """The pose in which the drives were tried; of a source with drives, one for its limits.

    Without the joints that loops move, which a build finds.
    """
    pose = tuning.pose if tuning else home_pose(found.robot.tree, anatomy.legs)
    pose = {**pose, **found.posed}
    tree, control = found.robot.tree, found.control
    chain = {j.name for p in placed_loops(tree, control.loops) for j in path_of(tree, p)}
    driven = {row.joint for row in control.actuators if row.model != "passive"}
    return {name: q for name, q in pose.items() if name not in chain - driven}


def _chosen(bodies: tuple[str, ...]) -> Iterator[str]:
    """The first of several robots; the recipe of another differs by this line."""
    if bodies:
        yield f"  body: {quoted(bodies[0])}   # or {some(bodies[1:])}: one recipe builds one robot"


def _solver(found: MjcfSource, anatomy: Anatomy, hand: Sequence[str]) -> Iterator[str]:
    """Words that are refused without the key, and the cone of what grips or stands."""
    said = {}
    if found.newer:
        words = some(list(found.newer))
        said[f"grammar: {NEWEST}"] = f"keeps {words}, which MuJoCo {OLDEST} does not know"
    option = option_of(found.control)
    if (hand or anatomy.walks_on) and 'cone="elliptic"' not in option:
        slips = "what a hand holds slips" if hand else "feet creep"
        said["cone: elliptic"] = f"with the source's pyramidal cone {slips}"
    if hand and 'tolerance="1e-08"' in option:
        said["tolerance: 1.0e-12"] = "with MuJoCo's 1e-8 light fingers of a heavy robot let go"
    if said:
        yield f"mjcf: {{{', '.join(said)}}}   # {'; '.join(said.values())}"


def _taken(found: MjcfSource) -> Iterator[str]:
    """What the source says and the recipe therefore does not."""
    control, tree = found.control, found.robot.tree
    step = control.simulation.timestep
    yield "# What the MJCF says and this file does not repeat; a key here would win:"
    yield f"# base: {tree.base}"
    yield f"# simulation: {{timestep: {step:g}}}   # s"
    yield f"# collision pairs that are excluded: {len(control.excludes)}"
    if control.keyframes:
        yield f"# its keyframes: {some([key.name for key in control.keyframes])}"
    if control.sensors:
        yield f"# its sensors: {some([sensor.name for sensor in control.sensors])}"


def _merging(found: MjcfSource) -> Iterator[str]:
    """Bodies that cannot be simulated alone become one with what fixed joints hold to them."""
    if not found.weak:
        return
    tree = found.built.tree
    kept = [joint.child for joint in tree.joints if joint.kind == "fixed"]
    patterns = patterns_of(kept, list(found.robot.links.by_body))
    more = f", keep_bodies: {inline(patterns)}" if kept else ""
    yield f"# {some(found.weak)} cannot be simulated alone: no mass, or no inertia"
    yield f"fixed_joints: {{merge: true{more}}}"


def _collision(robot: InspectedRobot) -> Iterator[str]:
    count = len(robot.shapes.of("collision"))
    yield "collision:"
    if count:
        yield f"  default: {{method: keep, from: collision}}   # its {count} shapes as they are"
    else:
        yield "  default: {method: auto, from: visual}   # the source has no collision shapes"


def _driven(control: Control) -> list[str]:
    """What the source drives."""
    driven = [a.name for a in control.actuators if a.model != "passive"]
    others = [i for i in control.mjcf_only if i.place == "actuator" and not i.owner]
    return driven + ["others"] * bool(others)


def _drives(found: MjcfSource, tuning: Tuning | None) -> Iterator[str]:
    """The source's drives by name, or a table for a source that has none."""
    if driven := _driven(found.control):
        yield f"# Drives of the source: {some(driven)}"
        yield "# An `actuators:` table here would replace them all."
    if tuning is not None:
        yield DRIVES
        yield from actuators(tuning)
        if tuning.timestep < found.control.simulation.timestep:
            yield f"simulation: {{timestep: {tuning.timestep!r}}}"


def _validate(found: MjcfSource, anatomy: Anatomy) -> Iterator[str]:
    """Legs with drives are tried; keyframes of the source are its own affair."""
    robot, control, legs = found.robot, found.control, anatomy.legs
    named = {key.name for key in control.keyframes}
    driven = {a.joint for a in control.actuators if a.model in ("pd", "general")}
    if not legs or not all(j.name in driven for leg in legs for j in leg.joints):
        return
    if named and "home" not in named:
        return
    soles = [sole for leg in legs for sole in leg.soles]
    step = {"timestep": control.simulation.timestep}
    home = control.initial_keyframe
    pose = dict(home.joints) if home else found.posed or home_pose(robot.tree, legs)
    with staged(robot, soles, whole=False) as stage:
        trial = stage.attempt(tables(robot.tree, (), pose, step), control)
    yield from validation(robot, legs, trial)
