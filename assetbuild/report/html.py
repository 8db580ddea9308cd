"""`report/index.html`: one self-contained page, readable in a minute."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import groupby
from pathlib import Path

from assetbuild import __version__
from assetbuild.findings import SEVERITIES, Finding, is_consequence
from assetbuild.report.card import card_tables
from assetbuild.report.document import CheckResult, Report
from assetbuild.report.facts import Subject
from assetbuild.report.figures import check_section
from assetbuild.report.tables import html_table, text_of
from assetbuild.report.view import view_data
from assetbuild.robot.inertia import total_mass

SHOWN_OF_A_RULE = 2
ASSETS = Path(__file__).parent / "assets"
GROUPS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("equality", "The same robot in every format",
     ("oracle", "urdf_reload", "mjcf_equal", "mjcf_source", "mjcf_compiles",
      "usd_equal", "usd_valid", "counts")),
    ("alignment", "Simulators agree", ("alignment", "physx", "free_fall")),
    ("gains", "Drives and their effect", ("gains", "stand", "trials")),
    ("collision", "Collision quality", ("coverage", "collision")),
)  # fmt: skip
"""Anchor, title and the beginnings of the checks' names; all others come last."""


@dataclass(frozen=True)
class Picture:
    """A PNG with its title and what there is to see in it."""

    title: str
    alt: str
    png: bytes


@dataclass(frozen=True)
class View:
    """The 3D view: geometry as JSON, and the text of three.js; empty = none."""

    geometry: str
    library: str


def html_page(
    report: Report, subject: Subject, pictures: Sequence[Picture], view: View | None
) -> str:
    """The whole page; nothing in it is fetched from anywhere."""
    sections = [
        ("findings", f"Findings ({len(report.findings)})", _findings(report.findings)),
        ("view", "3D view", _view(subject, view)),
        ("pictures", "Pictures", _pictures(pictures)),
        *_checks(report.checks),
        ("card", "Model card", _card(subject, report)),
        ("provenance", "Provenance", _provenance(subject)),
    ]
    shown = [section for section in sections if section[2]]
    toc = "".join(f'<li><a href="#{key}">{escape(title)}</a></li>' for key, title, _ in shown)
    body = "".join(
        f'<section aria-labelledby="{key}"><h2 id="{key}">{escape(title)}</h2>{content}</section>'
        for key, title, content in shown
    )
    name = escape(report.robot)
    return "\n".join(
        (
            "<!doctype html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<link rel="icon" href="data:,">',
            f"<title>{name}: report</title><style>{_asset('page.css')}</style></head>",
            '<body><a class="skip-link" href="#main">Skip to the report</a>',
            f'<header class="top"><h1>{name}</h1>{_verdict(report)}{_tiles(report, subject)}'
            "</header>",
            f'<nav class="toc" aria-label="Sections"><ul>{toc}</ul></nav>',
            f'<main id="main" tabindex="-1">{body}</main>',
            _scripts(subject, view),
            "</body></html>",
            "",
        )
    )


