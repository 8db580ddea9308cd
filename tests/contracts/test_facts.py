"""Every quantity of the vocabulary is compared in each format, or the format says why not."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import pytest
from gripper import gripper
from robot_files import check_inputs, run_step, write_robot_ports
from tiny import TinyRobot, four_bar, pendulum, tiny_quadruped, with_control, with_mimic

from assetbuild.errors import StepError
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key
from assetbuild.facts.vocabulary import VOCABULARY, Required
from assetbuild.plugin_types import Target
from assetbuild.plugins import load_plugin
from assetbuild.robot.model import (
    Body,
    Camera,
    Contact,
    General,
    Inertial,
    Joint,
    Keyframe,
    Limits,
    LoopEnd,
    Place,
    Sensor,
)
from assetbuild.robot.pose import IDENTITY, Pose, quat_of_rpy
from assetbuild.robot.shapes import Material

from .conftest import OPTIONS, READERS

Tensor = tuple[float, float, float, float, float, float]


def with_drives(robot: TinyRobot, *models: str) -> TinyRobot:
    """Each joint has the next of these models."""
    rows = zip(robot.control.actuators, itertools.cycle(models), strict=False)
    drives = tuple(replace(row, model=model) for row, model in rows)
    return replace(robot, control=replace(robot.control, actuators=drives))


def weighing(robot: TinyRobot, inertia: Tensor) -> TinyRobot:
    """Each body has this tensor."""
    inertial = Inertial(1.0, (0.0, 0.0, 0.0), inertia)
    tree = replace(
        robot.tree, bodies=tuple(replace(b, inertial=inertial) for b in robot.tree.bodies)
    )
    return replace(robot, tree=tree, links=tree)


def called(robot: TinyRobot, name: str) -> TinyRobot:
    """One shape and one material have this name."""
    first, *others = robot.shapes.shapes
    shapes = (replace(first, name=name, material=name), *others)
    materials = (*robot.shapes.materials, Material(name, (0.1, 0.2, 0.3, 1.0)))
    return replace(robot, shapes=replace(robot.shapes, shapes=shapes, materials=materials))


def odd() -> dict[str, TinyRobot]:
    """What writers have got wrong, or might."""
    dog, arm = tiny_quadruped(), pendulum()
    (swing,) = arm.tree.joints
    tilt = Pose((0.1, -0.2, 0.3), quat_of_rpy(0.3, -0.4, 2.0))

    skew = (0.6, 0.0, -0.8)

    def on(joint: Joint, **control: object) -> TinyRobot:
        tree = replace(arm.tree, joints=(joint,))
        return with_control(replace(arm, tree=tree, links=tree), keyframes=(), **control)

    def to_base(*ends: LoopEnd) -> TinyRobot:
        """Readers take the body without a joint above it for the root, and a loop is none."""
        bars = four_bar()
        tree = replace(bars.tree, X_world_root=Pose((0.0, 0.0, 0.3)))
        (loop,) = bars.control.loops
        bars = with_control(bars, loops=(replace(loop, a=ends[0], b=ends[1]),))
        return replace(bars, tree=tree, links=tree)

    kinds = ("hip", "thigh", "calf")
    by_kind = sorted(dog.tree.joints, key=lambda joint: kinds.index(joint.name.split("_")[1]))
    home = dog.control.keyframes[0]
    light = replace(arm.tree, bodies=(Body("base"), *arm.tree.bodies[1:]))
    pair = with_mimic(dog, "FL_hip_joint", "FR_hip_joint", -2.0, 0.5)
    hung = replace(arm.tree, X_world_root=tilt)
    soles = Contact(friction=(0.5, 0.01, 0.001), condim=6)
    motors = tuple(replace(row, motor="visual") for row in dog.control.actuators)
    first, *others = dog.control.actuators
    gain = General(gainprm=(3.0,), dyntype="filter", dynprm=(0.1,))
    general = (replace(first, model="general", general=gain, name="own name"), *others)
    stalled = replace(first, model="dc_motor", stall=30.0)
    gyro = Sensor("gyro", "gyro", Place("frame", "trunk"), None, 1.0, 0.1)
    cameras = (
        Camera("eye", "trunk", tilt, 1.2),
        Camera("merged", "imu", tilt, 1.2),
        Camera("room", None, tilt),
        Camera("wide", "trunk", IDENTITY, 0.5, (1280, 720)),
        Camera("tall", "FR_calf", tilt, 2.5, (480, 640)),
        Camera("imu", "imu", tilt),
        Camera("my eye/1", "FR_calf", tilt),
    )
    at_coupler = LoopEnd("coupler", Pose((0.2, 0.0, 0.0)))
    at_base = LoopEnd("base", Pose((0.25, 0.0, 0.0)))
    return {
        "quadruped": dog,
        "pendulum": arm,
        "loop": four_bar("connect"),
        "weld": four_bar("weld"),
        "gripper": gripper(),
        "all models": with_drives(dog, "pd", "velocity", "ideal_pd", "dc_motor", "motor"),
        "slide": on(replace(swing, kind="prismatic", X_parent_joint=tilt, axis=skew)),
        "continuous": on(replace(swing, kind="continuous", limits=Limits(effort=5.0), axis=skew)),
        "planar": on(replace(swing, kind="planar", limits=Limits(), axis=skew), actuators=()),
        "locked": on(replace(swing, limits=Limits(0.5, 0.5, 5.0))),
        "crossed": on(replace(swing, limits=Limits(2.0, 1.0, 5.0))),
        "almost diagonal": weighing(arm, (0.03, 0.04, 0.05, 3e-9, -2e-9, 1e-9)),
        "flat": weighing(arm, (0.1 + 0.2, 0.1, 0.2, 0.0, 0.0, 0.0)),
        "odd names": called(dog, 'a "<&> 材质'),
        "motor named as a class": with_control(dog, actuators=motors),
        "kept body": on(replace(swing, kind="fixed", limits=Limits()), actuators=()),
        "base without mass": replace(arm, tree=light, links=light),
        "hung": with_control(replace(arm, tree=hung, links=hung), cameras=cameras[2:3]),
        "joints by kind": replace(dog, tree=replace(dog.tree, joints=tuple(by_kind))),
        "mimic chain": with_mimic(pair, "RL_hip_joint", "FL_hip_joint", 3.0, 0.1),
        "turned home": with_control(dog, keyframes=(Keyframe("lie", home.joints, tilt),)),
        "soft soles": with_control(dog, contacts=(("FR_foot_collision", soles),)),
        "more excludes": with_control(dog, excludes=(*dog.control.excludes, ("FL_hip", "FR_hip"))),
        "general drive": with_control(dog, actuators=general),
        "stalling motor": with_control(dog, actuators=(stalled, *others)),
        "gyro": with_control(dog, sensors=(gyro,)),
        "cameras": with_control(dog, cameras=cameras),
        "loop to the base": to_base(at_coupler, at_base),
        "loop from the base": to_base(at_base, at_coupler),
        "no keyframes": with_control(dog, keyframes=()),
        "home comes second": with_control(dog, keyframes=dog.control.keyframes[::-1]),
    }  # fmt: skip


ODD = odd()
AT_ONCE = {"gripper", "quadruped", "loop", "all models", "slide", "planar", "odd names",
           "kept body", "hung", "mimic chain", "turned home", "cameras", "loop to the base",
           "loop from the base", "no keyframes", "home comes second"}  # fmt: skip
"""Those that between them have everything; the others are slow, as there are many."""
CASES = [case if case in AT_ONCE else pytest.param(case, marks=pytest.mark.slow) for case in ODD]


@pytest.fixture(scope="module")
def references(tmp_path_factory: pytest.TempPathFactory) -> list[Reference]:
    """References of the odd robots; one or another of them has each fact."""
    folder = tmp_path_factory.mktemp("odd")
    return [
        Reference.of_ports(write_robot_ports(folder / case, robot), OPTIONS)
        for case, robot in ODD.items()
    ]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("name", sorted(set(READERS) - {"xrdf"}))
def test_what_a_target_writes_reads_back_equal(name: str, case: str, tmp_path: Path):
    reader = READERS[name](robot="robot")
    (written,) = reader.needs
    target = load_plugin(Target, written)(robot="robot")
    try:
        inputs = check_inputs(tmp_path, ODD[case], target, written)
    except StepError:
        return  # it cannot hold this robot, and says so
    found = run_step(reader, inputs, tmp_path / "out")
    assert [finding for finding in found if finding.severity == "error"] == []


@pytest.mark.parametrize("name", READERS)
def test_a_file_that_its_target_did_not_write_is_an_error(name: str, tmp_path: Path):
    inputs = write_robot_ports(tmp_path / "in", pendulum())
    (inputs / READERS[name].needs[0]).mkdir()
    found = run_step(READERS[name](robot="robot", options=OPTIONS), inputs, tmp_path / "out")
    assert [finding.rule for finding in found] == ["equal.unreadable"]


ONLY_OF_MESHES = frozenset(
    {"triangles", "area", "volume", "mean corner", "corner moments", "texture corners", "texture",
     "normals"}
)  # fmt: skip
"""The tiny robots here are of primitives; the readers' own tests have meshes."""


