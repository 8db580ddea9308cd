"""`init` asks a robot to stand where it has seen it stand, and says what it saw."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from proposals import proposed

from assetbuild.init.anatomy import study
from assetbuild.init.draft import Draft
from assetbuild.init.drives import drive_rows
from assetbuild.init.home import home_pose
from assetbuild.init.look import InspectedRobot, judge, look
from assetbuild.init.sections import put_validation
from assetbuild.init.source import find_source
from assetbuild.init.trial import Trial, staged, tune

DOG = "four_legs.urdf"


def tried(robots: Path, weaker: float = 1.0, soles: tuple[str, ...] | None = None) -> Trial:
    """The dog with the gains that `init` gives it, divided by `weaker`."""
    robot = look(find_source(robots / DOG, {}))
    legs = study(robot).legs
    robot = judge(robot, "floating")
    pose = home_pose(robot.tree, legs)
    drives = [
        replace(row, gains={name: gain / weaker for name, gain in row.gains.items()})
        for row in drive_rows(robot.tree, pose, legs)
    ]
    feet = soles if soles is not None else tuple(sole for leg in legs for sole in leg.soles)
    with staged(robot, feet) as stage:
        return stage.attempt(drives, pose, 0.002)


def test_a_dog_whose_drives_are_too_weak_falls(robots: Path):
    trial = tried(robots, weaker=100.0)
    assert (trial.stands, trial.sentence) == (False, "falls within 2 s")


@pytest.mark.parametrize(
    ("lean", "off", "left", "shift"),
    [
        (0.2, (0.02, 0.001), 0.0, (0.02, 0.0)),  # 1 mm aside is no reason to lean aside
        (0.2, (0.0, 0.01), 0.0, (0.0, 0.01)),
        (0.04, (0.02, 0.0), 0.0, (0.02, 0.0)),
        (0.02, (0.02, 0.0), 0.0, (0.0, 0.0)),
        (0.08, (0.02, 0.0), 0.05, (0.02, 0.0)),  # it leans less
        (0.08, (0.02, 0.0), 0.07, (0.0, 0.0)),  # but hardly
    ],
)
def test_a_robot_that_leans_gets_its_feet_below_its_centre_of_mass(
    lean: float, off: tuple[float, float], left: float, shift: tuple[float, float], robots: Path
):
    trials = itertools.chain(
        [Trial(True, "stands", lean=lean, off=off)],
        itertools.repeat(Trial(True, "stands", lean=left)),
    )
    robot = look(find_source(robots / DOG, {}))
    anatomy = study(robot)
    stage = SimpleNamespace(robot=judge(robot, "floating"), attempt=lambda *_: next(trials))
    tuning = tune(stage, anatomy, {})
    assert tuning.shift == shift


def asked(robot: InspectedRobot, trial: Trial, legs: int) -> list[str]:
    draft = Draft()
    put_validation(draft, robot, study(robot).legs[:legs], trial)
    return draft.text.splitlines()


@pytest.mark.parametrize(
    ("stands", "legs", "written"),
    [(True, 4, True), (True, 2, True), (False, 4, False), (None, 4, True), (None, 2, False)],
)
def test_who_was_seen_to_stand_must_and_who_falls_need_not(
    robots: Path, stands: bool | None, legs: int, written: bool
):
    """Four legs are believed untried, two are not."""
    lines = asked(look(find_source(robots / DOG, {})), Trial(stands, "seen"), legs)
    assert any(line.startswith("  stand: {keyframe: home") for line in lines) is written
    assert any("# stand: {" in line for line in lines) is not written
    assert any("seen." in line for line in lines)


def test_the_recipe_of_the_dog_asks_it_to_stand_and_says_why(robots: Path, tmp_path: Path):
    made = proposed(robots / DOG, tmp_path)
    assert "# In MuJoCo, with the hulls of its links, it stands for 2 s" in made.text
    assert made.recipe.stated("validate") == {"stand"}


STICK = (
    '<collision><origin xyz="0 0 -0.12"/><geometry><box size="0.02 0.02 0.24"/></geometry>'
    "</collision></link>"
)
"""A shin that ends 20 mm below its foot."""


def test_a_robot_that_stands_on_its_shins_is_not_asked_to_stand_on_its_feet(
    robots: Path, tmp_path: Path
):
    text = (robots / DOG).read_text()
    for leg in ("LF", "RF", "LH", "RH"):
        head, tail = text.split(f'<link name="{leg}_calf">')
        text = f'{head}<link name="{leg}_calf">' + tail.replace("</link>", STICK, 1)
    text = proposed(text, tmp_path).text
    assert "stands, but link LF_foot: at `home` its sole is" in text
    assert "  # stand: {keyframe: home" in text


def test_a_dog_that_is_folded_at_zero_stands_up_at_home(robots: Path, tmp_path: Path):
    """Its shins lie along its thighs there, with the feet not far below the hips."""
    lines = []
    for line in (robots / DOG).read_text().splitlines():
        if "_calf" in line and "<link" in line:
            line = line.replace('"0 0 -0.1"', '"0 0 0.05"')
        if "_foot_fixed" in line:
            line = line.replace('"0 0 -0.2"', '"0 0 0.12"')
        if "_calf_joint" in line:
            line = line.replace('lower="-2.7" upper="-0.9"', 'lower="-3.1" upper="3.1"')
        lines.append(line)
    assert "it stands for 2 s: base height 0.3" in proposed("\n".join(lines), tmp_path).text


BOARD = (
    '<collision><origin xyz="-0.2 -0.16 -0.1"/><geometry><box size="0.5 0.5 0.08"/></geometry>'
    "</collision></link>"
)
"""Under the trunk and through the other thighs, where a thigh in front on the left carries it."""


def test_bodies_inside_each_other_that_throw_a_robot_over_are_excluded_and_told(
    robots: Path, tmp_path: Path
):
    head, tail = (robots / DOG).read_text().split('<link name="LF_thigh">')
    crossed = f'{head}<link name="LF_thigh">' + tail.replace("</link>", BOARD, 1)
    text = proposed(crossed, tmp_path).text
    assert "[LF_thigh, RF_thigh]" in text
    assert "# LF_thigh in RF_thigh: " in text
    assert "  stand: {keyframe: home" in text


def test_soles_without_a_shape_cannot_be_tried(robots: Path):
    assert tried(robots, soles=("imu_link",)).stands is None
