"""Which levels no other beats, and that the plot shows them."""

from __future__ import annotations

from itertools import combinations
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


def test_no_name_covers_another_name_or_a_dot():
    # Ten levels of a real robot lie like this: some on top of each other.
    crowd = {
        "recipe": (31_000.0, 0.72), "mesh": (30_000.0, 0.66), "hull": (30_000.0, 0.66),
        "hull64": (42_000.0, 0.65), "vhacd8": (23_600.0, 0.82), "vhacd32": (17_500.0, 0.86),
        "coacd8": (24_200.0, 0.80), "coacd16": (23_500.0, 0.82), "auto": (24_100.0, 0.83),
        "primitive": (62_000.0, 0.60),
    }  # fmt: skip
    root = ElementTree.fromstring(pareto_svg("go1", crowd))  # noqa: S314 # our own text
    names = {
        e.text: (float(e.get("x")), float(e.get("y")))
        for e in root.iter()
        if e.tag.endswith("text") and e.text in crowd
    }
    half = {name: 3.2 * len(name) for name in names}  # a letter of 12 pixels is about 6.4 wide
    assert set(names) == set(crowd)
    for (a, (x, y)), (b, (u, v)) in combinations(names.items(), 2):
        assert abs(x - u) >= half[a] + half[b] or abs(y - v) >= 11, (a, b)
    for dot in (e for e in root.iter() if e.tag.endswith("circle")):
        u, v = float(dot.get("cx")), float(dot.get("cy"))
        for name, (x, y) in names.items():
            assert abs(x - u) >= half[name] or not y - 9 < v < y, name
