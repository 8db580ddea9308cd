"""Small experiments: a sound robot passes them all, and each has a robot on which it speaks."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from robot_files import configured, figures, mjcf_inputs, rules, run_step, write_robot_ports
from tiny import TinyRobot, tiny_quadruped, with_base, with_control, with_drives

from assetbuild.checks.trials import Trials
from assetbuild.findings import Finding
from assetbuild.robot.model import Simulation
from assetbuild.robot.shapes import Box, Shapes
from assetbuild.simulators.mujoco.trials import energy_drift, support

QUADRUPED = tiny_quadruped()


def tried(robot: TinyRobot, folder: Path, **fields: object) -> list[Finding]:
    return run_step(Trials(poses=50, **fields), mjcf_inputs(folder, robot), folder / "out")


def drives(timestep: float = 0.005, **values: object) -> TinyRobot:
    """timestep: s."""
    robot = with_drives(QUADRUPED, **values)
    return with_control(robot, simulation=Simulation(timestep=timestep))


def wide_trunk() -> TinyRobot:
    """A trunk that reaches down to the calves, with nothing excluded."""
    shapes = tuple(
        replace(s, geometry=Box((0.6, 0.6, 0.5))) if s.name == "trunk_collision" else s
        for s in QUADRUPED.shapes.shapes
    )
    robot = replace(QUADRUPED, shapes=replace(QUADRUPED.shapes, shapes=shapes))
    return with_control(robot, excludes=())


def test_a_sound_robot_passes_with_figures_for_every_joint(tmp_path: Path):
    assert tried(QUADRUPED, tmp_path) == []
    measured = figures(tmp_path / "out")
    assert len(measured["drives"]) == len(QUADRUPED.control.actuators)
    assert measured["support_margin_m"] > 0.0
    assert measured["settle"]["finite"]


def test_a_gain_in_degrees_is_a_dead_drive(tmp_path: Path):
    found = tried(drives(kp=100.0 * math.pi / 180 / 5, kd=4.0), tmp_path)
    assert {f.subject for f in found if f.rule == "trials.dead"} == {
        f"actuator {a.joint}" for a in QUADRUPED.control.actuators
    }


@pytest.mark.parametrize(("inherited", "severity"), [(False, "error"), (True, "warning")])
def test_a_drive_that_is_as_weak_in_its_own_mjcf_is_a_warning(
    inherited: bool, severity: str, tmp_path: Path
):
    found = tried(drives(effort=1e-3, friction=0.05), tmp_path, inherited=inherited, alone=False)
    assert {f.severity for f in found if f.rule == "trials.dead"} == {severity}
    assert "trials.fall" not in rules(found), "the check `stand` says so"


@pytest.mark.parametrize(
    ("words", "inherited", "alone"),
    [({}, True, True), ({"validate": {"stand": {}}}, True, False),
     ({"actuators": [{"joints": ".*", "model": "pd", "kp": 1, "kd": 1}]}, False, True)],
)  # fmt: skip
def test_the_recipe_says_whose_the_drives_are_and_who_sees_it_fall(
    words: dict, inherited: bool, alone: bool
):
    step = configured(Trials, source={"path": ".", "mjcf": "robot.xml"}, **words)
    assert isinstance(step, Trials)
    assert (step.inherited, step.alone) == (inherited, alone)


def test_a_coarse_timestep_is_told(tmp_path: Path):
    found = tried(drives(timestep=0.1), tmp_path, energy=1e-4)
    messages = {finding.rule: finding.message for finding in found}
    assert messages["trials.energy"].endswith("(limit 0.01%)")
    assert messages["trials.timestep"].endswith("rad (limit 0.02)")


def test_a_centre_of_mass_beyond_the_feet_is_told(tmp_path: Path):
    trunk, *others = QUADRUPED.tree.bodies
    ahead = replace(trunk, inertial=replace(trunk.inertial, com_m=(0.9, 0.0, 0.0)))
    robot = replace(QUADRUPED, tree=replace(QUADRUPED.tree, bodies=(ahead, *others)))
    (balance,) = [f for f in tried(robot, tmp_path) if f.rule == "trials.balance"]
    assert balance.data["margin_m"] < 0.0
    told = tried(QUADRUPED, tmp_path / "wish", support=0.5, penetration=1e-9, drift=1e-12)
    assert rules(told) == {"trials.balance", "trials.sunk", "trials.drift"}


def test_a_file_with_hundreds_of_joints_is_not_simulated():
    rows = "".join(f'<body pos="{i} 0 0"><joint/><geom size="0.1"/></body>' for i in range(301))
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{rows}</worldbody></mujoco>")
    assert rules(list(Trials().examine(model, {}))) == {"trials.large"}


def test_drives_that_outrun_the_timestep_do_not_rest(tmp_path: Path):
    """Damping of 5 N m s/rad on legs of some grams, without rotors: at 5 ms the robot hops on."""
    light = {"kp": 100.0, "kd": 5.0, "armature": 0.0, "friction": 0.0, "effort": 60.0}
    coarse = tried(drives(0.005, **light), tmp_path / "coarse")
    (told,) = [f for f in coarse if f.rule == "trials.rest"]
    assert "`simulation.timestep`" in told.hint
    assert tried(drives(0.00125, **light), tmp_path / "fine") == []


@pytest.mark.parametrize(("timestep", "explodes"), [(0.005, True), (0.0005, False)])
def test_an_untrained_policy_must_not_drive_it_to_infinity(
    timestep: float, explodes: bool, tmp_path: Path
):
    """Stiff servos on legs without rotors: 5 ms is too long, 0.5 ms is not."""
    loose = {"armature": 0.0, "friction": 0.0, "damping": 0.0}
    found = tried(drives(timestep, kp=1000.0, kd=2.0, effort=1000.0, **loose), tmp_path)
    assert ("trials.random_targets_diverge" in rules(found)) is explodes
    assert (figures(tmp_path / "out")["shake"]["seconds"] is not None) is explodes


def test_a_simulation_that_explodes_is_an_error(tmp_path: Path):
    found = tried(drives(0.05, kp=1e12, kd=0.0, effort=None), tmp_path)
    assert "trials.unstable" in rules(found)


def test_an_mjcf_that_does_not_load_is_an_error(tmp_path: Path):
    inputs = write_robot_ports(tmp_path / "in", QUADRUPED)
    (inputs / "mjcf").mkdir()
    (inputs / "mjcf/scene.xml").write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    assert rules(run_step(Trials(), inputs, tmp_path / "out")) == {"trials.load"}


@pytest.mark.parametrize(
    ("foot", "width", "is_area"),
    [
        ('type="box" size="0.1 0.04 0.02"', 0.2, True),  # along x; along y 2 * 0.12 + 2 * 0.04
        ('type="box" size="0.2 0.04 0.02"', 0.32, True),
        ('type="box" size="0.03 0.04 0.02"', 0.06, True),  # 0.0375 rad
        ('type="box" size="0.02 0.04 0.02"', 0.04, False),  # 0.025 rad
        ('type="box" size="0.002 0.04 0.02"', 0.004, False),
        ('type="sphere" size="0.02"', 0.0, False),
    ],
)
def test_what_stands_on_points_may_not_lean(foot: str, width: float, is_area: bool):
    """Half of the narrowest width of the feet over a height of 0.8 m, feet without mass."""
    feet = "".join(f'<geom {foot} pos="0 {y} 0.02" mass="0"/>' for y in (-0.12, 0.12))
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/><body><freejoint/>'
        f'<inertial mass="9" pos="0 0 0.8" diaginertia="1 1 1"/>{feet}</body></worldbody></mujoco>'
    )
    found = support(model)
    assert (found.margin_m or 0.0) == pytest.approx(width / 2, abs=1e-6)
    assert found.lean_rad == pytest.approx(math.atan2(width / 2, 0.8), abs=1e-6)
    assert found.is_area is is_area


def test_bodies_inside_one_another_are_told_with_the_exclude_to_write(tmp_path: Path):
    """Always, or at home, where PhysX starts, and blew up Mini Cheetah."""
    found = [f for f in tried(wide_trunk(), tmp_path) if f.rule == "trials.overlap"]
    at_home = [f for f in found if "depth_m" in f.data]
    assert at_home
    assert all("collision.exclude.pairs" in f.hint for f in found)
    for finding in at_home:
        depth = float(str(finding.data["depth_m"]))
        assert depth >= 1e-3 and "where it starts" in finding.message
        assert finding.unready == (depth > 0.005)


@pytest.mark.parametrize(
    ("height", "depth", "unready"),
    [(0.0, None, False), (0.03, None, False), (-0.003, 0.003, False), (-0.02, 0.02, True)],
)
def test_a_robot_that_starts_in_the_floor_is_not_ready(
    height: float, depth: float | None, unready: bool, tmp_path: Path
):
    """Its feet are spheres: they lie as deep as the base is low."""
    found = [f for f in tried(with_base(QUADRUPED, height), tmp_path) if f.rule == "trials.floor"]
    assert {f.unready for f in found} == ({unready} if depth else set())
    for finding in found:
        assert finding.data["depth_m"] == pytest.approx(depth, abs=2e-4)
        assert finding.hint == "turn or raise the keyframe `home`"


def test_a_floating_robot_without_collision_is_not_ready(tmp_path: Path):
    bare = replace(QUADRUPED, shapes=Shapes(QUADRUPED.shapes.of("visual")))
    (found,) = [f for f in tried(bare, tmp_path) if f.rule == "trials.nothing_touches"]
    assert found.unready
    fixed = replace(bare, tree=replace(bare.tree, base="fixed"))
    assert "trials.nothing_touches" not in rules(tried(fixed, tmp_path / "fixed"))


@pytest.mark.parametrize("values", [{"model": "passive"}, {"kp": 1.0, "kd": 0.1}])
def test_a_robot_that_falls_untouched_is_told_with_its_heights(tmp_path: Path, values: dict):
    (fall,) = [f for f in tried(drives(**values), tmp_path) if f.rule == "trials.fall"]
    assert fall.severity == "warning"
    untouched = figures(tmp_path / "out")["untouched"]

    assert untouched["outcome"] == "falls"
    assert untouched["height_after_m"] < 0.5 * untouched["height_before_m"]
    assert f"base height {untouched['height_before_m']:.3g} m at the start" in fall.message


def test_torque_drives_leave_a_standing_robot_to_its_controller(tmp_path: Path):
    found = tried(drives(model="motor", kp=0.0, kd=0.0), tmp_path)
    (fall,) = [f for f in found if f.rule == "trials.fall"]
    assert "falls within 2 s, as no drive holds a position: base height" in fall.message
    assert "controller" in fall.hint


# --- more contacts than MuJoCo's memory holds -------------------------------------------------


@pytest.mark.parametrize(("memory", "fits"), [('<size memory="100K"/>', False), ("", True)])
def test_contacts_that_fill_the_memory_of_mujoco_are_a_finding(memory: str, fits: bool):
    """Six boxes in one place."""
    boxes = 6 * ('<body pos="0 0 .45"><freejoint/><geom type="box" size=".05 .05 .05"/></body>')
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco>{memory}<worldbody>{boxes}</worldbody><keyframe><key name="home"/></keyframe>'
        "</mujoco>"
    )
    measured: dict[str, object] = {}
    assert ("trials.memory" in rules(list(Trials(poses=2).examine(model, measured)))) is not fits
    assert ("in_floor" in measured) is fits


MEDIUM = """<mujoco><option density="1000" viscosity="1"/><worldbody><body><freejoint/>
<geom size=".1"/><site name="a" pos=".1 0 0"/><body pos=".2 0 0"><joint axis="0 1 0"/>
<site name="b"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".02"/></body></body></worldbody><tendon>
<spatial stiffness="300" damping="2" frictionloss="1"><site site="a"/><site site="b"/></spatial>
</tendon></mujoco>"""


def test_springs_of_tendons_and_a_medium_are_no_loss_of_energy():
    assert energy_drift(mujoco.MjModel.from_xml_string(MEDIUM)) < 1e-2


@pytest.mark.parametrize(("height", "depth"), [(0.27, None), (0.2, 0.05)])
def test_a_plane_that_a_robot_brings_from_its_world_is_a_floor(height: float, depth: float | None):
    """The leg of a hopper that slides along the world reaches 0.25 m below its body."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody><body name="world_body">
    <geom type="plane" size="1 1 1"/><body name="leg" pos="0 0 {height}">
    <joint type="slide" axis="0 0 1"/><geom type="capsule" size=".05 .2"/></body></body></worldbody>
    <keyframe><key name="home" qpos="0"/></keyframe></mujoco>""")
    measured: dict[str, object] = {}
    found = list(Trials(poses=2).examine(model, measured))
    deep = [f.data["depth_m"] for f in found if f.rule == "trials.floor"]
    assert deep == ([pytest.approx(depth)] if depth else [])
    assert "trials.overlap" not in rules(found)
    assert measured["untouched"]
