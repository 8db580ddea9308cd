"""What a build prints at its end: verdict, what ran, findings worst first, where the bundle is."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from assetbuild.cli import print_error
from assetbuild.cli.parser import given_as
from assetbuild.findings import SEVERITIES, Finding, is_consequence
from assetbuild.pipeline.building import Outcome
from assetbuild.report.document import Report
from assetbuild.report.summary import WITHHELD, checks_text, public_message, published
from assetbuild.report.verdict import BESIDE, Verdict, verdict_rows


def in_public() -> bool:
    """Whether everybody reads the log of this command: CI services set `CI`.

    PhysX's licence does not let its figures be published. At home they are the user's own.
    """
    return bool(os.environ.get("CI") or os.environ.get("GITHUB_ACTIONS"))


def shown_message(finding: Finding) -> str:
    """The finding's message; in CI without PhysX's figures."""
    return public_message(finding) if in_public() else finding.message


def shown_report(report: Report) -> Report:
    """The report; in CI without PhysX's figures."""
    return published(report) if in_public() else report


def shown_rows(verdict: Verdict, recipe: Path) -> tuple[tuple[str, str], ...]:
    """The verdict's parts.

    recipe: as it was given, so that the commands work where they are printed.
    """
    verb = "assetbuild smoke"
    named, given = f"{verb} {recipe.name} ", f"{verb} {given_as(recipe)} "
    return tuple(
        (part, text.replace(BESIDE, "").replace(named, given))
        for part, text in verdict_rows(verdict)
    )


def shown_seconds(label: str, seconds: float) -> str:
    """How long a step took; in CI not that of a check that runs PhysX."""
    hidden = in_public() and any(word in label for word in ("physx", "alignment", "isaaclab"))
    return "" if hidden else f"{seconds:.1f} s"


def shown_figures(simulator: str, text: str) -> str:
    """Figures of a trainer; in CI not those of Isaac Lab, which simulates with PhysX."""
    return WITHHELD if in_public() and simulator == "isaaclab" else text


SHOWN_RULES = 12
SHOWN_NAMES = 8
"""So many subjects of a rule are named besides the first one."""
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
    report = shown_report(report)
    ready = "yes" if report.verdict.ready else "no"
    head = [f"{report.robot}: ready for training: {_coloured(ready, ready)}"]
    if report.verdict.blocked_by:
        head.append(f"  blocked by {', '.join(report.verdict.blocked_by)}")
    if outcome.exit_code and not report.has_errors:
        head.append("  failed: `--fail-on warning` counts warnings, too")
    head.append(f"  next: {report.verdict.next_step}")
    rows = shown_rows(report.verdict, outcome.loaded.path)
    head += [f"  {part}: {sentence}" for part, sentence in rows]
    head.append(f"  steps: {_steps(outcome)}")
    head += [f"  checks: {checks_text(report)}", f"  findings: {_counts(report.findings)}"]
    tail = [f"  you had changed {path}: kept in {outcome.out}.edited/" for path in outcome.edited]
    tail.append(f"  bundle: {outcome.out}")
    return [*head, *finding_lines(report.findings), *tail]


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
        longest = (f"{r.label} {shown_seconds(r.label, r.seconds)}".rstrip() for r in slow)
        text += f" (longest: {', '.join(longest)})"
    return text


def _counts(findings: tuple[Finding, ...]) -> str:
    severities = [finding.severity for finding in findings]
    return ", ".join(f"{severities.count(severity)} {severity}" for severity in SEVERITIES)


def finding_lines(findings: Sequence[Finding]) -> list[str]:
    """Errors and warnings, `SHOWN_RULES` rules of them; what merely informs stands in the report.

    A rule that speaks of many subjects is shown once, with the names of the others.
    """
    loud = [finding for finding in findings if finding.severity != "info"]
    groups = [list(same) for _, same in groupby(loud, key=_told_together)]
    lines = [f"    {line}" for group in groups[:SHOWN_RULES] for line in _group_lines(group)]
    left = sum(map(len, groups[SHOWN_RULES:]))
    return [*lines, f"    and {left} more in the report"] if left else lines


def every_finding_line(findings: Sequence[Finding]) -> list[str]:
    """All findings, those that merely inform too: each rule once, with whom it speaks of."""
    groups = [list(same) for _, same in groupby(findings, key=_told_together)]
    return [line for group in groups for line in _group_lines(group)]


def print_findings(findings: Sequence[Finding]) -> None:
    """All findings, on stderr."""
    for line in every_finding_line(findings):
        print(line, file=sys.stderr)


def _told_together(finding: Finding) -> tuple[str, str]:
    return finding.severity, "" if is_consequence(finding) else finding.rule


def _group_lines(group: Sequence[Finding]) -> list[str]:
    """The first finding of a rule, its hint, and of whom else the rule speaks."""
    first, *others = group
    if is_consequence(first):
        rules = ", ".join(dict.fromkeys(finding.rule for finding in group))
        return [f"{first.severity} {rules}: caused by the errors above"]
    lines = finding_text(first).split("\n")
    if others:
        known = list(dict.fromkeys(f.subject for f in others if f.subject != first.subject))
        names = ", ".join([*known[:SHOWN_NAMES], *(["..."] if len(known) > SHOWN_NAMES else [])])
        lines.append(f"  and {len(others)} more{f': {names}' if names else ''}")
    return lines


def finding_text(finding: Finding) -> str:
    """The finding with its place, and its hint on a second line."""
    severity = _coloured(finding.severity, finding.severity)
    place = f"{finding.where}: " if finding.where else ""
    hint = f"\n  hint: {finding.hint}" if finding.hint else ""
    return f"{severity} {finding.rule}: {place}{finding.subject}: {shown_message(finding)}{hint}"


def _coloured(text: str, kind: str) -> str:
    if not sys.stdout.isatty() or os.environ.get("NO_COLOR") or kind not in _COLOURS:
        return text
    return f"\x1b[{_COLOURS[kind]}m{text}\x1b[0m"
