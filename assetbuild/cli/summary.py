"""What a build prints at its end: verdict, what ran, findings worst first, where the bundle is."""

from __future__ import annotations

import os
import sys

from assetbuild.cli import print_error
from assetbuild.findings import SEVERITIES, Finding
from assetbuild.pipeline import Outcome
from assetbuild.report.document import Report

SHOWN_FINDINGS = 12
_COLOURS = {"error": "31", "warning": "33", "yes": "32", "no": "31"}


def print_summary(outcome: Outcome) -> None:
    """A screen on stdout; errors of failed steps on stderr."""
    for error in outcome.errors:
        print_error(error)
    if outcome.report is None:
        blocked = sum(r.status == "blocked" for r in outcome.results.values())
        print(f"{outcome.loaded.recipe.robot}: not built; {blocked} steps wait for what failed")
        return
    for line in summary_lines(outcome, outcome.report):
        print(line)


def print_differences(outcome: Outcome) -> None:
    """What `--rebuild-check` found, if the build got that far."""
    if outcome.report is None:
        return
    for difference in outcome.differences:
        print(f"error: {difference}", file=sys.stderr)
    robot = outcome.loaded.recipe.robot
    if outcome.differences:
        place = f"{outcome.out}".removesuffix(".failed")
        print(f"{robot}: not reproducible; both versions are in {place}.rebuild-check/")
    else:
        print(f"{robot}: reproducible: every step gave the same bytes twice")


def summary_lines(outcome: Outcome, report: Report) -> list[str]:
    """The lines of the summary."""
    ready = "yes" if report.verdict.ready else "no"
    lines = [f"{report.robot}: ready for training: {_coloured(ready, ready)}"]
    if report.verdict.blocked_by:
        lines.append(f"  blocked by {', '.join(report.verdict.blocked_by)}")
    lines += [f"  next: {report.verdict.next_step}", f"  steps: {_steps(outcome)}"]
    lines += [f"  checks: {_checks(report)}", f"  findings: {_counts(report.findings)}"]
    lines += _findings(report.findings)
    for path in outcome.edited:
        lines.append(f"  you had changed {path}: kept in {outcome.out}.edited/")
    lines.append(f"  bundle: {outcome.out}")
    return lines


def null_summary(outcome: Outcome, report: Report) -> str:
    """What the same command prints while nothing changes."""
    ready = "yes" if report.verdict.ready else "no"
    steps = len(outcome.results)
    return (
        f"{report.robot}: ready for training: {ready}\n"
        f"  steps: 0 ran, {steps} up to date\n"
        f"  findings: {_counts(report.findings)}\n"
        f"  bundle: {outcome.out}\n"
    )


def _steps(outcome: Outcome) -> str:
    results = outcome.results.values()
    ran = [result for result in results if result.status == "ran"]
    cached = sum(result.status == "cached" for result in results)
    text = f"{len(ran)} ran, {cached} cached, {outcome.seconds:.1f} s"
    slow = sorted(ran, key=lambda result: -result.seconds)[:2]
    if slow and slow[0].seconds >= 2.0:
        text += f" (longest: {', '.join(f'{r.label} {r.seconds:.1f} s' for r in slow)})"
    return text


def _checks(report: Report) -> str:
    states = [check.status for check in report.checks.values()]
    text = f"{states.count('pass')} passed, {states.count('fail')} failed"
    skipped = [f"{n} ({c.note})" for n, c in report.checks.items() if c.status == "skip"]
    return f"{text}, skipped: {'; '.join(skipped)}" if skipped else text


def _counts(findings: tuple[Finding, ...]) -> str:
    found = [finding.severity for finding in findings]
    return ", ".join(f"{found.count(severity)} {severity}" for severity in SEVERITIES)


def _findings(findings: tuple[Finding, ...]) -> list[str]:
    """Errors and warnings; what merely informs stands in the report."""
    loud = [finding for finding in findings if finding.severity != "info"]
    lines = []
    for finding in loud[:SHOWN_FINDINGS]:
        place = f"{finding.where}: " if finding.where else ""
        severity = _coloured(finding.severity, finding.severity)
        lines.append(f"    {severity} {finding.rule}: {place}{finding.subject}: {finding.message}")
        if finding.hint:
            lines.append(f"      hint: {finding.hint}")
    if len(loud) > SHOWN_FINDINGS:
        lines.append(f"    and {len(loud) - SHOWN_FINDINGS} more in the report")
    return lines


def _coloured(text: str, kind: str) -> str:
    if not sys.stdout.isatty() or os.environ.get("NO_COLOR") or kind not in _COLOURS:
        return text
    return f"\x1b[{_COLOURS[kind]}m{text}\x1b[0m"
