"""`cache push` and `cache pull`: two machines and one server, nothing built on the second."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from engine.servers_for_tests import serving

from .conftest import Place, new_legs


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
