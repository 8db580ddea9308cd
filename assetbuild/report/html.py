"""`report/index.html`: one self-contained page, readable in a minute.

Its markup stands in `assets/`, beside style and scripts; here is what the templates print.
"""

from __future__ import annotations

import base64
import functools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from assetbuild._version import __version__
from assetbuild.findings import SEVERITIES, Finding, is_consequence, is_waived
from assetbuild.report.card import card_tables
from assetbuild.report.document import Report
from assetbuild.report.figures import figures_of
from assetbuild.report.identified import HEIGHT, WIDTH, identified
from assetbuild.report.loading import loading_lines
from assetbuild.report.sentences import sentence
from assetbuild.report.subject import Subject
from assetbuild.report.tables import text_of
from assetbuild.report.verdict import CheckResult, Verdict, verdict_rows
from assetbuild.report.view import view_data
from assetbuild.robot.inertia import total_mass

if TYPE_CHECKING:
    from jinja2 import Environment

ASSETS = Path(__file__).parent / "assets"
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


@dataclass(frozen=True)
class View:
    """The 3D view: geometry as JSON, and the text of three.js; empty = none."""

    geometry: str
    library: str


def html_page(report: Report, subject: Subject, hero: bytes | None, view: View | None) -> str:
    """The whole page; nothing in it is fetched from anywhere. hero: a PNG of the robot."""
    targets = subject.recipe.targets
    failed = any(finding.severity == "error" for finding in report.findings)
    return templates().get_template("page.html").render(
        report=report,
        verdict=report.verdict,
        name=subject.recipe.robot,
        hero=base64.b64encode(hero).decode("ascii") if hero else "",
        rows=list(_rows(report.verdict)),
        loading=[] if failed else list(loading_lines(subject.recipe.robot, targets)),
        missing=[target for target in ("mjlab", "isaaclab") if target not in targets],
        tiles=_tiles(report, subject),
        loud=sum(finding.severity != "info" for finding in report.findings),
        findings=_sorted_out(report.findings),
        view=view if view and view.library else None,
        robot=Markup(view_data(subject).replace("<", "\\u003c")),  # noqa: S704 # ends no script
        groups=_grouped(report.checks),
        fits=[identified(*fit) for fit in subject.fits],
        tables=card_tables(subject, report),
        built=_provenance(subject),
    )  # fmt: skip


@functools.cache
def templates() -> Environment:
    """The templates with what they may call."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # for a page alone

    made = Environment(
        loader=FileSystemLoader(ASSETS), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    made.filters |= {"text": text_of, "prose": prose, "one_line": _one_line, "count_all": _count}
    made.filters |= {"counted": lambda number, noun: f"{number} {noun}{'s' * (number != 1)}"}
    made.tests["waived"] = is_waived
    made.globals |= {"asset": _asset, "sentence": sentence, "figures_of": figures_of}
    made.globals["PLOT"] = (WIDTH, HEIGHT)
    return made


def prose(text: str) -> Markup:
    """A sentence whose backticks become code."""
    marked = re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text)))
    return Markup(marked)  # noqa: S704 # escaped above


def _asset(name: str) -> Markup:
    """A file that comes with the report."""
    return Markup((ASSETS / name).read_text(encoding="utf-8"))  # noqa: S704 # our own


def _one_line(markup: Markup) -> Markup:
    return Markup("").join(Markup(line.strip()) for line in markup.splitlines())  # noqa: S704 # as it was


Box = tuple[str, str, list[Finding]]
"""(severity, rule, its findings)."""


def _sorted_out(findings: Sequence[Finding]) -> dict[str, list[Box]]:
    """Findings in groups: open ones, their consequences, waived ones, and notes."""
    loud = [f for f in findings if f.severity != "info"]
    quiet = [f for f in findings if f.severity == "info"]
    return {
        "loud": _by_rule(f for f in loud if not is_consequence(f)),
        "following": _by_rule(filter(is_consequence, loud)),
        "waived": _by_rule(f for f in quiet if is_waived(f)),
        "quiet": _by_rule(f for f in quiet if not is_waived(f)),
    }


def _by_rule(findings: Iterator[Finding]) -> list[Box]:
    """One box for each rule, in order of the worst."""
    found = list(findings)
    order = list(dict.fromkeys((f.severity, f.rule) for f in found))
    ordered = sorted(found, key=lambda f: order.index((f.severity, f.rule)))
    grouped = groupby(ordered, key=lambda f: (f.severity, f.rule))
    return [(severity, rule, list(same)) for (severity, rule), same in grouped]


def _count(boxes: Sequence[Box]) -> int:
    return sum(len(findings) for _, _, findings in boxes)


def _rows(verdict: Verdict) -> Iterator[tuple[str, str]]:
    """Formats, physics and trainers, each with what was found."""
    yield from verdict_rows(verdict)
    if verdict.not_tried:
        notes = (f"`{name}` ({note})" if note else f"`{name}`"
                 for name, note in verdict.not_tried.items())  # fmt: skip
        yield "checks", f"not run: {'; '.join(notes)}"


def _tiles(report: Report, subject: Subject) -> tuple[tuple[str, str], ...]:
    states = [check.status for check in report.checks.values()]
    severities = [finding.severity for finding in report.findings]
    plural = {"error": "errors", "warning": "warnings", "info": "for information"}
    numbers = [(severities.count(severity), severity) for severity in SEVERITIES]
    counts = ", ".join(f"{n} {s if n == 1 and s != 'info' else plural[s]}" for n, s in numbers if n)
    return (
        (f"{total_mass(subject.tree):.4g} kg", "total mass"),
        (str(len(subject.tree.moving_joints)), "moving joints"),
        (str(len(subject.tree.bodies)), "bodies"),
        (str(len(subject.shapes.of("collision"))), "collision shapes"),
        (f"{states.count('pass')} of {len(states)}", "checks passed"),
        (counts or "none", "findings"),
    )


def _grouped(checks: Mapping[str, CheckResult]) -> list[tuple[str, str, list[object]]]:
    """(anchor, title, [(name, check)]) by what they are about."""
    left = dict(sorted(checks.items()))
    groups: list[tuple[str, str, list[object]]] = []
    for key, title, beginnings in GROUPS:
        own = [name for start in beginnings for name in left if name.startswith(start)]
        groups.append((key, title, [(name, left.pop(name)) for name in dict.fromkeys(own)]))
    return [*groups, ("checks", "Other checks", list(left.items()))]


def _provenance(subject: Subject) -> list[tuple[str, object]]:
    source = subject.recipe.source
    return [
        ("built by", f"assetbuild {__version__}"),
        ("source", source.origin),
        *sorted(subject.pin.items()),
        ("licence of the source", source.license or "not stated"),
    ]
