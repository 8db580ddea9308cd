"""Why a step ran or would run: the part of its key that changed is named."""

from __future__ import annotations

import json
import zlib
from pathlib import Path

import pytest
from builds_for_tests import object_file, together
from steps_for_tests import Count, Irreproducible, Mix, MixInChild, Split, Write

from assetbuild.engine.actions import Action, key_parts
from assetbuild.engine.code import PYTHON, Code
from assetbuild.engine.cpu import platform_tag
from assetbuild.engine.execute import execute
from assetbuild.engine.explain import changes_between, explain
from assetbuild.engine.graph import Graph, joined
from assetbuild.engine.journal import JOURNAL_FORMAT, Change
from assetbuild.engine.planner import Planner
from assetbuild.engine.processes import Processes
from assetbuild.engine.rebuild import run_again
from assetbuild.engine.session import Session
from assetbuild.engine.step import Step
from assetbuild.engine.store import Store


class Row(Step):
    joints: str = ".*"
    kp: float = 80.0


class Actuators(Step):
    rows: tuple[Row, ...] = (Row(), Row())
    limits_n_m: dict[str, float]


CODE = Code()
PARTS = key_parts(Actuators(limits_n_m={}), {"robot.urdf": "3f2a91c0" + "0" * 56}, CODE)


NEW_ROWS = key_parts(Actuators(rows=(Row(), Row(kp=90.0)), limits_n_m={"hip": 3.0}), {}, CODE)
INPUT = PARTS["inputs"]
CHANGES = {
    "field rows[1].kp: 80.0 -> 90.0": {"fields": NEW_ROWS["fields"]},
    "field limits_n_m.hip: nothing -> 3.0": {"fields": NEW_ROWS["fields"]},
    "input robot.urdf changed (3f2a91c0 -> 99ab0000)": {
        "inputs": {"robot.urdf": "99ab" + "0" * 60}
    },
    "input robot.urdf is gone": {"inputs": {}},
    "input b is new": {"inputs": {**INPUT, "b": "0" * 64}},
    "code steps_for_tests changed": {"code": {**PARTS["code"], "steps_for_tests": "0"}},
    f"library pytest: {PARTS['libraries']['pytest']} -> 1": {
        "libraries": {**PARTS["libraries"], "pytest": "1"}
    },
    f"python: {PYTHON} -> cpython 3.20": {"python": "cpython 3.20"},
    f"platform: {platform_tag()} -> linux-riscv": {"platform": "linux-riscv"},
    f"kernel OPENBLAS_CORETYPE: {PARTS['kernels'].get('OPENBLAS_CORETYPE', 'nothing')} -> Zen": {
        "kernels": {**PARTS["kernels"], "OPENBLAS_CORETYPE": "Zen"}
    },
}


@pytest.mark.parametrize("said", CHANGES)
def test_what_changed_of_a_key_is_named_with_both_values(said):
    assert said in [str(change) for change in changes_between(PARTS, {**PARTS, **CHANGES[said]})]


def test_the_order_of_a_mapping_counts():
    one = key_parts(Actuators(limits_n_m={"hip": 1.0, "calf": 2.0}), {}, CODE)
    other = key_parts(Actuators(limits_n_m={"calf": 2.0, "hip": 1.0}), {}, CODE)
    assert Action("it", Mix(), one).key != Action("it", Mix(), other).key
    assert [c.part for c in changes_between(one, other)] == ["order"]


@pytest.mark.parametrize("part", list(PARTS))
def test_every_part_of_a_key_changes_the_key_and_is_explained(part):
    new = {**PARTS, part: {"x": "new"} if isinstance(PARTS[part], dict) else "new"}
    # The digest of the order changes with the fields too; explained only when it is alone.
    assert Action("it", Mix(), new).key != Action("it", Mix(), PARTS).key
    assert changes_between(PARTS, new)


def graph(session: Session, salt: int = 0) -> Graph:
    planner = Planner(session)
    first = planner.add("first", Mix(salt=salt))
    planner.add("second", Mix(), {"in": first["out"]})
    return planner.graph()


def test_why_a_node_ran_is_known_long_after(tmp_path):
    for salt in (0, 7, 7, 7):
        with Session(Store(tmp_path / "store"), build="go1.yaml") as session:
            execute(graph(session, salt), session)
    with Session(Store(tmp_path / "store"), build="go1.yaml") as session:
        first = explain(graph(session, 7), session, "first")
        second = explain(graph(session, 7), session, "second")
    assert first.state == second.state == "up to date"
    assert [str(change) for change in first.last_changes] == ["field salt: 0 -> 7"]
    assert "input in changed" in second.to_text()
    assert "in comes from `first`" in second.to_text()
    assert json.loads(json.dumps(second.to_json()))["last_changes"][0]["name"] == "in"


