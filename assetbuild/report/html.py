"""`report/index.html`: one self-contained page, readable in a minute."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import groupby

from assetbuild import __version__
from assetbuild.findings import SEVERITIES, Finding, is_consequence
from assetbuild.report.card import card_tables
from assetbuild.report.document import Report
from assetbuild.report.figures import check_section, folded_table
from assetbuild.report.markup import asset, code, filled, folded, prose
from assetbuild.report.subject import Subject
from assetbuild.report.tables import html_table, text_of
from assetbuild.report.verdict import CheckResult, verdict_rows
from assetbuild.report.view import view_data
from assetbuild.robot.inertia import total_mass

SHOWN_OF_A_RULE = 2
GROUPS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("equality", "The same robot in every format",
     ("oracle", "urdf_", "bare_", "dr_", "isaaclab_", "mjcf_", "mjlab_", "mjx_", "scene_", "usd_",
      "counts")),
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
    view = view if view and view.library else None
    sections = [
        ("findings", f"Findings ({len(report.findings)})", _findings(report.findings)),
        ("view", "3D view", _viewer(subject) if view else ""),
        ("pictures", "Pictures", _pictures(pictures)),
        *_checks(report.checks),
        ("card", "Model card", _card(subject, report)),
        ("provenance", "Provenance", _provenance(subject)),
    ]
    shown = [section for section in sections if section[2]]
    return filled(
        "page.html",
        name=escape(report.robot),
        style=asset("page.css"),
        verdict=_verdict(report),
        tiles=_tiles(report, subject),
        toc="".join(f'<li><a href="#{key}">{escape(title)}</a></li>' for key, title, _ in shown),
        body="".join(
            f'<section aria-labelledby="{key}"><h2 id="{key}">{escape(title)}</h2>{content}'
            "</section>"
            for key, title, content in shown
        ),
        scripts=_scripts(subject, view) if view else "",
    )


def _verdict(report: Report) -> str:
    verdict = report.verdict
    kind, answer = ("ready", "yes") if verdict.ready else ("error", "no")
    parts = [f"<strong>Ready for training: {answer}</strong>"]
    if verdict.blocked_by:
        parts.append(f"<p>Blocked by {', '.join(map(code, verdict.blocked_by))}</p>")
    parts.append(f"<p>Next: {prose(verdict.next_step)}</p>")
    rows = list(verdict_rows(verdict))
    if verdict.not_tried:
        notes = (
            f"`{name}` ({note})" if note else f"`{name}`"
            for name, note in verdict.not_tried.items()
        )
        rows.append(("checks", f"not run: {'; '.join(notes)}"))
    parts.append(_parts(rows))
    return f'<div class="verdict {kind}" role="status">{"".join(parts)}</div>'


def _parts(rows: Sequence[tuple[str, str]]) -> str:
    """Formats, physics and trainers, each with what was found."""
    items = "".join(f"<div><dt>{escape(k)}</dt><dd>{prose(v)}</dd></div>" for k, v in rows)
    return f'<dl class="parts">{items}</dl>'


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


def _viewer(subject: Subject) -> str:
    label = f"3D view of {subject.recipe.robot}: drag or arrow keys turn, plus and minus zoom"
    lines = filled("viewer.html", label=escape(label)).splitlines()
    return "".join(map(str.strip, lines))


def _scripts(subject: Subject, view: View) -> str:
    robot = view_data(subject).replace("<", "\\u003c")  # nothing may end the script early
    return (
        f'<script type="application/json" id="viewer-geometry">{view.geometry}</script>\n'
        f'<script type="application/json" id="viewer-robot">{robot}</script>\n'
        f"<script>{view.library}</script>\n<script>{asset('viewer.js')}</script>"
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
        head = f"{len(following)} checks had nothing to work on, for what stands above"
        parts.append(folded(head, _each(following)))
    parts = parts or ["<p>No errors and no warnings.</p>"]
    if waived:
        parts.append(f"<h3>Waived by the recipe ({len(waived)})</h3>{_each(waived)}")
    if quiet:
        parts.append(folded(f"{len(quiet)} for information", _each(quiet)))
    return "".join(parts)


def _grouped(findings: Sequence[Finding]) -> list[str]:
    """In order; of a rule that speaks of many subjects the first is open, the others are folded."""
    parts = []
    for (_, rule), same in groupby(findings, key=lambda f: (f.severity, f.rule)):
        first, *others = same
        rest = _each(others)
        if len(others) >= SHOWN_OF_A_RULE:
            names = escape(", ".join(f.subject for f in others))
            rest = folded(f"{len(others)} more of {code(rule)}: {names}", rest)
        parts += [_finding(first), rest]
    return parts


def _each(findings: Sequence[Finding]) -> str:
    return "".join(map(_finding, findings))


def _finding(finding: Finding) -> str:
    where = f" {code(finding.where)}" if finding.where else ""
    parts = [
        f'<div class="finding {finding.severity}">{finding.severity} '
        f"{code(finding.rule)} · {escape(finding.subject)}{where}"
        f"<p>{prose(finding.message)}</p>"
    ]
    numbers = dict(sorted(finding.data.items()))
    before, because = numbers.pop("severity_before", None), numbers.pop("because", None)
    if because:
        parts.append(f"<p>Waived, was {escape(str(before))}: {escape(str(because))}</p>")
    if finding.hint:
        parts.append(f"<p>Fix: {prose(finding.hint)}</p>")
    if numbers:
        rows = "".join(
            f"<div><dt>{escape(key)}</dt><dd>{escape(text_of(value))}</dd></div>"
            for key, value in numbers.items()
        )
        parts.append(f'<dl class="numbers">{rows}</dl>')
    if finding.severity != "info":
        waiver = f'rules: {{{finding.rule}: {{severity: info, because: "..."}}}}'
        shown = f'<pre class="fix" tabindex="0">{escape(waiver)}</pre>'
        parts.append(folded("Accept it as it is", shown))
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
    tables = card_tables(subject, report)
    opened = [f"<h3>{escape(shown.title)}</h3>{html_table(shown)}" for shown in tables[:3]]
    return "".join([*opened, *map(folded_table, tables[3:])])


def _provenance(subject: Subject) -> str:
    source = subject.recipe.source
    rows = {
        "built by": f"assetbuild {__version__}",
        "source": source.origin,
        **dict(sorted(subject.pin.items())),
        "licence of the source": source.license or "not stated",
    }
    items = "".join(
        f"<tr><th scope='row'>{escape(key)}</th><td>{code(str(value))}</td></tr>"
        for key, value in rows.items()
    )
    return (
        f"<table>{items}</table><p>Digests of all files: <code>manifest.json</code>; who built it, "
        "when and from what: <code>provenance.json</code> (in-toto, SLSA v1). "
        "<code>assetbuild verify</code> compares them.</p>"
    )
