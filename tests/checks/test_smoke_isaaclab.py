"""Isaac Lab's readings of a bundle match the robot; those of another robot are reported.

The slow ones ask the real Isaac Lab 3, on Newton and on PhysX.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pxr import Usd
from robot_files import about, configured, laid_out, run_step, spoil_stage
from tiny import TinyRobot, pendulum, sprung, tiny_quadruped, with_control

from assetbuild.checks.smoke_isaaclab import SmokeIsaacLab, evaluate, summed_up
from assetbuild.engine.world import World
from assetbuild.facts.reference import Assets, Reference, robot_table
from assetbuild.findings import Finding
from assetbuild.robot.model import Actuator
from assetbuild.robot.shapes import Shapes
from assetbuild.simulators.consumers import SmokeBounds
from assetbuild.simulators.readings import FALL, FORMAT, HEIGHT, fall_m
from assetbuild.targets.isaaclab import IsaacLab
from assetbuild.targets.usd import Usd as UsdTarget

READ = {
    "body": {"mass", "centre of mass", "inertia"},
    "joint": {"lower", "upper", "armature", "friction", "damping", "kp", "kd", "effort"},
    "robot": {"base"},
    "simulation": {"timestep", "gravity"},
}
DEGREES = 57.29577951308232
Spoil = Callable[[dict[tuple[str, str, str], Any]], object]


def readings(robot: TinyRobot, spoil: Spoil = lambda facts: None) -> dict[str, Any]:
    """Return what the script writes for a robot that stands and falls as it should."""
    whole = Reference(robot.tree, robot.tree, Shapes(), robot.control, Assets(), {})
    facts: dict[tuple[str, str, str], Any] = {
        (key.kind, key.name, key.quantity): value
        for key, value in robot_table(whole).facts.items()
        if key.quantity in READ.get(key.kind, ()) and value is not None
    }
    if robot.tree.base == "floating":
        facts["robot", "", FALL] = fall_m(9.81, robot.control.simulation.timestep)
        facts["robot", "", HEIGHT] = 0.28
    spoil(facts)
    # As JSON gives them back.
    rows = [[*key, list(v) if isinstance(v, tuple) else v] for key, v in facts.items()]
    return {"format": FORMAT, "simulator": "Isaac Lab 3", "start_m": 0.3, "facts": rows}


def found(robot: TinyRobot, spoil: Spoil = lambda facts: None) -> list[Finding]:
    answer, bounds = readings(robot, spoil), SmokeBounds.model_validate({})
    return list(evaluate(answer, robot.tree, robot.control, bounds, "newton"))


HINGE = pendulum().tree.moving_joints[0].name


def test_the_robot_itself_is_no_finding() -> None:
    """The stiffness of a joint without a drive is that of its spring."""
    assert found(tiny_quadruped()) == found(pendulum()) == []
    assert found(sprung(), lambda facts: facts.update({("joint", HINGE, "kp"): 6.0})) == []
    (told,) = found(sprung(), lambda facts: facts.update({("joint", HINGE, "kp"): 5.0}))
    assert told.rule == "equal.isaaclab_newton.kp"


def test_the_summary_tells_readings_from_motion() -> None:
    wrong = found(tiny_quadruped(), times(("joint", KNEE, "kp"), DEGREES))
    sinks = found(tiny_quadruped(), times(("robot", "", HEIGHT), 0.5))
    answer = readings(tiny_quadruped())
    assert summed_up(answer, wrong)[1] == "1 difference"
    assert summed_up(answer, sinks)[1] == "0 differences and `smoke.height`"


def times(key: tuple[str, str, str], factor: float) -> Spoil:
    return lambda facts: facts.update({key: facts[key] * factor})


def without(kind: str, name: str) -> Spoil:
    def spoil(facts: dict[tuple[str, str, str], Any]) -> None:
        for key in [key for key in facts if key[:2] == (kind, name)]:
            del facts[key]

    return spoil


KNEE = "FR_calf_joint"
KP, HIGH, FELL = ("joint", KNEE, "kp"), ("robot", "", HEIGHT), ("robot", "", FALL)
NAN = float("nan")
EQUAL = "equal.isaaclab_newton"
SPOILT: dict[str, tuple[Spoil, tuple[str, str]]] = {
    "gain in degrees": (times(KP, DEGREES), (f"{EQUAL}.kp", f"joint {KNEE}")),
    "no gain": (lambda facts: facts.pop(KP), (f"{EQUAL}.kp", f"joint {KNEE}")),
    "no joint": (without("joint", KNEE), (f"{EQUAL}.missing", f"joint {KNEE}")),
    "one body more": (
        lambda facts: facts.update({("body", "ghost", "mass"): 1.0}),
        (f"{EQUAL}.extra", "body ghost"),
    ),
    "weaker gravity": (times(FELL, 0.9), ("smoke.fall", "robot")),
    "knees that give": (times(HIGH, 0.5), ("smoke.height", "robot")),
    "thrown out of the world": (times(HIGH, NAN), ("smoke.finite", "robot")),
    "no number": (times(("body", "FR_calf", "mass"), NAN), (f"{EQUAL}.mass", "body FR_calf")),
}


@pytest.mark.parametrize("what", SPOILT)
def test_another_robot_is_told(what: str) -> None:
    spoil, told = SPOILT[what]
    assert [(f.rule, f.subject) for f in found(tiny_quadruped(), spoil)] == [told]


def test_isaac_lab_is_asked_only_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    step = configured(SmokeIsaacLab, validate={"smoke": ["isaaclab"]})
    assert isinstance(step, SmokeIsaacLab)
    monkeypatch.setenv("ASSETBUILD_ISAACLAB", str(tmp_path / "nothing"))
    missing = step.missing(World())
    assert "`assetbuild smoke RECIPE --consumer isaaclab`" in missing
    assert "ASSETBUILD_ISAACLAB" in missing
    (tmp_path / "nothing").touch()
    assert step.missing(World()) == ""


MODELS = ("pd", "ideal_pd", "dc_motor", "velocity", "motor")


def every_drive() -> TinyRobot:
    """One hip of each model; the others are PD."""
    robot = tiny_quadruped()
    hips = [row.joint for row in robot.control.actuators if "hip" in row.joint]
    models = dict(zip(hips, MODELS[1:], strict=True))

    def driven(row: Actuator) -> Actuator:
        model = models.get(row.joint, "pd")
        kp = 0.0 if model in ("velocity", "motor") else row.kp
        kd = 0.0 if model == "motor" else row.kd
        stall = 2.0 * (row.effort or 1.0) if model == "dc_motor" else None
        return replace(row, model=model, kp=kp, kd=kd, stall=stall)

    return with_control(robot, actuators=tuple(map(driven, robot.control.actuators)))


def asked(folder: Path, spoil: Callable[[Usd.Stage], object]) -> set[tuple[str, str]]:
    targets = (UsdTarget(robot="robot"), "usd"), (IsaacLab(robot="robot"), "isaaclab")
    inputs = laid_out(folder / "inputs", every_drive(), *targets)
    spoil_stage(inputs / "usd/robot.usda", spoil)
    step = SmokeIsaacLab(robot="robot", environment="isaaclab")
    return about(run_step(step, inputs, folder / "out"))


@pytest.mark.slow
@pytest.mark.skipif(
    SmokeIsaacLab.home.python(World()) is None,
    reason="needs `assetbuild smoke RECIPE --consumer isaaclab` once, with Python 3.12 at hand",
)
def test_isaac_lab_holds_drives_of_every_model_and_tells_a_heavier_calf(tmp_path: Path) -> None:
    def spoil(stage: Usd.Stage) -> None:
        mass = stage.GetAttributeAtPath("/robot/FR_calf.physics:mass")
        mass.Set(mass.Get() * 1.5)

    assert asked(tmp_path / "same", lambda stage: None) == set()
    assert {
        ("equal.isaaclab_newton.mass", "body FR_calf"),
        ("equal.isaaclab_physx.mass", "body FR_calf"),
    } <= asked(tmp_path / "heavy", spoil)
