"""A report in a few lines of Markdown: `report/report.md`, for a pull request or a job's page."""

from __future__ import annotations

import re
from dataclasses import replace
from html import escape

from assetbuild.findings import Finding, worst_first
from assetbuild.report.document import Report
from assetbuild.report.tables import markdown_table, table
from assetbuild.report.verdict import verdict_rows

SHOWN_FINDINGS = 50
WITHHELD = "figures of this simulator are not published; see the bundle's own report"
"""PhysX's licence: public summaries carry pass or fail only."""


def summary(report: Report, *lines: str) -> str:
    """Verdict, checks (how many passed, which did not) and loud findings.

    lines: what to say in between.
    """
    report = published(report)
    ready = "ready for training" if report.verdict.ready else "not ready for training"
    parts = [f"### {report.robot}: {ready}", "", *lines]
    parts += ["", *(f"- {part}: {markdown_text(v)}" for part, v in verdict_rows(report.verdict))]
    parts += [f"- checks: {checks_text(report)}"]
    findings = [f for f in worst_first(list(report.findings)) if f.severity != "info"]
    cells = [(f.severity, f.rule, f.subject, f.message) for f in findings[:SHOWN_FINDINGS]]
    if cells:
        rows = [map(markdown_text, row) for row in cells]
        listed = table("", ("", "rule", "subject", "finding"), map(tuple, rows))
        parts += ["", markdown_table(listed)]
    if len(findings) > SHOWN_FINDINGS:
        parts += ["", f"and {len(findings) - SHOWN_FINDINGS} more in the report"]
    return "\n".join(parts) + "\n"


def checks_text(report: Report) -> str:
    """`13 passed`, and the names of those that failed or were not run."""
    by_status = {
        status: [name for name, check in sorted(report.checks.items()) if check.status == status]
        for status in ("pass", "fail", "skip")
    }
    parts = [f"{len(by_status['pass'])} passed"]
    failed = "failed" if report.has_errors else "failed, waived by the recipe"
    for status, words in (("fail", failed), ("skip", "not run")):
        names = by_status[status]
        if names:
            parts.append(f"{len(names)} {words} ({', '.join(f'`{name}`' for name in names)})")
    return ", ".join(parts)


def published(report: Report) -> Report:
    """The report without figures of PhysX, with which Isaac Lab simulates as well."""
    findings = tuple(replace(f, message=public_message(f)) for f in report.findings)
    trainers = {
        name: replace(one, sentence=WITHHELD)
        if name == "isaaclab" and one.status != "not tried"
        else one
        for name, one in report.verdict.trainers.items()
    }
    step = report.verdict.next_step  # it may end in the message of a finding
    for finding in report.findings:
        if finding.message and step.endswith(finding.message):
            step = step.removesuffix(finding.message) + public_message(finding)
            break
    verdict = replace(report.verdict, trainers=trainers, next_step=step)
    return replace(report, verdict=verdict, findings=findings)


def public_message(finding: Finding) -> str:
    """What a public page may say of a finding."""
    origin = f"{finding.rule} {finding.subject} {list(finding.data.values())}".lower()
    return WITHHELD if "physx" in origin else finding.message


def markdown_text(text: str) -> str:
    """Text on one line, with no markup of its own but code."""
    plain = " ".join(text.split())
    parts = plain.split("`") if plain.count("`") % 2 == 0 else [plain]
    # Every second part is code, between backticks.
    parts[::2] = [re.sub(r"([\\`*_\[\]])", r"\\\1", escape(part)) for part in parts[::2]]
    return "`".join(parts)
