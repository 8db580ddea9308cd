"""What a robot is and what its joints are part of: by axis, shape and ground, not by names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
import urdfs
from proposals import proposed

from assetbuild.init.anatomy import Anatomy, roles, study
from assetbuild.init.look import look
from assetbuild.init.source import find_source

SIDES = ("fl", "hl", "fr", "hr")
PLACES = ("0.12 0.12", "-0.12 0.12", "0.12 -0.12", "-0.12 -0.12")
ENDLESS = '<limit effort="5" velocity="20"/>'
BOUNDED = '<limit lower="-1" upper="1" effort="5" velocity="20"/>'


def body(name: str, geometry: str = "", xyz: str = "0 0 0", mass: float = 0.3) -> str:
    """One link that weighs and, with a geometry, collides."""
    shape = urdfs.shape("collision", geometry, xyz) if geometry else ""
    return urdfs.link(name, urdfs.inertial(mass, urdfs.tensor(1e-3, 1e-3, 1e-3), xyz), shape)


def spin(
    name: str, parent: str, xyz: str, axis: str = "0 1 0", kind: str = "continuous", limit: str = ""
) -> str:
    """The joint of a link `name`."""
    return urdfs.joint(f"{name}_j", parent, name, kind, limit or ENDLESS, xyz=xyz, axis=axis)


HUGE = '<limit lower="-1e16" upper="1e16" effort="5" velocity="20"/>'
BALL = '<sphere radius="0.05"/>'
TRUNK = body("trunk", '<box size="0.3 0.2 0.04"/>', mass=5.0)
"""From -20 to 20 mm; what turns at 30 mm below its middle with a radius of 50 mm reaches lower."""


def pair(first: str, second: str, xyz: str, **how: str) -> str:
    """Two balls, mirrored left and right."""
    x, y, z = xyz.split()
    return "".join(
        body(name, BALL) + spin(name, "trunk", f"{x} {sign}{y} {z}", **how)
        for name, sign in ((first, ""), (second, "-"))
    )


WHEELS = pair("port", "starboard", "0 0.12 -0.03")


ROD = '<box size="0.02 0.02 0.1"/>'


def limb(names: Sequence[str], at: str, apart: float = 0.1, **how: str) -> str:
    """Rods below one another on the trunk, each on a joint. apart: of their joints, m."""
    above, parts = "trunk", ""
    for name in names:
        parts += body(name, ROD, f"0 0 {-apart / 2}") + spin(name, above, at, **how)
        above, at = name, f"0 0 {-apart}"
    return parts


def seen(folder: Path, *parts: str) -> tuple[Anatomy, dict[str, str]]:
    """The anatomy and the role of each link's joint."""
    path = folder / "r.urdf"
    path.write_text(urdfs.robot(*parts))
    robot = look(find_source(path, {}))
    anatomy = study(robot)
    found = roles(robot.tree, anatomy)
    return anatomy, {j.child: found[j.name] for j in robot.tree.moving_joints}


# --- wheels ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wheels", "rolls"),
    [
        (WHEELS, True),
        (pair("a", "b", "0 0.12 -0.03", kind="revolute", limit=HUGE), True),
        (pair("a", "b", "0 0.12 -0.03", kind="revolute", limit=ENDLESS), True),  # no range at all
        (pair("a", "b", "0 0.12 -0.03", kind="revolute", limit=BOUNDED), False),
        (pair("a", "b", "0 0.12 0.2"), False),  # 130 mm above the floor
        (pair("wheel_a", "wheel_b", "0 0.12 0.2"), True),  # called so, two alike
        (pair("a", "b", "0 0.12 -0.03", axis="0 0 1"), False),  # an upright axis rolls nowhere
        (pair("wheel_a", "wheel_b", "0 0.12 -0.03", axis="0 0 1"), False),
        (WHEELS.replace(BALL, '<box size="0.1 0.02 0.1"/>'), False),  # not round
        (body("only", BALL) + spin("only", "trunk", "0 0 -0.03"), False),  # one alone, unnamed
    ],
)
def test_what_is_round_about_a_level_axis_on_the_ground_is_a_wheel(
    wheels: str, rolls: bool, tmp_path: Path
):
    anatomy, found = seen(tmp_path, TRUNK, wheels)
    assert ("wheel" in found.values()) == rolls
    assert anatomy.base == ("floating" if rolls else "fixed")


