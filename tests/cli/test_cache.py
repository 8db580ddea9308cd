"""`assetbuild cache` as a user runs it: a store counted and cleaned, results shared by machines."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path

import pytest
from engine.servers_for_tests import serving

from assetbuild.cli.parser import size_of_text
from assetbuild.engine.store import Store

from .conftest import Place, new_legs


def test_stats_check_and_gc(tmp_path: Path):
    place = Place(tmp_path, tmp_path / "store")
    store = Store(tmp_path / "store")
    digest = store.put_bytes(b"x" * 3000)
    other = store.put_bytes(b"y" * 3000)
    store.close()
    found = json.loads(place.run("cache", "stats", "--json").stdout)
    assert (found["objects"], found["object_bytes"]) == (2, 6000)
    assert place.run("cache", "check").returncode == 0
    path = tmp_path / "store/v1/cas" / digest[:2] / digest
    path.chmod(0o644)
    path.write_bytes(b"x")
    done = place.run("cache", "check")
    assert done.returncode == 1
    assert f"corrupt, set aside: {digest}" in done.stdout
    assert (tmp_path / "store/v1/cas" / other[:2] / other).is_file()
    done = place.run("cache", "gc", "--max-size", "1kB")
    assert done.returncode == 0, done.stderr
    assert "1 objects removed" in done.stdout
    assert json.loads(place.run("cache", "stats", "--json").stdout)["total_bytes"] < 1000


def test_without_a_store_there_is_nothing_to_do(tmp_path: Path):
    for words in (("stats",), ("check",), ("gc", "--max-size", "1GB")):
        assert Place(tmp_path, tmp_path / "none").run("cache", *words).returncode == 0
    assert not (tmp_path / "none").exists()


def test_a_build_without_a_store_warns_once(legs: Place):
    (legs.folder / "file").touch()
    done = legs.build(ASSETBUILD_CACHE=str(legs.folder / "file/store"))
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("warning: cannot write to the store") == 1


def test_sizes_are_read_as_people_write_them():
    texts = ("5GB", "500 MB", "2GiB", "1000", "1.5k")
    assert [size_of_text(t) for t in texts] == [5 * 10**9, 5 * 10**8, 2 * 1024**3, 1000, 1500]
    for wrong in ("", "GB", "5XB", "-1"):
        with pytest.raises(argparse.ArgumentTypeError, match="must be a size"):
            size_of_text(wrong)


# -- two machines and one server


@pytest.fixture
def server():
    with serving() as server:
        yield server


def test_what_one_machine_pushed_another_pulls_and_builds_nothing(
    tmp_path: Path, warm_legs: Place, server
):
    first, second = warm_legs, new_legs(tmp_path / "b")
    assert first.build().returncode == 0
    assert server.asked == []
    sent = first.run("cache", "push", "legs.yaml", "--remote", server.url)
    assert (sent.returncode, sent.stderr) == (0, "")
    steps = len(first.steps())
    assert sent.stdout == f"legs.yaml: {steps} of {steps} results sent\n"
    came = second.run("cache", "pull", "legs.yaml", "--remote", server.url)
    assert (came.returncode, came.stderr) == (0, "")
    assert came.stdout == f"legs.yaml: {steps} of {steps} results in the store\n"
    assert second.build().returncode == 0
    assert set(second.steps().values()) == {"cached"}
    assert first.manifest() == second.manifest()


def test_a_server_that_fails_is_an_error_here(warm_legs: Place, server):
    warm_legs.build()
    server.fault = "500"
    sent = warm_legs.run("cache", "push", "legs.yaml", "--remote", server.url)
    assert sent.returncode == 1
    assert "cannot write the shared cache" in sent.stderr


def test_without_an_address_it_is_a_wrong_command(legs: Place):
    assert "give `--remote` or ASSETBUILD_REMOTE" in legs.refused("cache", "push", "legs.yaml")


@pytest.mark.slow
def test_samples_are_shared(tmp_path: Path, warm_legs: Place, server):
    ranges = '\nrandomize: {links: {".*": {density: [0.8, 1.2]}}}\n'
    words = ("sample", "legs.yaml", "-n", "1", "--judge", "20", "--remote", server.url)
    for machine, more in ((warm_legs, ["--cache-write"]), (new_legs(tmp_path / "b"), [])):
        machine.recipe.write_text(machine.recipe.read_text() + ranges)
        before = len(server.asked)
        done = machine.run(*words, *more)
        assert done.returncode == 0, done.stderr
        verbs = Counter(verb for verb, _ in server.asked[before:])
        assert verbs["PUT"] > 5 if more else set(verbs) == {"GET"}
    assert machine.run("sample", "legs.yaml", "--cache-write").returncode == 2
