"""The page: well formed, self-contained, verdict first, worst first, waivers visible."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser

import pytest

from assetbuild.findings import Finding
from assetbuild.recipe.models import Waiver
from assetbuild.report.document import make_report
from assetbuild.report.figures import figures_of, sentence, tables_of
from assetbuild.report.html import View, html_page
from assetbuild.report.verdict import CheckResult
from assetbuild.robot.identify import Fit, LogUsed, Parameter, Prediction

from .robots_for_tests import subject

NASTY = Finding("urdf.dropped", "warning", "link <script>alert(1)</script>", "a & b", "mend it")
VIEW = View('{"meshes":{},"shapes":[],"span_m":0.03}', "/* three */")
PICTURE = b"\x89PNG"


def page(findings=(NASTY,), checks=None, waivers=None, view=VIEW, hero=PICTURE):
    report = make_report("<b>r</b>", list(findings), checks or {}, waivers or {}, lambda _: "a:1")
    return html_page(report, subject(), hero, view)


def test_the_page_is_well_formed_and_escapes_names():
    seen = Tags()
    seen.feed(page(checks={"c": CheckResult("pass", {"x": 1.5})}))
    assert not seen.open_now
    assert "<script>alert" not in page()
    assert "<b>r</b>" not in page()


def test_nothing_is_fetched_from_anywhere():
    links = re.findall(r'(?:src|href)="([^"]+)"', page())
    assert links
    assert all(link.startswith(("#", "data:")) for link in links)
    assert "@import" not in page() and "url(" not in page()


def test_the_head_says_how_each_part_of_the_verdict_was_judged():
    stood = {"outcome": "stands", "sentence": "stands for 2 s"}
    checks = {"stand": CheckResult("pass", {"stood": stood}), "oracle": CheckResult("skip")}
    head = page(checks=checks).partition('id="findings"')[0]
    assert "<dt>formats</dt><dd>agree: no equality check found a difference</dd>" in head
    assert "<dt>physics</dt><dd>stands for 2 s</dd>" in head
    assert "<dt>checks</dt><dd>not run: <code>oracle</code></dd>" in head


def test_the_verdict_comes_before_the_findings_and_they_before_the_card():
    text = page()
    order = [text.index(f) for f in ("Ready for training", 'id="findings"', 'id="card"')]
    assert order == sorted(order)


def test_a_finding_shows_rule_place_numbers_fix_and_how_to_waive_it():
    finding = Finding("inertia.radius", "warning", "link a", "0.6 m", "check", data={"r_m": 0.6})
    text = page([finding])
    for told in ("inertia.radius", "a:1", "r_m", "To do:</b> check", "rules: {inertia.radius:"):
        assert told in text


def test_a_rule_that_speaks_of_many_is_one_box_with_a_count():
    many = [Finding("gains.sag", "warning", f"actuator j{n}", f"by {n} rad") for n in range(5)]
    text = page(many)
    assert "5 findings" in text
    assert "2 more of <code>gains.sag</code>: actuator j3, actuator j4" in text
    assert all(f"by {n} rad" in text for n in range(5))


def test_a_waived_finding_stays_in_the_open_with_its_reason():
    waiver = Waiver(severity="info", because="carbon tube")
    text = page([NASTY], waivers={"urdf.dropped": waiver})
    assert "Waived by the recipe (1)" in text
    assert "Waived, was warning: carbon tube" in text


def test_rows_maps_and_lists_of_numbers_become_tables_with_the_name_first():
    rows = [{"gap_m": 0.1, "link": "a"}, {"gap_m": 0.2, "link": "b", "more": 1}]
    (shown,) = tables_of("per_link", rows)
    assert shown.head == ("link", "gap, m", "more")
    assert shown.rows == (("a", 0.1, None), ("b", 0.2, 1))
    (by_name,) = tables_of("load", {"hip": {"nm": 1.0}, "knee": {"nm": 2.0}})
    assert by_name.rows == (("hip", 1.0), ("knee", 2.0))
    (pairs,) = tables_of("overlaps", [["a", "b", 0.1], ["c", "d", 0.2]])
    assert pairs.rows[1] == ("c", "d", 0.2)


def test_a_failed_check_is_open_and_a_passed_one_closed():
    assert '<details class="check" open>' in page(checks={"x": CheckResult("fail", {"a": 1})})
    assert '<details class="check">' in page(checks={"x": CheckResult("pass", {"a": 1})})


def test_the_first_screen_has_the_hero_and_the_lines_that_load_the_bundle():
    text = page()
    head = unescape(text.partition('id="findings"')[0])
    for shown in ('class="hero"', 'from_xml_path("build/tiny/mjcf/scene.xml")', "What to do next"):
        assert shown in head, shown
    assert text.count("data:image/png") == 1, "the hero is shown once"


MASS = {"total_kg": 13.100529, "datasheet_kg": None, "bodies": [{}, {}]}


@pytest.mark.parametrize(
    ("check", "figures", "said"),
    [
        ("oracle", {"kinematics_error": 1.10576e-15, "gravity_error": 0.0, "poses": 50},
         "in 50 poses: largest relative error 1.1e-15, limit 1e-9"),
        ("usd_equal", {"facts": 2560, "differ": 0}, "2,560 values of the USD match the robot"),
        ("mass", MASS, "13.1 kg in 2 bodies"),
        ("own", {"gap_m": 0.123456}, "gap 0.1235 m"),
        ("coverage", {"bodies": [{"body": "trunk", "sticks_out_mm": 11.0}]},
         "geometry of 1 body compared"),
        ("physx_slope", {"usd": {"speed_m_s": 0.0005}},
         "usd: creeps at 0.5 mm/s below the angle of friction"),
        ("smoke_mjlab", {"fell": 0, "summary": "0 of 8 robots fell"}, "0 of 8 robots fell"),
    ],
)  # fmt: skip
def test_each_check_is_a_sentence_with_its_number_and_limit(check, figures, said):
    """Also one that runs in another simulator, and a trainer's."""
    result = CheckResult("pass", figures)
    assert sentence(check, result).endswith(said)
    assert said in page(checks={check: result})


def test_a_figure_that_nobody_stated_is_not_shown():
    assert "datasheet" not in str(list(figures_of("mass", CheckResult("pass", MASS))))


class Tags(HTMLParser):
    """Collects tags and checks that they close in order."""

    def __init__(self):
        super().__init__()
        self.open_now: list[str] = []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "br", "img", "link", "input"):
            self.open_now.append(tag)

    def handle_endtag(self, tag):
        assert self.open_now.pop() == tag


def test_what_was_identified_stands_in_tables_with_what_was_refused():
    fit = Fit(
        logs=(LogUsed("log.csv", "0" * 64, 10.0, 3.0, 100.0),),
        parameters=(
            Parameter("armature", ("knee",), 0.01, 0.009, 0.011),
            Parameter("friction", ("knee",), 0.1, -1.0, 1.0, refused="the logs do not show it"),
        ),
        predictions=(Prediction("knee", 0.001, 0.02, 0.002),),
    )
    shown = replace(subject(), fits=(fit,))
    text = html_page(make_report("tiny", [], {}, {}, lambda _: ""), shown, None, None)
    for told in ("1 of 2 parameters are identified", "the logs do not show it", "log.csv"):
        assert told in text