@pytest.mark.parametrize("limit", [ENDLESS, "<dynamics/>"], ids=["stated", "unstated"])
def test_a_wheel_is_driven_by_speed_whether_the_source_states_its_effort_or_not(
    limit: str, tmp_path: Path
):
    made = proposed(urdfs.robot(TRUNK, WHEELS.replace(ENDLESS, limit)), tmp_path)
    (row,) = made.plain["actuators"]
    assert row["model"] == "velocity"
    # Full effort at 1 rad/s; unstated: 0.8 m g r / 2 = 0.8 * 5.6 * 9.81 * 0.05 / 2 = 1.1 N m.
    assert (row["kd"], "effort" in row) == ((5.0, False) if limit == ENDLESS else (2.0, True))


def caster(trail: float, effort: str = "", name: str = "fork") -> str:
    """A swivel whose ball of 20 mm follows by `trail`, m; it reaches as low as the wheels."""
    return (
        body(name)
        + spin(name, "trunk", "-0.12 0 -0.02", "0 0 1", limit=effort)
        + body("follower", '<sphere radius="0.02"/>')
        + spin("follower", name, f"{-trail} 0 -0.04", limit=effort)
    )


@pytest.mark.parametrize("effort", ["<dynamics/>", ENDLESS])
@pytest.mark.parametrize(
    ("trail", "wheels", "swivel", "end"),
    [
        (0.02, WHEELS, "caster", "caster"),
        (0.0, WHEELS, "steering", "wheel"),
        (0.02, pair("wheel_x", "b", "0 0.12 0.3"), "steering", "wheel"),  # nothing else rolls
    ],
    ids=["trails", "steers", "alone"],
)
def test_a_swivel_with_trail_beside_wheels_is_a_caster(
    trail: float, wheels: str, swivel: str, end: str, effort: str, tmp_path: Path
):
    named = caster(trail, effort).replace("follower", "wheel_follower")
    _, found = seen(tmp_path, TRUNK, wheels, named)
    assert (found["fork"], found["wheel_follower"]) == (swivel, end)


def test_rollers_of_an_omnidirectional_wheel_are_not_driven(tmp_path: Path):
    rollers = "".join(
        body(f"r{i}", '<sphere radius="0.006"/>') + spin(f"r{i}", "port", place, "1 0 0")
        for i, place in enumerate(("0 0 -0.045", "0 0 0.045"))
    )
    _, found = seen(tmp_path, TRUNK, WHEELS, rollers)
    assert (found["port"], found["r0"], found["r1"]) == ("wheel", "caster", "caster")


def test_a_leg_may_end_in_a_wheel_that_is_no_joint_of_the_leg(tmp_path: Path):
    """The wheels touch the ground at 0.2 + 0.2 + 0.05 m below the hips."""
    parts = [TRUNK]
    for name, place in zip(SIDES, PLACES, strict=True):
        leg = (f"{name}_a", f"{name}_b")
        parts.append(limb(leg, f"{place} 0", apart=0.2, kind="revolute", limit=BOUNDED))
        parts += [body(f"{name}_c", BALL), spin(f"{name}_c", f"{name}_b", "0 0 -0.2")]
    anatomy, found = seen(tmp_path, *parts)
    assert [len(leg.joints) for leg in anatomy.legs] == [2] * 4
    assert {(leg.tip[3:], leg.foot[3:]) for leg in anatomy.legs} == {("b", "c")}
    assert {part for name, part in found.items() if name.endswith("_c")} == {"wheel"}
    assert anatomy.legs[0].length == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("names", "limit", "axis", "base"),
    [
        ("{}_shoulder {}_arm {}_hand", BOUNDED, "0 1 0", "floating"),
        ("{}_hip {}_thigh {}_calf", BOUNDED, "0 1 0", "floating"),
        ("{}_a {}_b", ENDLESS, "0 1 0", "floating"),  # as exporters leave joints without limits
        ("{}_a {}_b", ENDLESS, "0 0.8 0.6", "floating"),  # splayed at 0, as Digit's legs
        ("{}_palm {}_finger {}_fingertip", BOUNDED, "0 1 0", "fixed"),
    ],
)
def test_a_dog_stands_on_four_limbs_but_no_hand_on_its_fingers(
    names: str, limit: str, axis: str, base: str, tmp_path: Path
):
    kind, parts = "revolute" if limit == BOUNDED else "continuous", [TRUNK]
    for side, place in zip(SIDES, PLACES, strict=True):
        links = names.format(side, side, side).split()
        parts.append(limb(links, f"{place} 0", axis=axis, kind=kind, limit=limit))
    parts += [body("left_arm", mass=0.1), spin("left_arm", "trunk", "0 0.2 0.1", limit=BOUNDED)]
    parts += [body("right_arm", mass=0.1), spin("right_arm", "trunk", "0 -0.2 0.1", limit=BOUNDED)]
    parts += [body("rod", mass=0.1), spin("rod", "trunk", "0 0.2 0", limit=BOUNDED)]
    anatomy, found = seen(tmp_path, *parts)
    assert anatomy.base == base
    small = "finger" if base == "fixed" else "arm"  # of a walker, however small
    assert found["left_arm"] == found["rod"] == small


