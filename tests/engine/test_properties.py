"""Random graphs against an oracle that computes every node from scratch, without any cache."""

from __future__ import annotations

import hashlib
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from random_robots import examples
from steps_for_tests import Mix

from assetbuild.engine.graph import Node, Ref
from assetbuild.engine.planner import Planner, settle
from assetbuild.engine.session import Session
from assetbuild.engine.store import LostObjectError, Store

SOURCES = 3


@dataclass(frozen=True)
class Spec:
    """One node: reads sources and earlier nodes; few `keep` digits make equal outputs likely.

    asks: the plan asks for this node's content and adds as many nodes as its digits say.
    """

    salt: int
    keep: int
    sources: frozenset[int]
    nodes: frozenset[int]
    asks: bool


@st.composite
def graphs(draw: st.DrawFn) -> tuple[Spec, ...]:
    count = draw(st.integers(1, 7))
    return tuple(
        Spec(
            salt=draw(st.integers(0, 2)),
            keep=draw(st.sampled_from([0, 1, 16])),
            sources=draw(st.frozensets(st.integers(0, SOURCES - 1), max_size=2)),
            nodes=draw(st.frozensets(st.integers(0, index - 1), max_size=3))
            if index
            else frozenset(),
            asks=draw(st.integers(0, 3)) == 0,
        )
        for index in range(count)
    )


EDITS = st.lists(
    st.tuples(st.sampled_from(["source", "salt", "none"]), st.integers(0, 6), st.integers(0, 2)),
    min_size=1,
    max_size=3,
)


def added(content: str) -> int:
    """How many nodes an answer adds."""
    return len(content) and int(content[0], 16) % 3


# --- the oracle: contents by label, and the identity of every node's work


def mixed(salt: int, keep: int, inputs: dict[str, str]) -> str:
    text = [str(salt), *(f"{name}={inputs[name]}" for name in sorted(inputs))]
    return hashlib.sha256("\n".join(text).encode()).hexdigest()[:keep]


def from_scratch(specs: tuple[Spec, ...], sources: list[str]) -> tuple[dict[str, str], set[str]]:
    contents: dict[str, str] = {}
    works: set[str] = set()

    def work(label: str, salt: int, keep: int, inputs: dict[str, str]) -> None:
        contents[label] = mixed(salt, keep, inputs)
        works.add(repr((salt, keep, sorted(inputs.items()))))

    for index, spec in enumerate(specs):
        inputs = {f"s{i}": sources[i] for i in spec.sources}
        inputs |= {f"n{i}": contents[str(i)] for i in spec.nodes}
        work(str(index), spec.salt, spec.keep, inputs)
    for index, spec in enumerate(specs):
        if spec.asks:
            for extra in range(added(contents[str(index)])):
                work(f"{index}+{extra}", extra, 16, {"n": contents[str(index)]})
    return contents, works


# --- the engine


def plan(specs: tuple[Spec, ...], paths: list[Path], planner: Planner) -> None:
    nodes: list[Node] = []
    for index, spec in enumerate(specs):
        inputs: dict[str, Ref] = {f"s{i}": planner.source(paths[i]) for i in spec.sources}
        inputs |= {f"n{i}": nodes[i]["out"] for i in spec.nodes}
        nodes.append(planner.add(str(index), Mix(salt=spec.salt, keep=spec.keep), inputs))
    for index, spec in enumerate(specs):
        answer = planner.ask(nodes[index]["out"]) if spec.asks else None
        for extra in range(added(answer.decode()) if answer is not None else 0):
            planner.add(f"{index}+{extra}", Mix(salt=extra), {"n": nodes[index]["out"]})


def build(
    specs: tuple[Spec, ...], paths: list[Path], store: Path, jobs: int
) -> tuple[dict[str, str], list[str]]:
    """Contents by label, and the labels of the steps that ran."""
    with Session(Store(store)) as session:
        done = settle(lambda planner: plan(specs, paths, planner), session, jobs=jobs)
        assert done.whole
        ran = [label for label, result in done.results.items() if result.status == "ran"]
        return {k: session.read(r["out"]).decode() for k, r in done.results.items()}, ran


@pytest.mark.slow
@settings(
    max_examples=examples(40),
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    derandomize=True,
)
@given(specs=graphs(), edits=EDITS, jobs=st.integers(1, 3))
def test_a_build_is_right_and_runs_no_more_than_it_must(specs, edits, jobs):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sources = ["0"] * SOURCES
        paths = [folder / f"source{i}" for i in range(SOURCES)]
        done: set[str] = set()
        for kind, index, value in [("none", 0, 0), *edits]:
            if kind == "source":
                sources[index % SOURCES] = str(value)
            elif kind == "salt":
                place = index % len(specs)
                changed = replace(specs[place], salt=value)
                specs = (*specs[:place], changed, *specs[place + 1 :])
            for path, text in zip(paths, sources, strict=True):
                path.write_text(text)
            want, works = from_scratch(specs, sources)
            got, ran = build(specs, paths, folder / "store", jobs)
            assert got == want
            # Two nodes with the same work may run it both when they start together.
            assert len(works - done) <= len(ran)
            if jobs == 1:
                assert len(ran) == len(works - done)
            done |= works
            again, none = build(specs, paths, folder / "store", jobs)
            assert again == want
            assert none == []


@pytest.mark.slow
@settings(max_examples=examples(25), deadline=None, derandomize=True)
@given(
    specs=graphs(),
    victim=st.integers(0, 1000),
    fault=st.sampled_from(["flip", "cut", "delete", "swap", "forget"]),
)
def test_a_store_with_any_object_or_action_spoilt_heals(specs, victim, fault):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = [folder / f"source{i}" for i in range(SOURCES)]
        for path in paths:
            path.write_text("x")
        gold, _ = build(specs, paths, folder / "store", 1)
        where = "ac" if fault == "forget" else "cas"
        files = sorted(p for p in (folder / "store/v1" / where).rglob("*") if p.is_file())
        spoil(files, victim, fault)
        for _ in range(2):
            assert read_healing(specs, paths, folder / "store") == gold


def spoil(files: list[Path], victim: int, fault: str) -> None:
    path, other = files[victim % len(files)], files[(victim + 1) % len(files)]
    data = path.read_bytes()
    path.unlink()
    if fault == "flip" and data:
        path.write_bytes(bytes([data[0] ^ 1]) + data[1:])
    elif fault == "cut":
        path.write_bytes(data[:-1])
    elif fault == "swap" and other != path:
        path.write_bytes(other.read_bytes())
        other.unlink()
        other.write_bytes(data)


def read_healing(specs: tuple[Spec, ...], paths: list[Path], store: Path) -> dict[str, str]:
    """What the pipeline does: build, take the results out, and once more if one was lost."""
    for _ in range(len(specs) + 10):
        try:
            return build(specs, paths, store, 1)[0]
        except LostObjectError:
            continue
    raise AssertionError("it never heals")
