"""A report in a few lines of Markdown: `report/report.md`, for a pull request or a job's page."""

from __future__ import annotations

from dataclasses import replace
from html import escape

from assetbuild.findings import Finding, worst_first
from assetbuild.report.document import Report
from assetbuild.report.verdict import Verdict, verdict_rows

SHOWN_FINDINGS = 50
WITHHELD = "figures of this simulator are not published; see the bundle's own report"
"""PhysX's licence: public summaries carry pass or fail only."""


def summary(report: Report, *lines: str) -> str:
    """Verdict, checks (pass or fail alone) and loud findings; lines: what to say in between."""
    ready = "ready for training" if report.verdict.ready else "not ready for training"
    told = [f"### {report.robot}: {ready}", "", *lines]
    told += ["", *(f"- {part}: {_cell(said)}" for part, said in public_rows(report.verdict))]
    told += ["", "| check | result |", "| --- | --- |"]
    told += [f"| {_cell(name)} | {c.status} |" for name, c in sorted(report.checks.items())]
    found = [f for f in worst_first(list(report.findings)) if f.severity != "info"]
    if found:
        told += ["", "| | rule | subject | finding |", "| --- | --- | --- | --- |"]
    for finding in found[:SHOWN_FINDINGS]:
        cells = (finding.severity, finding.rule, finding.subject, public_message(finding))
        told.append(f"| {' | '.join(_cell(cell) for cell in cells)} |")
    if len(found) > SHOWN_FINDINGS:
        told += ["", f"and {len(found) - SHOWN_FINDINGS} more in the report"]
    return "\n".join(told) + "\n"


def public_rows(verdict: Verdict) -> tuple[tuple[str, str], ...]:
    """The verdict's parts without the figures of Isaac Lab, which simulates with PhysX."""
    trainers = {
        name: replace(one, sentence=WITHHELD)
        if name == "isaaclab" and one.status != "not tried"
        else one
        for name, one in verdict.trainers.items()
    }
    return verdict_rows(replace(verdict, trainers=trainers))


def public_message(finding: Finding) -> str:
    """What a public page may say of a finding."""
    origin = f"{finding.rule} {finding.subject} {list(finding.data.values())}".lower()
    return WITHHELD if "physx" in origin else finding.message


def _cell(text: str) -> str:
    """Text in a table: no markup, no new row, no new column."""
    plain = escape(" ".join(text.split()))
    return "".join(f"\\{c}" if c in "\\`*_|[]" else c for c in plain)