# --- rotors ---------------------------------------------------------------------------------

DISC = '<cylinder radius="0.06" length="0.005"/>'


def drone(names: str = "rotor_{}", axis: str = "0 0 1") -> str:
    return TRUNK + "".join(
        body(names.format(i), DISC, mass=0.005)
        + spin(names.format(i), "trunk", f"{place} 0.03", axis, limit="<dynamics/>")
        for i, place in enumerate(PLACES)
    )


@pytest.mark.parametrize(
    ("robot", "flies"),
    [
        (drone(), True),
        (drone("prop_{}", axis="1 0 0"), True),  # tilted over, but called so
        (drone("thruster_{}", axis="1 0 0"), True),
        (drone("part_{}"), False),  # what they are nobody says
        (TRUNK + body("turret", DISC) + spin("turret", "trunk", "0 0 0.1", "0 0 1"), False),
    ],
)
def test_two_or_more_that_are_called_so_are_rotors(robot: str, flies: bool, tmp_path: Path):
    anatomy, found = seen(tmp_path, robot)
    assert ("rotor" in found.values()) == flies
    assert anatomy.base_reason.startswith("it flies") == flies


def test_rotors_are_driven_by_speed_with_what_carries_the_robot(tmp_path: Path):
    """5.02 kg on four discs of 60 mm: 2 * 0.15 * 5.02 * 9.81 * 0.06 / 4 = 0.22 N m, so 0.5."""
    made = proposed(urdfs.robot(drone()), tmp_path)
    (row,) = made.plain["actuators"]
    assert (row["model"], row["effort"]) == ("velocity", 0.5)
    assert made.proposal.undecided == ""


@pytest.mark.parametrize("name", ["hexarotor", "aerial_manipulator"])
def test_what_is_called_an_aircraft_flies_with_an_arm_and_fixed_rotors(name: str, tmp_path: Path):
    arm = limb(("upper", "lower"), "0 0 -0.1", kind="revolute", limit=BOUNDED)
    rotor = body(name) + spin(name, "trunk", "0.1 0 0", kind="fixed")
    anatomy, _ = seen(tmp_path, TRUNK, arm, rotor)
    assert anatomy.base_reason == f"it flies, by the name of `{name}`"


# --- neither --------------------------------------------------------------------------------


def chain(kinds: str) -> str:
    """A column of rods, each on a joint: r revolute, c continuous."""
    parts, above, place = body("foot", '<box size="0.3 0.3 0.02"/>'), "foot", "0 0 0.02"
    for i, kind in enumerate(kinds):
        parts += body(f"rod{i}", '<box size="0.03 0.03 0.2"/>', "0 0 0.1")
        said = ("continuous", ENDLESS) if kind == "c" else ("revolute", BOUNDED)
        parts += spin(f"rod{i}", above, place, "0 1 0", *said)
        above, place = f"rod{i}", "0 0 0.2"
    return parts


SLIDE = '<limit lower="0" upper="0.04" effort="5" velocity="1"/>'


@pytest.mark.parametrize(
    ("robot", "known"),
    [
        (chain("rrr"), True),
        (chain("ccccccc"), True),  # as a Kinova's: neither wheels nor rotors
        (chain("rr"), True),
        (chain("r"), False),  # a door
        (chain("rc"), False),  # a pendulum on a hinge
        (TRUNK + body("turret", DISC) + spin("turret", "trunk", "0 0 0.1", "0 0 1"), False),
        (TRUNK + body("w", DISC) + spin("w", "trunk", "0 0 0.4", "0 1 0"), False),  # a water wheel
        (TRUNK + pair("l", "r", "0 0.02 0.1", kind="prismatic", limit=SLIDE), True),  # a gripper
    ],
)
def test_what_matches_nothing_is_said_to_with_what_to_decide(
    robot: str, known: bool, tmp_path: Path
):
    made = proposed(urdfs.robot(robot), tmp_path)
    assert "velocity" not in {row["model"] for row in made.plain["actuators"]}
    assert ("`base` (`floating` if loose)" in made.proposal.undecided) != known
    assert ("\n# UNDECIDED: " in made.text) != known
    assert made.recipe.base == "fixed"


def test_what_turns_on_top_is_driven_by_speed_where_it_is_called_so(tmp_path: Path):
    lidar = body("lidar", '<cylinder radius="0.03" length="0.05"/>')
    _, found = seen(tmp_path, TRUNK, WHEELS, lidar, spin("lidar", "trunk", "0 0 0.1", "0 0 1"))
    assert found["lidar"] == "spinner"


