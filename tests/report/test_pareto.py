"""Which levels no other beats, and that the plot shows them."""

from __future__ import annotations

from xml.etree import ElementTree

from assetbuild.report.pareto import front, pareto_svg

POINTS = {
    "hull": (40_000.0, 0.5),
    "good": (20_000.0, 0.9),
    "bad": (15_000.0, 0.8),
    "a<b": (5e3, 0.9),
}


def test_what_another_beats_in_both_is_not_on_the_front():
    assert front(POINTS) == {"hull", "good"}
    assert front({"a": (1.0, 1.0), "b": (1.0, 1.0)}) == {"a", "b"}


def test_the_plot_names_every_level_and_marks_the_front():
    root = ElementTree.fromstring(pareto_svg("go1", POINTS))  # noqa: S314 # our own text
    texts = {e.text: e.get("font-weight") for e in root.iter() if e.tag.endswith("text")}
    assert {name for name in POINTS if texts.get(name) == "bold"} == {"hull", "good"}
    assert set(POINTS) <= set(texts)
    assert len([e for e in root.iter() if e.tag.endswith("circle")]) == len(POINTS)