@pytest.mark.parametrize("name", READERS)
def test_a_reader_expects_a_quantity_or_says_why_its_format_lacks_it(
    name: str, references: list[Reference]
):
    kind = READERS[name]
    expected = {
        (key.kind, key.quantity)
        for reference in references
        for key in kind(robot="robot", options=dict(OPTIONS)).expected(reference).facts
    }
    held = {
        (k, q)
        for (k, q), quantity in VOCABULARY.items()
        if kind.holds(Key(k, "", q))
        and q not in ONLY_OF_MESHES
        # Where a default is a value, a file that says another differs from it.
        and (quantity.unstated is None or isinstance(quantity.unstated, Required))
    }
    assert held - expected == set(), "compared by nobody: expect it, or list it in `lacks`"


@pytest.mark.parametrize("name", READERS)
def test_what_a_format_lacks_is_a_quantity_with_a_reason(name: str):
    kinds = {kind for kind, _ in VOCABULARY}
    for lacking, reason in READERS[name].lacks.items():
        kind, _, quantity = lacking.partition(" ")
        assert (kind, quantity) in VOCABULARY or lacking in kinds, lacking
        assert reason, lacking


def test_the_robot_s_table_uses_the_vocabulary_alone(references: list[Reference]):
    for reference in references:
        for merged in (True, False):
            for key in robot_table(reference, merged=merged).facts:
                assert (key.kind, key.quantity) in VOCABULARY, key
