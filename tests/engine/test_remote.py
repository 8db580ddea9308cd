"""The shared cache: two stores and one server, and servers that misbehave (F23, F24)."""

from __future__ import annotations

import json
import socket
from collections import Counter
from pathlib import Path

import pytest
from builds_for_tests import Machine, assert_second_machine_builds_nothing
from servers_for_tests import CacheServer, serving

from assetbuild.engine.make import NodeResult
from assetbuild.engine.share.remote import Budget, Remote
from assetbuild.engine.store import Store
from assetbuild.errors import UsageError

QUICK = Budget(request_s=0.3, lost_s=0.6, object_bytes=1 << 20)


def outputs(results: dict[str, NodeResult]) -> list[object]:
    return [result.outputs for result in results.values()]


@pytest.fixture(scope="module")
def gold(tmp_path_factory: pytest.TempPathFactory, robot: Path) -> list[object]:
    return outputs(Machine(tmp_path_factory.mktemp("gold")).build(robot))


@pytest.fixture(scope="module")
def sent(tmp_path_factory: pytest.TempPathFactory, robot: Path) -> dict[str, dict[str, bytes]]:
    """What a first machine sends: without a key, with one, and of a wide graph."""
    found: dict[str, dict[str, bytes]] = {}
    for name, width, options in (("plain", 0, {}), ("signed", 0, {"key": "k"}), ("wide", 12, {})):
        with serving() as server:
            folder = tmp_path_factory.mktemp(name)
            Machine(folder, server.url, write=True, **options).build(robot, width=width)
            found[name] = dict(server.files)
    return found


@pytest.fixture
def stocked(server: CacheServer, sent: dict[str, dict[str, bytes]]) -> CacheServer:
    """A server that holds what a first machine sent."""
    server.files = dict(sent["plain"])
    return server


def test_the_second_machine_builds_nothing(tmp_path, robot, server):
    assert_second_machine_builds_nothing(tmp_path, robot, server.url)
    asked = len(server.asked)
    Machine(tmp_path / "b", server.url, key="k").build(robot, width=12)
    assert len(server.asked) == asked  # what is here is not asked for
    other = Machine(tmp_path / "c", server.url, key="other").build(robot, width=12)
    assert {r.status for r in other.values()} == {"ran"}
    assert server.connections <= 4 * 3  # in each build: two places, and the thread that plans


def test_nothing_is_written_unless_asked_for(tmp_path, robot, server):
    Machine(tmp_path / "a", server.url).build(robot)
    assert server.files == {}
    assert {verb for verb, _ in server.asked} == {"GET"}


def test_an_object_is_sent_once(tmp_path, robot, server, sent):
    server.files = {k: v for k, v in sent["plain"].items() if k.startswith("/cas")}
    Machine(tmp_path / "b", server.url, write=True).build(robot)
    assert not [path for verb, path in server.asked if verb == "PUT" and "/cas/" in path]


FAULTS = (
    "500", "wrong_bytes", "short", "huge_length", "endless", "slow", "slow_headers", "redirect",
    "garbage", "hang_up", "cas_wrong_bytes", "cas_endless",
)  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_server_that_misbehaves_costs_a_bounded_time_and_one_warning(
    tmp_path, robot, stocked, gold, fault
):
    server = stocked
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


@pytest.mark.parametrize("how", ["nobody answers", "writing fails", "no word after connecting"])
def test_a_server_that_is_not_there_is_one_warning(tmp_path, robot, server, gold, how):
    server.fault = "500"
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = {
            "nobody answers": "http://127.0.0.1:9",
            "writing fails": server.url,
            "no word after connecting": f"https://127.0.0.1:{silent.getsockname()[1]}",
        }[how]
        machine = Machine(tmp_path / "a", url, write=True, budget=QUICK)
        assert outputs(machine.build(robot)) == gold
    assert len(machine.warnings) == 1
    assert machine.seconds < 15


def exchange(server: CacheServer, how: str) -> None:
    """Entries whose objects are all there, but of another step."""
    names = sorted(name for name in server.files if name.startswith("/ac/"))
    if how == "whole entries":
        first, second, *_ = names
        server.files[first], server.files[second] = server.files[second], server.files[first]
        return
    entries = [json.loads(server.files[name]) for name in names]
    one, other, *_ = (e for e in entries if list(e["result"]["outputs"]) == ["out"])
    for part in ("result", "objects"):
        one[part], other[part] = other[part], one[part]
    for name, entry in zip(names, entries, strict=True):
        if how == "results, without a signature":
            entry.pop("signature")
        server.files[name] = json.dumps(entry).encode()


