"""What a build prints at its end fits the screen, the reason before what follows from it."""

from __future__ import annotations

import pytest

from assetbuild.cli.progress import _Running, running_words
from assetbuild.cli.summary import finding_lines
from assetbuild.findings import Finding, worst_first

HEAVY = [
    Finding("mass.density", "warning", f"link finger_{i}", "9000 kg per cubic metre" * 3, "look")
    for i in range(40)
]
REFUSED = Finding("mjcf.load", "error", "robot", "MuJoCo refuses r.xml", "read the lints")
FOLLOWS = [Finding(f"{n}.load", "error", "robot", "nothing") for n in ("free_fall", "stand")]
MANY = [Finding(f"rule.number_{i}", "warning", "link a", "something is odd") for i in range(30)]


def test_a_rule_is_told_once_with_the_names_of_all_it_speaks_of():
    lines = finding_lines(HEAVY)
    assert len(lines) == 3
    assert lines[2].startswith("      and 39 more: link finger_1, link finger_2")


@pytest.mark.parametrize(("width", "room"), [(80, 12), (120, 30), (40, 6)])
def test_no_line_is_wider_and_no_summary_longer_than_the_terminal(width: int, room: int):
    lines = finding_lines(worst_first([*HEAVY, *MANY, REFUSED, *FOLLOWS]), width, room)
    assert len(lines) <= room
    assert max(map(len, lines)) <= width
    assert lines[-1].endswith("more in the report")


def test_what_follows_from_an_error_is_one_line_after_it():
    lines = finding_lines(worst_first([*FOLLOWS, REFUSED]))
    assert lines[0].startswith("    error mjcf.load")
    assert lines[-1].startswith("    error free_fall.load, stand.load: nothing to work on")


def test_the_progress_line_begins_with_what_most_steps_wait_for():
    running = [_Running("pictures", 90.0, 0), _Running("auto trunk", 88.0, 31)]
    assert running_words(running, 100.0) == "auto trunk 12 s (31 wait for it), pictures 10 s"
