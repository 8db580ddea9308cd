"""An effort that the source does not state, or cannot mean, is guessed from physics and marked."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import urdfs
from proposals import Proposed, proposed

GRAVITY = 9.81


@dataclass(frozen=True)
class Segment:
    """A rod of a chain: kg, and m from its joint to the next; it turns about `axis`."""

    mass: float
    length: float
    effort: str
    axis: str = "0 1 0"
    name: str = ""


def chain(folder: Path, segments: Sequence[Segment], more: str = "") -> Proposed:
    """What `init` proposes for a chain that stands on a bolted root. more: of its URDF."""
    parts, above, height = [urdfs.link("world", ""), more], "world", 0.0
    for index, part in enumerate(segments):
        name = part.name or f"segment_{index}"
        across = part.mass * part.length**2 / 12
        moments = urdfs.tensor(across, across, across / 9)
        limit = f'<limit lower="-3.1" upper="3.1" velocity="3" {part.effort}/>'
        place = {"xyz": f"0 0 {height}", "axis": part.axis}
        parts += [
            urdfs.link(name, urdfs.inertial(part.mass, moments, f"0 0 {part.length / 2}")),
            urdfs.joint(f"{name}_joint", above, name, content=limit, **place),
        ]
        above, height = name, part.length
    return proposed(urdfs.robot(*parts, name="chain"), folder)


def row_of(made: Proposed, joint: str) -> dict[str, Any]:
    """The row of the actuator table that matches a joint. Any: values of YAML."""
    return next(r for r in made.plain["actuators"] if re.fullmatch(r["joints"], joint))


ARM = [Segment(8.0, 0.5, ""), Segment(4.0, 0.5, ""), Segment(0.5, 0.1, "", "0 0 1")]


@pytest.mark.parametrize("said", ["", 'effort="1e9"'])
def test_an_arm_without_efforts_is_driven_by_guesses_that_hold_it_stretched_out(
    said: str, tmp_path: Path
):
    parts = [Segment(part.mass, part.length, said, part.axis) for part in [*ARM, *ARM[2:]]]
    made = chain(tmp_path, parts)
    assert all(row["model"] == "pd" and row["guessed"] for row in made.plain["actuators"])
    stretched = GRAVITY * (8.0 * 0.25 + 4.0 * 0.75 + 0.5 * 1.05 + 0.5 * 1.15)
    shoulder = row_of(made, "segment_0_joint")["effort"]
    assert 1.9 * stretched < shoulder < 10 * stretched
    assert "(a guess for the arm: the source" in made.text


def test_stated_efforts_stay_the_sources_own(tmp_path: Path):
    efforts = (150, 100, 12)
    parts = [Segment(p.mass, p.length, f'effort="{e}"', p.axis) for p, e in zip(ARM, efforts)]  # noqa: B905
    assert not any(
        "guessed" in row or "effort" in row for row in chain(tmp_path, parts).plain["actuators"]
    )


def test_a_wrist_that_moves_nothing_gets_a_share_of_its_arm_and_the_rotor_that_comes_with_it(
    tmp_path: Path,
):
    made = chain(tmp_path, ARM)
    shoulder, wrist = (row_of(made, f"segment_{n}_joint") for n in (0, 2))
    assert wrist["effort"] >= 0.1 * shoulder["effort"]
    assert wrist["armature"] == pytest.approx(wrist["effort"] / 6000, rel=0.05)
    assert shoulder["armature"] == pytest.approx(shoulder["effort"] / 6000, rel=0.05)


@pytest.mark.parametrize(("shoulder", "elbow"), [(1, 1), (10, 5), (11, 5), (12, 5), (13, 5)])
def test_mirrored_arms_get_the_same_drives(shoulder: int, elbow: int, tmp_path: Path):
    """Two arms, one of which turns half as far; their shoulders hold about half of the poses."""
    parts = [urdfs.link("world", "")]
    for side, y, most in (("left", 0.3, 3.0), ("right", -0.3, 1.4)):
        above, place = "world", f"0 {y} 1"
        for part, mass, effort in (("upper", 3.0, shoulder), ("lower", 2.0, elbow)):
            name = f"{side}_{part}"
            limit = f'<limit lower="{-most}" upper="{most}" velocity="3" effort="{effort}"/>'
            moments = urdfs.tensor(0.02, 0.02, 0.002)
            parts += [
                urdfs.link(name, urdfs.inertial(mass, moments, "0 0 -0.2")),
                urdfs.joint(f"{name}_joint", above, name, content=limit, xyz=place, axis="0 1 0"),
            ]
            above, place = name, "0 0 -0.4"
    made = proposed(urdfs.robot(*parts, name="arms"), tmp_path)
    for part in ("upper", "lower"):
        left, right = (row_of(made, f"{side}_{part}_joint") for side in ("left", "right"))
        assert left == right
        assert elbow > 1 or left["effort"] != 1.0


def test_a_large_arm_is_accelerated_at_its_end_like_a_small_one(tmp_path: Path):
    """A rod of 200 kg and 3 m about a vertical axis has 2400 kg m2; 13 m/s2 are 4.3 rad/s2."""
    rod = Segment(200.0, 3.0, "", "0 1 0")
    effort = row_of(chain(tmp_path, [rod, ARM[2]]), "segment_0_joint")["effort"]
    held = 2 * GRAVITY * 200.0 * 1.5
    moved = 200.0 * 3.0**2 / 3 * 13.0 / 3.0
    assert held + moved < effort < 2.6 * (held + moved)


@pytest.mark.parametrize(("name", "effort"), [("caster", 0), ("rocker_bogie", 10000)])
def test_a_caster_and_a_bogie_stay_passive(name: str, effort: int, tmp_path: Path):
    parts = [*ARM, Segment(0.1, 0.05, f'effort="{effort}"', name=name)]
    assert row_of(chain(tmp_path, parts), f"{name}_joint") == {
        "joints": f"{name}_joint",
        "model": "passive",
    }


def test_what_cannot_be_mended_is_said_first(tmp_path: Path):
    """A stated effort that bears no weight stays: a tenth of a gram metre cannot turn the arm."""
    weak = [Segment(8.0, 0.5, 'effort="0.001"', "0 0 1"), Segment(4.0, 0.5, 'effort="5"')]
    made = chain(tmp_path, weak)
    assert "segment_0_joint" in made.proposal.unmended[0]
    head = made.text.partition("\nschema:")[0]
    assert "\n# NOT READY: actuator segment_0_joint" in head


@pytest.mark.parametrize(
    ("mass", "share", "guessed"), [(2.0, 0.05, True), (406.0, 0.4, True), (40.0, 0.9, False)]
)
def test_an_effort_that_cannot_hold_most_poses_is_guessed_and_home_stays(
    mass: float, share: float, guessed: bool, tmp_path: Path
):
    """A rod that turns about the horizontal needs m g l/2 |sin q|: more than s of its most in
    1 - 2/pi asin(s) of all poses, which is half of them at s = 0.71.
    """
    effort = share * mass * GRAVITY * 0.5
    rod = Segment(mass, 1.0, f'effort="{effort}"')
    made = chain(tmp_path, [Segment(1.0, 0.1, 'effort="50"', "0 0 1"), rod])
    assert row_of(made, "segment_1_joint").get("guessed", False) is guessed
    assert ("of random poses" in made.text) is guessed
    assert made.proposal.unmended == ()


def test_a_weak_drive_of_a_heavy_body_is_no_switch(tmp_path: Path):
    """About the vertical, where no weight is held: all of its 20 N m at 0.03 rad or more."""
    rods = [Segment(500.0, 1.0, 'effort="20"', "0 0 1"), Segment(50.0, 1.0, 'effort="2000"')]
    row = row_of(chain(tmp_path, rods), "segment_0_joint")
    assert 20.0 / row["kp"] == pytest.approx(0.03, rel=0.05)


def test_one_effort_for_all_that_cannot_hold_the_robot_is_a_placeholder_too(tmp_path: Path):
    """100 N m on each of five joints, of which the first two need 1,400 and 600 to hold still."""
    heavy = [Segment(150.0, 1.0, 'effort="100"'), Segment(100.0, 1.0, 'effort="100"')]
    tip = Segment(1.0, 0.1, 'effort="100"')
    sideways = [Segment(1.0, 0.1, 'effort="100"', "1 0 0"), *heavy, tip, tip]
    made = chain(tmp_path, sideways)
    assert made.proposal.unmended == ()


def test_one_effort_for_all_is_a_motors_where_a_joint_needs_it(tmp_path: Path):
    """100 N m on each of four; two need about as much, and a camera of 0.1 kg turns on the side."""
    said = 'effort="100"'
    arm = [Segment(8.0, 0.5, said), Segment(4.0, 0.5, said), Segment(0.5, 0.1, said)]
    limit = f'<limit lower="-1" upper="1" velocity="3" {said}/>'
    eye = urdfs.link("eye", urdfs.inertial(0.1, urdfs.tensor(1e-5, 1e-5, 1e-5)))
    eye += urdfs.joint("eye_joint", "world", "eye", content=limit, axis="0 0 1", xyz="0.3 0 0")
    made = chain(tmp_path, arm, eye)
    assert "guessed" not in row_of(made, "segment_0_joint")
    assert "guessed" in row_of(made, "eye_joint")  # which 0.01 N m turns
