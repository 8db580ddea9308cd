"""The shared cache: two stores and one server, and servers that misbehave (F23, F24)."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest
from builds_for_tests import Machine
from servers_for_tests import CacheServer, serving

from assetbuild.engine.make import NodeResult
from assetbuild.engine.share.remote import Budget, Remote
from assetbuild.engine.store import Store
from assetbuild.errors import UsageError

QUICK = Budget(request_s=0.5, lost_s=1.0, object_bytes=1 << 20)


@pytest.fixture
def server():
    with serving() as server:
        yield server


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    source = tmp_path / "robot"
    source.write_text("one 1\ntwo 2\n")
    return source


def outputs(results: dict[str, NodeResult]) -> list[object]:
    return [result.outputs for result in results.values()]


@pytest.fixture
def gold(tmp_path: Path, robot: Path) -> list[object]:
    return outputs(Machine(tmp_path / "gold").build(robot))


def test_the_second_machine_builds_nothing(tmp_path, robot, server, gold):
    first = Machine(tmp_path / "a", server.url, write=True).build(robot)
    second = Machine(tmp_path / "b", server.url)
    results = second.build(robot)
    assert [r.status for r in first.values()] == ["ran"] * 3
    assert [r.status for r in results.values()] == ["cached"] * 3
    assert outputs(results) == gold
    assert [r.findings for r in results.values()] == [r.findings for r in first.values()]
    assert second.warnings == []
    again = Machine(tmp_path / "b", server.url)
    asked = len(server.asked)
    assert [r.status for r in again.build(robot).values()] == ["cached"] * 3
    assert len(server.asked) == asked  # what is here is not asked for


def test_nothing_is_written_unless_asked_for(tmp_path, robot, server):
    Machine(tmp_path / "a", server.url).build(robot)
    assert server.files == {}
    assert {verb for verb, _ in server.asked} == {"GET"}


def test_an_object_is_sent_once(tmp_path, robot, server):
    Machine(tmp_path / "a", server.url, write=True).build(robot)
    server.files = {k: v for k, v in server.files.items() if k.startswith("/cas")}
    server.asked.clear()
    Machine(tmp_path / "b", server.url, write=True).build(robot)
    assert not [path for verb, path in server.asked if verb == "PUT" and "/cas/" in path]


FAULTS = (
    "500", "wrong_bytes", "short", "huge_length", "endless", "slow", "slow_headers", "redirect",
    "redirect_to_file", "garbage", "hang_up", "cas_500", "cas_wrong_bytes", "cas_short",
    "cas_huge_length", "cas_endless", "cas_slow", "cas_redirect", "cas_hang_up",
)  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_server_that_misbehaves_costs_a_bounded_time_and_one_warning(
    tmp_path, robot, server, gold, fault
):
    Machine(tmp_path / "a", server.url, write=True).build(robot)
    with serving() as elsewhere:
        elsewhere.files = server.files
        server.fault, server.elsewhere = fault, elsewhere.url
        url = server.url.replace("//", "//user:secret@")
        second = Machine(tmp_path / "b", url, budget=QUICK)
        results = second.build(robot)
        assert elsewhere.asked == []
    assert outputs(results) == gold
    assert "ran" in [r.status for r in results.values()]
    assert len(second.warnings) == 1
    assert "shared cache http://127.0.0.1" in second.warnings[0]
    assert "secret" not in second.warnings[0]
    assert second.seconds < 15  # the slow ones would take a minute and more
    store = Store(tmp_path / "b")
    for path in store.root.glob("cas/*/*"):
        assert store.path(path.name)  # nothing corrupt came in
    store.close()


def test_a_server_that_is_not_there_is_one_warning(tmp_path, robot, server, gold):
    machine = Machine(tmp_path / "a", "http://127.0.0.1:9")
    assert outputs(machine.build(robot)) == gold
    assert len(machine.warnings) == 1


def test_a_server_that_never_shakes_hands_costs_a_bounded_time(tmp_path, robot, gold):
    with socket.create_server(("127.0.0.1", 0)) as silent:  # connects, and never says a word
        url = f"https://127.0.0.1:{silent.getsockname()[1]}"
        machine = Machine(tmp_path / "a", url, budget=QUICK)
        assert outputs(machine.build(robot)) == gold
    assert len(machine.warnings) == 1
    assert machine.seconds < 15


def test_errors_while_writing_cost_nothing_but_a_warning(tmp_path, robot, server, gold):
    server.fault = "500"
    machine = Machine(tmp_path / "a", server.url, write=True)
    assert outputs(machine.build(robot)) == gold
    assert len(machine.warnings) == 1


def poison(server: CacheServer, *, drop_signature: bool) -> None:
    """Entries whose objects are all there, but of another step."""
    names = [name for name in server.files if name.startswith("/ac/")]
    entries = [json.loads(server.files[name]) for name in names]
    mixes = [e for e in entries if list(e["result"]["outputs"]) == ["out"]]
    mixes[0]["result"], mixes[1]["result"] = mixes[1]["result"], mixes[0]["result"]
    mixes[0]["objects"], mixes[1]["objects"] = mixes[1]["objects"], mixes[0]["objects"]
    for name, entry in zip(names, entries, strict=True):
        if drop_signature:
            entry.pop("signature")
        server.files[name] = json.dumps(entry).encode()


@pytest.mark.parametrize("drop_signature", [True, False])
def test_with_a_key_a_poisoned_entry_is_a_miss(tmp_path, robot, server, gold, drop_signature):
    Machine(tmp_path / "a", server.url, write=True, key="k").build(robot)
    poison(server, drop_signature=drop_signature)
    machine = Machine(tmp_path / "b", server.url, key="k")
    assert outputs(machine.build(robot)) == gold
    assert "not signed with our key" in machine.warnings[0]


def test_signed_entries_of_the_same_key_are_taken_and_of_another_refused(tmp_path, robot, server):
    Machine(tmp_path / "a", server.url, write=True, key="k").build(robot)
    same = Machine(tmp_path / "b", server.url, key="k").build(robot)
    assert {r.status for r in same.values()} == {"cached"}
    other = Machine(tmp_path / "c", server.url, key="other").build(robot)
    assert {r.status for r in other.values()} == {"ran"}


def test_an_entry_under_another_key_is_a_miss(tmp_path, robot, server, gold):
    Machine(tmp_path / "a", server.url, write=True, key="k").build(robot)
    names = sorted(name for name in server.files if name.startswith("/ac/"))
    server.files[names[0]], server.files[names[1]] = server.files[names[1]], server.files[names[0]]
    assert outputs(Machine(tmp_path / "b", server.url, key="k").build(robot)) == gold


def test_a_result_over_the_size_budget_is_not_fetched(tmp_path, robot, server, gold):
    Machine(tmp_path / "a", server.url, write=True).build(robot)
    small = Budget(request_s=1, lost_s=5, object_bytes=3)
    machine = Machine(tmp_path / "b", server.url, budget=small)
    server.asked.clear()
    assert outputs(machine.build(robot)) == gold
    assert not [path for _, path in server.asked if path.startswith("/cas/")]


def test_credentials_go_to_the_named_server(tmp_path, robot, server):
    url = server.url.replace("//", "//user:p%40ss@")
    Machine(tmp_path / "a", url).build(robot)
    assert server.headers_seen[0]["Authorization"] == "Basic dXNlcjpwQHNz"


@pytest.mark.parametrize("url", ["file:///etc", "ftp://host", "host:80", "http://"])
def test_only_http_is_a_remote(url):
    with pytest.raises(UsageError, match="HTTP cache"):
        Remote(url)