@pytest.mark.parametrize(("joints", "base"), [(5, "floating"), (3, "fixed")])
def test_two_legs_by_name_are_a_humanoids_where_they_point_up(
    joints: int, base: str, tmp_path: Path
):
    """An Onshape export drawn upside down; three joints each might as well be two arms."""
    sides = {side: [f"{side}_leg_{number}" for number in range(joints)] for side in ("l", "r")}
    legs = [
        limb(names, f"0 {y} 0", -0.1, kind="revolute", limit=BOUNDED)
        for names, y in zip(sides.values(), (0.1, -0.1), strict=True)
    ]
    anatomy, found = seen(tmp_path, TRUNK, *legs)
    assert anatomy.base == base
    assert ({*found.values()} == {"leg"}) == (base == "floating")


@pytest.mark.parametrize(("mass", "stands"), [(0.005, True), (0.3, False)])
def test_gears_and_rods_beside_a_leg_are_no_limbs(mass: float, stands: bool, tmp_path: Path):
    """ToddlerBot has gears on its thighs, where the shanks hang."""
    parts = []
    for side, y in (("l", "0.1"), ("r", "-0.1")):
        hip, knee = f"{side}_thigh", f"{side}_shank"
        parts += [body(hip), spin(hip, "trunk", f"0 {y} 0", limit=BOUNDED)]
        parts += [body(knee, BALL, "0 0 -0.2"), spin(knee, hip, "0 0 -0.2", limit=BOUNDED)]
        for gear in (f"{side}_a", f"{side}_b"):
            parts += [body(gear, mass=mass), spin(gear, hip, "0.02 0 0", limit=BOUNDED)]
    anatomy, _ = seen(tmp_path, TRUNK, *parts)
    assert (anatomy.base == "floating") == stands
    assert [leg.foot for leg in anatomy.legs] == ["l_shank", "r_shank"] * stands


def test_a_spring_at_the_heel_of_a_leg_is_no_finger(tmp_path: Path):
    """By the leg's names, where nothing says that it is one: its linkage branches (Cassie)."""
    parts = [TRUNK, limb(("hip", "knee", "tarsus"), "0 0 -0.3", apart=0.3, limit=BOUNDED)]
    for name in ("heel_spring", "toe"):
        parts += [body(name, mass=0.1), spin(name, "tarsus", "0.02 0 0", limit=BOUNDED)]
    parts += [body("gripper", mass=0.1), spin("gripper", "trunk", "0.2 0 0", limit=BOUNDED)]
    _, found = seen(tmp_path, *parts)
    assert found["heel_spring"] == found["toe"] == "arm"
    assert found["gripper"] == "finger"


def test_a_strut_that_carries_a_wheel_is_no_finger(tmp_path: Path):
    struts = [
        body(f"{side}_strut", mass=0.05)
        + spin(f"{side}_strut", "trunk", f"0 {y} -0.1", "0 0 1", "prismatic", BOUNDED)
        + body(f"{side}_wheel", '<cylinder radius="0.05" length="0.02"/>')
        + spin(f"{side}_wheel", f"{side}_strut", "0 0 0", "0 1 0")
        for side, y in (("left", 0.1), ("right", -0.1))
    ]
    _, found = seen(tmp_path, TRUNK, *struts)
    assert (found["left_strut"], found["left_wheel"]) == ("arm", "wheel")


def test_feet_that_cannot_be_bodies_of_their_own_are_not_proposed_as_such(
    robots: Path, tmp_path: Path
):
    text = (robots / "four_legs.urdf").read_text()
    for moment, is_body in (("7.5e-06", True), ("0", False)):
        recipe = proposed(text.replace("7.5e-06", moment), tmp_path).text
        assert ("foot_bodies:" in recipe) == is_body


def test_an_antenna_on_a_head_is_no_finger(tmp_path: Path):
    def roles_below(name: str) -> dict[str, str]:
        ends = [body(end, mass=0.02) + spin(end, name, "0 0 0.1") for end in ("left", "right")]
        _, found = seen(tmp_path, TRUNK, body(name), spin(name, "trunk", "0 0 0.2"), *ends)
        return found

    assert roles_below("head")["left"] == "arm"
    assert roles_below("plate")["left"] == "finger"


def test_a_robot_in_millimetres_is_asked_about(tmp_path: Path):
    far = chain("rrr").replace("0 0 0.2", "0 0 200")
    undecided = proposed(urdfs.robot(far), tmp_path).proposal.undecided
    assert "400 m apart: in millimetres?" in undecided