def _asset(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _verdict(report: Report) -> str:
    verdict = report.verdict
    kind = "ready" if verdict.ready else "error"
    answer = "yes" if verdict.ready else "no"
    blocked = ", ".join(f"<code>{escape(rule)}</code>" for rule in verdict.blocked_by)
    parts = [f"<strong>Ready for training: {answer}</strong>"]
    if blocked:
        parts.append(f"<p>Blocked by {blocked}</p>")
    parts.append(f"<p>Next: {_prose(verdict.next_step)}</p>")
    return f'<div class="verdict {kind}" role="status">{"".join(parts)}</div>'


def _prose(text: str) -> str:
    """A sentence whose backticks become code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def _tiles(report: Report, subject: Subject) -> str:
    states = [check.status for check in report.checks.values()]
    severities = [finding.severity for finding in report.findings]
    counts = ", ".join(f"{severities.count(s)} {s}" for s in SEVERITIES if s in severities)
    shapes = len(subject.shapes.of("collision"))
    facts = (
        (f"{total_mass(subject.tree):.4g} kg", "total mass"),
        (str(len(subject.tree.moving_joints)), "moving joints"),
        (str(len(subject.tree.bodies)), "bodies"),
        (str(shapes), "collision shapes"),
        (f"{states.count('pass')} of {len(states)}", "checks passed"),
        (counts or "none", "findings"),
    )
    tiles = "".join(f"<li><b>{escape(b)}</b><span>{escape(t)}</span></li>" for b, t in facts)
    return f'<ul class="tiles">{tiles}</ul>'


# --- pictures and view -----------------------------------------------------------------------


def _pictures(pictures: Sequence[Picture]) -> str:
    figures = []
    for picture in pictures:
        data = base64.b64encode(picture.png).decode("ascii")
        wide = ' class="wide"' if picture.title in ("Turntable", "Joint directions") else ""
        figures.append(
            f'<figure{wide}><img alt="{escape(picture.alt)}" loading="lazy" '
            f'src="data:image/png;base64,{data}"><figcaption><b>{escape(picture.title)}</b>: '
            f"{escape(picture.alt)}</figcaption></figure>"
        )
    return f'<div class="pictures">{"".join(figures)}</div>' if figures else ""


LAYERS = (
    ("visual", "visual", True),
    ("collision", "collision", False),
    ("inertia", "inertia", False),
    ("frames", "frames", False),
    ("axes", "joint axes", False),
    ("names", "names", False),
)


def _view(subject: Subject, view: View | None) -> str:
    if view is None or not view.library:
        return ""
    boxes = "".join(
        f'<label><input type="checkbox" data-layer="{key}"{" checked" if on else ""}> '
        f"{text}</label>"
        for key, text, on in LAYERS
    )
    label = f"3D view of {subject.recipe.robot}: drag or arrow keys turn, plus and minus zoom"
    return (
        '<div id="viewer"><div class="viewer-stage">'
        f'<canvas tabindex="0" role="application" aria-label="{escape(label)}"></canvas>'
        '<div class="viewer-labels" aria-hidden="true" hidden></div>'
        '<div class="viewer-legend" hidden><i></i><div><span>collision in front, 30 mm</span>'
        "<span>not covered, 30 mm</span></div></div></div>"
        '<div class="viewer-panel" tabindex="0" role="region" aria-label="Controls of the 3D view">'
        f"<fieldset><legend>Show</legend>{boxes}</fieldset>"
        '<p><label>Colour <select data-colour><option value="own">as it is</option>'
        '<option value="distance">distance of visual and collision</option></select></label></p>'
        '<fieldset class="viewer-poses"><legend>Pose</legend></fieldset>'
        '<p><label>Link <select data-link><option value="">click one</option></select></label></p>'
        '<div aria-live="polite"><dl class="viewer-facts"></dl></div>'
        '<h3>Joints</h3><div class="viewer-joints"></div></div></div>'
        '<p class="soft viewer-note">Drag or arrow keys: turn. Shift and drag: move. '
        "Wheel (after a click) or + and -: zoom. Click a link for its numbers.</p>"
    )


def _scripts(subject: Subject, view: View | None) -> str:
    if view is None or not view.library:
        return ""
    robot = view_data(subject).replace("<", "\\u003c")  # nothing may end the script early
    return (
        f'<script type="application/json" id="viewer-geometry">{view.geometry}</script>\n'
        f'<script type="application/json" id="viewer-robot">{robot}</script>\n'
        f"<script>{view.library}</script>\n<script>{_asset('viewer.js')}</script>"
    )


# --- findings --------------------------------------------------------------------------------


def _findings(findings: Sequence[Finding]) -> str:
    """What matters in the open, waived ones beside it; what merely informs folded away."""
    loud = [f for f in findings if f.severity != "info"]
    waived = [f for f in findings if f.severity == "info" and "because" in f.data]
    quiet = [f for f in findings if f.severity == "info" and "because" not in f.data]
    following = [f for f in loud if is_consequence(f)]
    parts = _grouped([f for f in loud if f not in following])
    if following:
        inner = "".join(_finding(f) for f in following)
        head = f"{len(following)} checks had nothing to work on, for what stands above"
        parts.append(f"<details><summary>{head}</summary>{inner}</details>")
    parts = parts or ["<p>No errors and no warnings.</p>"]
    if waived:
        parts.append(f"<h3>Waived by the recipe ({len(waived)})</h3>")
        parts += [_finding(f) for f in waived]
    if quiet:
        inner = "".join(_finding(f) for f in quiet)
        parts.append(f"<details><summary>{len(quiet)} for information</summary>{inner}</details>")
    return "".join(parts)


def _grouped(findings: Sequence[Finding]) -> list[str]:
    """In order; of a rule that speaks of many subjects the first is open, the others are folded."""
    parts = []
    for (_, rule), same in groupby(findings, key=lambda f: (f.severity, f.rule)):
        group = list(same)
        parts.append(_finding(group[0]))
        rest = "".join(_finding(f) for f in group[1:])
        if len(group) > SHOWN_OF_A_RULE:
            names = ", ".join(f.subject for f in group[1:])
            head = f"{len(group) - 1} more of <code>{escape(rule)}</code>: {escape(names)}"
            rest = f"<details><summary>{head}</summary>{rest}</details>"
        parts.append(rest)
    return parts


def _finding(finding: Finding) -> str:
    where = f" <code>{escape(finding.where)}</code>" if finding.where else ""
    parts = [
        f'<div class="finding {finding.severity}">{finding.severity} '
        f"<code>{escape(finding.rule)}</code> · {escape(finding.subject)}{where}"
        f"<p>{_prose(finding.message)}</p>"
    ]
    because = finding.data.get("because")
    if because:
        before = finding.data.get("severity_before")
        parts.append(f"<p>Waived, was {escape(str(before))}: {escape(str(because))}</p>")
    if finding.hint:
        parts.append(f"<p>Fix: {_prose(finding.hint)}</p>")
    numbers = {k: v for k, v in finding.data.items() if k not in ("because", "severity_before")}
    if numbers:
        rows = "".join(
            f"<div><dt>{escape(key)}</dt><dd>{escape(text_of(value))}</dd></div>"
            for key, value in sorted(numbers.items())
        )
        parts.append(f'<dl class="numbers">{rows}</dl>')
    if finding.severity != "info":
        waiver = f'rules: {{{finding.rule}: {{severity: info, because: "..."}}}}'
        parts.append(
            "<details><summary>Accept it as it is</summary>"
            f'<pre class="fix" tabindex="0">{escape(waiver)}</pre></details>'
        )
    return "".join([*parts, "</div>"])


# --- checks, card, provenance ----------------------------------------------------------------


def _checks(checks: Mapping[str, CheckResult]) -> list[tuple[str, str, str]]:
    """Sections of checks by what they are about."""
    left = dict(sorted(checks.items()))
    sections = []
    for key, title, names in GROUPS:
        own = sorted((n for n in left if n.startswith(names)), key=lambda n: _rank(n, names))
        content = "".join(check_section(name, left.pop(name)) for name in own)
        sections.append((key, title, content))
    rest = "".join(check_section(name, check) for name, check in left.items())
    return [*sections, ("checks", "Other checks", rest)]


def _rank(name: str, beginnings: Sequence[str]) -> int:
    return next(i for i, beginning in enumerate(beginnings) if name.startswith(beginning))


def _card(subject: Subject, report: Report) -> str:
    parts = []
    for number, shown in enumerate(card_tables(subject, report)):
        content = html_table(shown)
        if number < 3:
            parts.append(f"<h3>{escape(shown.title)}</h3>{content}")
        else:
            head = f"{escape(shown.title)} ({len(shown.rows)})"
            parts.append(f"<details><summary>{head}</summary>{content}</details>")
    return "".join(parts)


def _provenance(subject: Subject) -> str:
    source = subject.recipe.source
    rows = [("built by", f"assetbuild {__version__}"), ("source", source.origin)]
    rows += [(key, str(value)) for key, value in sorted(subject.pin.items())]
    rows.append(("licence of the source", source.license or "not stated"))
    items = "".join(
        f"<tr><th scope='row'>{escape(k)}</th><td><code>{escape(v)}</code></td></tr>"
        for k, v in rows
    )
    return (
        f"<table>{items}</table><p>Digests of all files: <code>manifest.json</code>; who built it, "
        "when and from what: <code>provenance.json</code> (in-toto, SLSA v1). "
        "<code>assetbuild verify</code> compares them.</p>"
    )
