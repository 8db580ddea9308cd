"""The script for Isaac Lab runs against a stand-in of it, and `diff` reads what it wrote."""

from __future__ import annotations

import json
import runpy
import sys
import types
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from tiny import run_step, tiny_quadruped, write_robot_ports

from assetbuild.errors import UsageError
from assetbuild.facts.compare import Precision
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key, Table
from assetbuild.report.diff import changes
from assetbuild.report.sides import Side, foreign_side
from assetbuild.simulators.readings import FALL, FALL_S, HEIGHT, fall_m
from assetbuild.targets.isaaclab import IsaacLab

from .test_isaaclab import stubs

ROBOT = tiny_quadruped()
JOINTS = [joint.name for joint in ROBOT.tree.moving_joints]
DRIVES = {drive.joint: drive for drive in ROBOT.control.actuators}
DT = ROBOT.control.simulation.timestep


class Tensor:
    """One environment's values, as a tensor gives them out."""

    def __init__(self, values: Any) -> None:
        self.values = values

    def __getitem__(self, index: int) -> Tensor:
        assert index == 0
        return self

    def cpu(self) -> Tensor:
        return self

    def tolist(self) -> Any:
        return self.values


class Articulation:
    """Holds the robot's numbers; falls as both engines step, or stands when it starts low.

    wrong: factor on the stiffness that it holds.
    """

    wrong = 1.0

    def __init__(self, cfg: Any) -> None:
        self.z, self.speed = cfg.init_state.pos[2], 0.0
        self.falls = self.z > 1.0
        self.is_fixed_base = ROBOT.tree.base == "fixed"
        self.joint_names, self.body_names = JOINTS, [b.name for b in ROBOT.tree.bodies]
        group = types.SimpleNamespace(
            joint_names=JOINTS,
            is_implicit_model=True,
            stiffness=Tensor([self.wrong * DRIVES[j].kp for j in JOINTS]),
            damping=Tensor([DRIVES[j].kd for j in JOINTS]),
        )
        self.actuators = {"all": group}
        limits = [[j.limits.lower, j.limits.upper] for j in ROBOT.tree.moving_joints]
        masses = [b.inertial.mass_kg if b.inertial else 0.0 for b in ROBOT.tree.bodies]
        self.data = types.SimpleNamespace(
            default_mass=Tensor(masses),
            joint_pos_limits=Tensor(limits),
            joint_armature=Tensor([DRIVES[j].armature for j in JOINTS]),
            joint_effort_limits=Tensor([DRIVES[j].effort for j in JOINTS]),
            default_joint_pos=Tensor([0.0 for _ in JOINTS]),
            root_pos_w=Tensor([0.0, 0.0, self.z]),
        )

    def set_joint_position_target(self, _: object) -> None: ...

    def write_data_to_sim(self) -> None: ...

    def update(self, dt: float) -> None:
        if self.falls:
            self.speed += 9.81 * dt
            self.z -= self.speed * dt
        self.data.root_pos_w = Tensor([0.0, 0.0, self.z])


class Launcher:
    def __init__(self, _: object) -> None:
        self.app = types.SimpleNamespace(close=lambda: None)

    @staticmethod
    def add_app_launcher_args(parser: Any) -> None:
        parser.add_argument("--headless", action="store_true")


def replaced(self: Any, **fields: Any) -> Any:
    return types.SimpleNamespace(**vars(self) | fields)


@pytest.fixture
def isaaclab(monkeypatch: pytest.MonkeyPatch) -> type[Articulation]:
    modules = stubs(2) | {"isaaclab.app": types.ModuleType("isaaclab.app")}
    vars(modules["isaaclab.app"])["AppLauncher"] = Launcher
    assets, sim = vars(modules["isaaclab.assets"]), vars(modules["isaaclab.sim"])
    assets["Articulation"] = Articulation
    for cfg in (assets["ArticulationCfg"], assets["ArticulationCfg"].InitialStateCfg):
        monkeypatch.setattr(cfg, "replace", replaced, raising=False)
    sim["SimulationContext"] = lambda _: types.SimpleNamespace(
        reset=lambda: None, step=lambda: None
    )
    sim["GroundPlaneCfg"] = lambda: types.SimpleNamespace(func=lambda *_: None)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(sys, "argv", ["measure", "--headless"])
    return Articulation


def measured(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    inputs = write_robot_ports(folder / "inputs", ROBOT)
    run_step(IsaacLab(robot="robot"), inputs, folder / "out")
    python = folder / "out/isaaclab"
    monkeypatch.syspath_prepend(str(python))
    monkeypatch.delitem(sys.modules, "robot_isaaclab_2", raising=False)
    runpy.run_path(str(python / "robot_isaaclab_measure.py"), run_name="__main__")
    return python / "robot_isaaclab.json"


def ours(height: float, folder: Path) -> Side:
    facts = dict(robot_table(Reference.of_ports(folder / "inputs", {})).facts)
    facts[Key("robot", "", FALL)] = fall_m(9.81, DT)
    facts[Key("robot", "", HEIGHT)] = height
    return Side("ours", {"robot": partial(lambda table: table, Table(facts))},
                {"robot": Precision()})  # fmt: skip


def test_readings_of_the_same_robot_differ_in_nothing(isaaclab, tmp_path, monkeypatch):
    readings = foreign_side(measured(tmp_path, monkeypatch))
    assert "Isaac Lab 2" in readings.name
    facts = readings.forms["readings"]().facts
    height = facts[Key("robot", "", HEIGHT)]
    assert isinstance(height, float)
    assert changes(ours(height + 0.009, tmp_path), readings).rows == ()
    told = {quantity for _, _, quantity in facts}
    assert {"mass", "lower", "kp", "kd", "armature", "effort", FALL} <= told


def test_a_gain_in_degrees_and_a_robot_that_sinks_are_told(isaaclab, tmp_path, monkeypatch):
    monkeypatch.setattr(isaaclab, "wrong", 57.29577951308232)
    readings = foreign_side(measured(tmp_path, monkeypatch))
    height = readings.forms["readings"]().facts[Key("robot", "", HEIGHT)]
    assert isinstance(height, float)
    rows = changes(ours(height + 0.02, tmp_path), readings).rows
    found = {(c.rank, c.quantity): c.note for c in rows}
    assert "degrees" in found["CRITICAL", "kp"]
    assert ("MEDIUM", HEIGHT) in found


def test_the_fall_is_that_of_steps_not_of_the_parabola():
    steps, speed, fallen = round(FALL_S / 0.005), 0.0, 0.0
    for _ in range(steps):
        speed += 9.81 * 0.005
        fallen += speed * 0.005
    assert fall_m(9.81, 0.005) == pytest.approx(fallen, rel=1e-12)


@pytest.mark.parametrize("text", ["{}", "[1]", "no json", json.dumps({"format": "other"})])
def test_other_files_are_no_readings(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(UsageError, match="holds no readings"):
        foreign_side(tmp_path / "a.json")
