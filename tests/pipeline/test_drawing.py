"""The graph as text and as data of other tools; what a change reaches; what takes longest."""

from __future__ import annotations

import io
from pathlib import Path

import networkx
import pytest
from engine.steps_for_tests import Mix

from assetbuild.engine.planner import Planner
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store
from assetbuild.looks.lighten import Lighten
from assetbuild.pipeline import drawing

SECONDS = {"convert": 2.0, "thin": 5.0, "hulls": 1.0, "urdf": 4.0}


@pytest.fixture
def session(tmp_path: Path):
    with Session(Store(tmp_path / "store")) as session:
        yield session


@pytest.fixture
def net(session: Session, tmp_path: Path):
    """robot -> convert -> thin | hulls -> urdf, and a step on its own."""
    source = tmp_path / "source.txt"
    source.touch()
    planner = Planner(session)
    convert = planner.add("convert", Mix(), {"in": planner.source(source)})
    thin = planner.add("thin", Mix(salt=1), {"in": convert["out"], "again": convert["out"]})
    hulls = planner.add("hulls", Mix(salt=2), {"in": convert["out"]})
    planner.add("urdf", Mix(salt=3), {"a": thin["out"], "b": hulls["out"]})
    planner.add("alone <&>", Mix(salt=4))
    return drawing.network(planner.graph(), SECONDS)


def test_a_change_reaches_what_reads_it_and_nothing_beside(net):
    assert drawing.behind(net, ["thin"]) == {"thin", "urdf"}
    assert drawing.behind(net, ["convert"]) == SECONDS.keys()
    assert drawing.behind(net, ["urdf", "hulls"]) == {"urdf", "hulls"}


def test_the_critical_path_is_the_chain_that_takes_longest(net):
    assert drawing.critical_path(net) == ["convert", "thin", "urdf"]
    net.nodes["alone <&>"]["seconds"] = 12.0
    assert drawing.critical_path(net) == ["alone <&>"]


def test_an_empty_graph_has_no_critical_path(session):
    net = drawing.network(Planner(session).graph(), {})
    assert drawing.critical_path(net) == []


def test_the_text_names_each_step_below_its_room(net, session, tmp_path):
    planner = Planner(session)
    planner.add("mixed", Mix())
    planner.add("light", Lighten())
    planner.add("mixed again", Mix(salt=1))
    assert drawing.to_text(planner.graph()).splitlines() == [
        f"{Mix.__module__.partition('.')[0]}: 2 steps",
        "  mixed",
        "  mixed again",
        "looks: 1 step",
        "  light",
    ]


def test_graphml_is_read_back_with_every_input(net):
    text = drawing.to_graphml(net, ["thin"])
    again = networkx.read_graphml(io.BytesIO(text.encode()), force_multigraph=True)
    assert set(again) == set(net)
    assert sorted(name for *_, name in again.edges(data="input")) == sorted(
        name for *_, name in net.edges(data="input")
    )
    assert [label for label, marked in again.nodes(data="marked") if marked] == ["thin"]
    assert again.nodes["thin"]["seconds"] == 5.0


def test_dot_fills_what_is_marked(net):
    text = drawing.to_dot(net, ["thin"])
    assert f'"thin" [style=filled, fillcolor="{drawing.MARKED}"];' in text
    assert '"source.txt" [shape=box];' in text