@pytest.mark.parametrize("how", ["results", "results, without a signature", "whole entries"])
def test_with_a_key_a_poisoned_entry_is_a_miss(tmp_path, robot, server, sent, gold, how):
    server.files = dict(sent["signed"])
    exchange(server, how)
    machine = Machine(tmp_path / "b", server.url, key="k")
    assert outputs(machine.build(robot)) == gold
    if how != "whole entries":
        assert "not signed with our key" in machine.warnings[0]


def test_a_result_over_the_size_budget_is_not_fetched(tmp_path, robot, stocked, gold):
    small = Budget(request_s=1, lost_s=5, object_bytes=3)
    machine = Machine(tmp_path / "b", stocked.url, budget=small)
    assert outputs(machine.build(robot)) == gold
    assert not [path for _, path in stocked.asked if path.startswith("/cas/")]


def dangle(server: CacheServer, count: int, how: str) -> None:
    """Entries stay, the objects that they name do not, or not as they were."""
    for name in sorted(name for name in server.files if name.startswith("/cas/"))[:count]:
        body = server.files.pop(name)
        if how != "gone":
            changed = body[:-1] if how == "cut" else bytes([body[0] ^ 1]) + body[1:]
            server.files[name] = changed


@pytest.mark.parametrize("how", ["gone", "cut", "wrong"])
def test_what_the_cache_has_lost_is_a_miss_and_sent_again(tmp_path, robot, server, sent, how):
    server.files = dict(sent["wide"])
    dangle(server, 8, how)
    second = Machine(tmp_path / "b", server.url, write=True, budget=Budget(errors=10))
    results = second.build(robot, width=12)
    assert Counter(result.status for result in results.values())["ran"] <= 8
    assert len(second.warnings) == (how == "wrong")
    results = Machine(tmp_path / "c", server.url).build(robot, width=12)
    assert {result.status for result in results.values()} == {"cached"}


def test_a_server_may_close_a_connection_that_was_kept(tmp_path, robot, server, gold):
    server.fault = "forgets_connections"
    machine = Machine(tmp_path / "a", server.url, write=True)
    assert outputs(machine.build(robot)) == gold
    assert machine.warnings == []


BASIC = "Basic dXNlcjp4"


@pytest.mark.parametrize(
    ("user", "token", "host", "sent"),
    [
        ("", "abc", "", "Bearer abc"),
        ("user:x@", "abc", "", BASIC),
        ("", "", "127.0.0.1", BASIC),
        ("", "", "other.example.org", None),
    ],
    ids=["a token", "the address", "netrc", "netrc of another host"],
)
def test_credentials_are_sent_to_their_host(
    tmp_path, robot, server, monkeypatch, user, token, host, sent
):
    file = tmp_path / "netrc"
    file.write_text(f"machine {host} login user password x\n" if host else "")
    file.chmod(0o600)
    monkeypatch.setenv("NETRC", str(file))
    monkeypatch.setenv("ASSETBUILD_REMOTE_TOKEN", token)
    Machine(tmp_path / "a", server.url.replace("//", f"//{user}")).build(robot)
    assert {seen.get("Authorization") for seen in server.headers_seen} == {sent}


def test_the_proxy_of_the_environment_is_used(tmp_path, robot, server, monkeypatch):
    monkeypatch.setenv("http_proxy", server.url.replace("//", "//me:secret@"))
    machine = Machine(tmp_path / "a", "http://cache.invalid/prefix", write=True)
    machine.build(robot)
    assert machine.warnings == []
    assert {path.rpartition("/")[0] for _, path in server.asked} == {
        "http://cache.invalid/prefix/ac",
        "http://cache.invalid/prefix/cas",
    }
    assert server.headers_seen[0]["proxy-authorization"] == "Basic bWU6c2VjcmV0"
    server.asked.clear()
    monkeypatch.setenv("no_proxy", "cache.invalid")
    Machine(tmp_path / "b", "http://cache.invalid/prefix", budget=QUICK).build(robot)
    assert server.asked == []


def test_a_proxy_tunnels_to_a_server_with_tls(tmp_path, robot, server, monkeypatch):
    monkeypatch.setenv("https_proxy", server.url)
    machine = Machine(tmp_path / "a", "https://cache.invalid", budget=QUICK)
    machine.build(robot)
    assert server.asked[0] == ("CONNECT", "cache.invalid:443")
    assert len(machine.warnings) == 1


@pytest.mark.parametrize(
    "url",
    ["file:///etc", "ftp://host", "host:80", "http://", "s3://", "s3://user:x@b", "s3://b:80/x",
     "gs://b"],
)  # fmt: skip
def test_an_address_that_is_none_is_refused(url):
    with pytest.raises(UsageError):
        Remote(url)


def test_a_proxy_of_an_unknown_kind_is_refused(monkeypatch):
    monkeypatch.setenv("https_proxy", "socks5://localhost:1")
    with pytest.raises(UsageError, match="a proxy of the kind `socks5`"):
        Remote("https://cache.invalid")
