"""`report/index.html`: one self-contained page, readable in a minute."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from assetbuild._version import __version__
from assetbuild.findings import SEVERITIES
from assetbuild.report.card import card_tables
from assetbuild.report.document import Report
from assetbuild.report.figures import check_section, folded_table
from assetbuild.report.found import findings_section
from assetbuild.report.identified import identified_section
from assetbuild.report.loading import loading_lines
from assetbuild.report.markup import asset, code, filled, prose
from assetbuild.report.subject import Subject
from assetbuild.report.tables import html_table
from assetbuild.report.verdict import CheckResult, verdict_rows
from assetbuild.report.view import view_data
from assetbuild.robot.inertia import total_mass

GROUPS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("equality", "The same robot in every format",
     ("oracle", "urdf_", "bare_", "dr_", "isaaclab_", "mjcf_", "mjlab_", "mjx_", "scene_", "usd_",
      "xrdf_", "counts")),
    ("alignment", "Simulators agree", ("alignment", "physx", "newton", "free_fall")),
    ("gains", "Drives and their effect", ("gains", "stand", "slope", "grip", "trials",
      "full_effort")),
    ("collision", "Collision quality", ("coverage", "collision")),
)  # fmt: skip
"""Anchor, title and the beginnings of the checks' names; all others come last."""


WHERE = (
    "Paths begin in the folder where <code>assetbuild build</code> ran; inside the bundle, omit "
    "<code>build/NAME/</code>."
)
"""`page.js` puts the bundle's own place into the lines where the page is opened from a disk."""


@dataclass(frozen=True)
class View:
    """The 3D view: geometry as JSON, and the text of three.js; empty = none."""

    geometry: str
    library: str


def html_page(report: Report, subject: Subject, hero: bytes | None, view: View | None) -> str:
    """The whole page; nothing in it is fetched from anywhere. hero: a PNG of the robot."""
    view = view if view and view.library else None
    loud = sum(finding.severity != "info" for finding in report.findings)
    sections = [
        ("findings", f"Issues ({loud})", findings_section(report.findings)),
        ("view", "3D view", _viewer(subject) if view else ""),
        *_checks(report.checks),
        ("identified", "Measured on the real robot", identified_section(subject.fits)),
        ("card", "Model card", _card(subject, report)),
        ("provenance", "Provenance", _provenance(subject)),
    ]
    shown = [section for section in sections if section[2]]
    return filled(
        "page.html",
        name=escape(report.robot),
        style=asset("page.css"),
        hero=_hero(hero) if hero else "",
        verdict=_verdict(report),
        tiles=_tiles(report, subject),
        loading=_loading(report, subject),
        toc="".join(f'<li><a href="#{key}">{escape(title)}</a></li>' for key, title, _ in shown),
        body="".join(
            f'<section aria-labelledby="{key}"><h2 id="{key}">{escape(title)}</h2>'
            f"{content}</section>"
            for key, title, content in shown
        ),
        scripts=f"<script>{asset('page.js')}</script>\n"
        + (_scripts(subject, view) if view else ""),
    )


def _verdict(report: Report) -> str:
    verdict = report.verdict
    kind, answer = ("ready", "yes") if verdict.ready else ("error", "no")
    parts = [f"<strong>Ready for training: {answer}</strong>"]
    if verdict.blocked_by:
        parts.append(f"<p>Blocked by {', '.join(map(code, verdict.blocked_by))}</p>")
    parts.append(f'<p class="next"><b>What to do next:</b> {prose(verdict.next_step)}</p>')
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


def _hero(png: bytes) -> str:
    """The robot; a click, or the Enter key, enlarges it."""
    data = base64.b64encode(png).decode("ascii")
    return (
        '<figure class="hero"><button type="button" class="zoom" aria-label="enlarge the robot">'
        f'<img alt="the robot at home" src="data:image/png;base64,{data}"></button></figure>'
    )


def _loading(report: Report, subject: Subject) -> str:
    """Lines to copy, one box for each consumer; the first is open. None for a failed build."""
    recipe = subject.recipe
    if any(finding.severity == "error" for finding in report.findings):
        return ""
    rows = list(loading_lines(recipe.robot, recipe.targets))
    boxes = "".join(
        f'<details class="load"{" open" if n == 0 else ""}><summary>{escape(name)}</summary>'
        f'<pre tabindex="0">{escape(lines)}</pre>'
        f'<button type="button" class="copy" hidden>Copy</button></details>'
        for n, (name, lines) in enumerate(rows)
    )
    missing = [t for t in ("mjlab", "isaaclab") if t not in recipe.targets]
    note = ", ".join(map(code, missing))
    more = (
        f'<p class="soft">Add {note} to <code>targets</code> for more ways to load it.</p>'
        if missing
        else ""
    )
    where = f'<p class="soft" id="bundle-place">{WHERE}</p>'
    head = f'<h2 id="load">Load it</h2>{where}'
    return f'<div class="loading">{head}{boxes}{more}</div>' if rows else ""


def _tiles(report: Report, subject: Subject) -> str:
    states = [check.status for check in report.checks.values()]
    severities = [finding.severity for finding in report.findings]
    plural = {"error": "errors", "warning": "warnings", "info": "for information"}
    numbers = [(severities.count(severity), severity) for severity in SEVERITIES]
    counts = ", ".join(f"{n} {s if n == 1 and s != 'info' else plural[s]}" for n, s in numbers if n)
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


# --- the 3D view ----------------------------------------------------------------------------


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
