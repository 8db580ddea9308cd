"""Steps run side by side only as far as what they declare fits into the machine's memory."""

from __future__ import annotations

import pytest
from steps_for_tests import Big, Mix

from assetbuild.engine.execute import execute
from assetbuild.engine.planner import Planner
from assetbuild.engine.processes import Processes
from assetbuild.engine.session import Session


@pytest.mark.parametrize(
    ("memory_mb", "together"), [(9000, True), (6000, True), (5999, False), (1, False)]
)
def test_declared_memory_bounds_what_runs_at_once(
    session: Session, tmp_path, memory_mb: int, together: bool
):
    place = tmp_path / "place"
    place.mkdir()
    planner = Planner(session)
    for number in range(2):
        planner.add(
            str(number),
            Big(number=number, company=2, folder=str(place), patience_s=0.5 + 9 * together),
        )
    planner.add("small", Mix())
    results = execute(planner.graph(), session, jobs=3, memory_mb=memory_mb)
    met = sorted(session.read(results[label]["out"]) for label in "01")
    assert met == ([b"2", b"2"] if together else [b"1", b"2"])


def test_this_machine_has_some_memory(session: Session):
    with Processes(session) as runner:
        assert 1 <= runner.memory_mb < 10**9
