"""Each action runs once, in one build and among many builds at once on one store."""

from __future__ import annotations

import json
import subprocess
import time
from collections import Counter
from pathlib import Path

import pytest
from builds_for_tests import calling, object_file, together
from steps_for_tests import Count, CountInParent, Mix

from assetbuild.engine.execute import execute
from assetbuild.engine.planner import Planner
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store

BUILDS = 8


def build_at_once(folder: str, me: str) -> None:
    """In each round: wait until all builds are here, then build what the store does not know."""
    for number, kind in enumerate((Count, CountInParent)):
        place = Path(folder, str(number))
        (place / "here").mkdir(parents=True, exist_ok=True)
        (place / "here" / me).touch()
        while len(list((place / "here").iterdir())) < BUILDS:
            time.sleep(0.002)
        log = str(place / "log")
        with Session(Store(place / "store"), build=me) as session:
            planner = Planner(session)
            a = planner.add("a", kind(log=log, name="a", seconds=0.02))
            middle = [planner.add(n, kind(log=log, name=n), {"in": a["out"]}) for n in "bcd"]
            last = kind(log=log, name="e", seconds=0.01)
            planner.add("e", last, {node.label: node["out"] for node in middle})
            results = execute(planner.graph(), session, jobs=2)
        told = [[k, r.status, r.outputs] for k, r in results.items()]
        (place / f"result-{me}").write_text(json.dumps(told))


@pytest.mark.slow
def test_eight_builds_at_once_run_each_action_once(tmp_path: Path):
    builds = [
        subprocess.Popen(
            calling("test_single_flight", f"build_at_once({str(tmp_path)!r}, '{number}')")
        )
        for number in range(BUILDS)
    ]
    assert [build.wait(timeout=120) for build in builds] == [0] * BUILDS
    for place in (tmp_path / "0", tmp_path / "1"):
        ran = Counter((place / "log").read_text().split())
        assert ran == dict.fromkeys("abcde", 1)
        told = [json.loads(path.read_text()) for path in place.glob("result-*")]
        assert len(told) == BUILDS
        assert len({json.dumps([[k, o] for k, _, o in one]) for one in told}) == 1
        states = Counter(status for one in told for _, status, _ in one)
        assert states == {"ran": 5, "cached": 5 * (BUILDS - 1)}
        assert list((place / "store/v1/turns").iterdir()) == []


def test_two_nodes_of_one_build_with_the_same_key_run_once(session: Session, tmp_path: Path):
    step = Count(log=str(tmp_path / "log"), name="it", seconds=0.1)
    results = together(session, {"left": step, "right": step}, jobs=2)
    assert sorted(result.status for result in results.values()) == ["cached", "ran"]
    assert (tmp_path / "log").read_text() == "it\n"
    assert results["left"].outputs == results["right"].outputs


def test_a_failure_is_not_shared_and_the_next_in_turn_tries_itself(session: Session, tmp_path):
    step = Count(log=str(tmp_path / "log"), name="it", text="\udcff")  # cannot be written
    results = together(session, {"left": step, "right": step}, jobs=2, keep_going=True)
    assert [result.status for result in results.values()] == ["failed", "failed"]


def test_a_step_and_its_maker_may_have_the_same_key(session: Session, source: Path):
    """`second` and `third` read the same bytes, so they are one action; healing meets both."""
    planner = Planner(session)
    first = planner.add("first", Mix(keep=0), {"in": planner.source(source)})
    second = planner.add("second", Mix(keep=0), {"in": first["out"]})
    third = planner.add("third", Mix(keep=0), {"in": second["out"]})
    results = execute(planner.graph(), session, jobs=2)
    assert results["second"].key == results["third"].key
    object_file(session.store, results["third"]["out"]).unlink()
    session.forget()
    planner.add("last", Mix(), {"in": third["out"]})
    assert not any(r.error for r in execute(planner.graph(), session, jobs=2).values())