def test_why_a_node_would_run_is_told_before_it_does(session):
    told = explain(graph(session), session, "first")
    assert (told.state, told.changes) == ("would run", (Change("first"),))
    execute(graph(session), session)
    changed = graph(session, 3)
    assert explain(changed, session, "first").to_text().splitlines()[:2] == [
        "first: would run",
        "  field salt: 0 -> 3",
    ]
    second = explain(changed, session, "second")
    assert second.state == "waits"
    assert second.waits_for == ("first",)
    assert "after `first`, which would run first" in second.to_text()


def test_a_result_says_why_it_ran(session):
    assert execute(graph(session), session)["first"].reason == "first build"
    results = execute(graph(session, 5), session)
    assert results["first"].reason == "field salt: 0 -> 5"
    assert results["second"].reason.startswith("input in changed (")
    assert execute(graph(session, 0), session)["first"].status == "cached"


def test_a_lost_output_is_the_reason(tmp_path):
    with Session(Store(tmp_path / "store")) as session:
        digest = execute(graph(session), session)["second"]["out"]
        object_file(session.store, digest).unlink()
    with Session(Store(tmp_path / "store")) as session:
        told = explain(graph(session), session, "second")
        assert str(told.changes[0]) == "output out is missing or corrupt in the store"
        assert execute(graph(session), session)["second"].reason == str(told.changes[0])


@pytest.mark.parametrize(
    "text",
    [
        "", "{", "[]", '{"format": 1}', '{"format": 1, "build": "x"}',
        *(
            f'{{"format": {JOURNAL_FORMAT}, "build": "x", "steps": {{"first": {noted}}}}}'
            for noted in ("5", '{"seconds": "long"}', '{"seconds": NaN}', '{"parts": [1]}',
                          '{"why": 7}', '{"why": [{"cause": "x"}]}', '{"at": 3}')
        ),
    ],
)  # fmt: skip
def test_an_unreadable_journal_counts_as_empty(tmp_path, text):
    with Session(Store(tmp_path / "store"), build="x") as session:
        execute(graph(session), session)
    (path,) = (tmp_path / "store" / "v1" / "journal").iterdir()
    path.write_bytes(zlib.compress(text.encode()) if text else b"")
    with Session(Store(tmp_path / "store"), build="x") as session:
        assert execute(graph(session, 4), session)["first"].reason == "first build"


def test_another_step_under_the_same_label_is_named(session):
    together(session, {"it": Write()})
    planner = Planner(session)
    planner.add("it", MixInChild())
    changes = explain(planner.graph(), session, "it").changes
    assert str(changes[0]) == "step: steps_for_tests:Write -> steps_for_tests:MixInChild"


def again(graph: Graph, session: Session, results, keep: Path, **options):
    with Processes(session) as runner:
        return run_again(graph, session, results, runner, keep, **options)


def test_every_step_runs_a_second_time_on_the_inputs_of_the_first(session, tmp_path, source):
    log = tmp_path / "log"
    planner = Planner(session)
    split = planner.add("split", Split(), {"in": planner.source(source)})
    a = planner.add("a", Count(log=str(log), name="a"), {"in": split["names.json"]})
    planner.add("b", Count(log=str(log), name="b"), {"in": a["out"]})
    planner.add("tree", Mix(), {"t/": split["parts/"]})
    graph = planner.graph()
    results = execute(graph, session)
    assert again(graph, session, results, tmp_path / "keep", jobs=1) == ()
    ran = log.read_text().split()
    assert ran[:2] == ["a", "b"]
    assert sorted(ran[2:]) == ["a", "b"], "in any order: no step waits for another one's second run"


def test_the_step_and_the_file_that_differ_are_named_and_none_after_it(session, tmp_path):
    planner = Planner(session)
    bad = planner.add("bad", Irreproducible())
    planner.add("reader", Mix(), {"t/": bad["parts/"]})
    graph = planner.graph()
    results = execute(graph, session)
    before = session.store.action(results["bad"].key)
    (found,) = again(graph, session, results, tmp_path / "keep")
    assert (found.label, found.file) == ("bad", "parts/clock")
    assert "step `bad`: `parts/clock` differs" in str(found)
    versions = [tmp_path / "keep/bad" / n / "parts/clock" for n in ("first", "second")]
    assert len({path.read_text() for path in versions}) == 2
    assert session.store.action(results["bad"].key) == before  # the store keeps the first


def test_each_of_the_joined_builds_has_its_own_journal(tmp_path: Path):
    builds = {"left": "l.yaml", "right": "r.yaml"}
    with Session(Store(tmp_path / "store"), builds=builds) as session:
        execute(joined(dict.fromkeys(builds, graph(session))), session, jobs=1)
    for build in builds.values():
        with Session(Store(tmp_path / "store"), build=build) as session:
            told = explain(graph(session, 7), session, "first")
            assert "field salt: 0 -> 7" in told.to_text()
