"""The report as data: findings with their places, checks with their figures, one verdict."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from assetbuild._version import __version__
from assetbuild.errors import nearest
from assetbuild.findings import (
    FOLLOWS,
    RENAMED,
    SEVERITIES,
    WAIVED,
    Finding,
    Rule,
    finding_from_json,
    is_now,
    worst_first,
)
from assetbuild.recipe.models import Waiver
from assetbuild.report.verdict import CheckResult, Verdict, judge

FailOn = Literal["error", "warning", "never"]

OLD_NAME = Rule(
    "rules.renamed",
    "info",
    "the recipe changes a rule by a name that it had before",
    "write the new name; the old one works for one minor version",
)
UNUSED = Rule(
    "rules.unused",
    "info",
    "the recipe changes a rule that found nothing",
    "remove it, or check its spelling",
)


@dataclass(frozen=True)
class Report:
    """All that is known about a built robot."""

    robot: str
    verdict: Verdict
    findings: tuple[Finding, ...]
    checks: Mapping[str, CheckResult]

    @property
    def has_errors(self) -> bool:
        """Whether an error stands that the recipe does not waive."""
        return any(finding.severity == "error" for finding in self.findings)

    def to_json(self) -> dict[str, object]:
        """The content of `report.json`."""
        return {
            "robot": self.robot,
            "assetbuild": __version__,
            "verdict": asdict(self.verdict),
            "findings": [finding.to_json() for finding in self.findings],
            "checks": {
                name: {"status": check.status, "figures": dict(check.figures)}
                | ({"note": check.note} if check.note else {})
                for name, check in sorted(self.checks.items())
            },
        }


EARLIER: Mapping[str, object] = {
    "next_step": "",
    "formats": {"status": "not compared", "sentence": "built by an earlier version"},
    "physics": {"status": "not tried", "sentence": "built by an earlier version"},
    "trainers": {},
    "not_tried": {},
}
"""What the verdict of a bundle of version 0.1 may lack."""


def report_of(content: Mapping[str, Any]) -> Report:  # Any: JSON
    """What a `report.json` says. ValueError, KeyError or TypeError for foreign data."""
    from pydantic import TypeAdapter  # for verbs that read a report

    checks = {name: {"note": "", **check} for name, check in content["checks"].items()}
    return Report(
        str(content["robot"]),
        TypeAdapter(Verdict).validate_python({**EARLIER, **content["verdict"]}),
        tuple(map(finding_from_json, content["findings"])),
        TypeAdapter(dict[str, CheckResult]).validate_python(checks),
    )


def make_report(
    robot: str,
    findings: Sequence[Finding],
    checks: Mapping[str, CheckResult],
    waivers: Mapping[str, Waiver],
    locate: Callable[[str], str],
    commands: Mapping[str, str] | None = None,
) -> Report:
    """Waive, locate and order the findings, then judge.

    locate: from a finding's subject to `file:line`, or "" when the source has no such line.
    commands: trainer -> the command with which it tries the bundle.
    """
    placed = [f if f.where else f.at(locate(f.subject)) for f in _once(findings)]
    remarks = [f.at(locate(f.subject)) for f in _remarks(placed, waivers)]
    final = worst_first(_traced([_waived(f, waivers) for f in placed]) + remarks)
    return Report(robot, judge(final, checks, commands), tuple(final), checks)


def _traced(findings: list[Finding]) -> list[Finding]:
    """The findings; where MuJoCo refuses the MJCF, those that only repeat its reason say so.

    `mjcf.load` itself follows from an error about the link or joint that MuJoCo names.
    """
    refused = next((f for f in findings if f.rule == "mjcf.load" and f.severity == "error"), None)
    if refused is None:
        return findings
    reason = refused.message.partition("Error: ")[2].rpartition(", line")[0]
    named = re.findall(r"'([^']+)'", reason)
    errors = [f for f in findings if f.severity == "error" and f.rule != refused.rule]
    cause = next((f.rule for f in errors if f.subject.partition(" ")[2] in named), "")
    return [
        replace(f, data={**f.data, FOLLOWS: cause if f.rule == refused.rule else refused.rule})
        if reason and reason in f.message and (cause or f.rule != refused.rule)
        else f
        for f in findings
    ]


def _once(findings: Sequence[Finding]) -> list[Finding]:
    """A statement that links and bodies both make is one, with the worse severity."""
    kept: dict[tuple[str, str, str], Finding] = {}
    for finding in worst_first(list(findings)):
        kept.setdefault((finding.rule, finding.subject, finding.message), finding)
    return list(kept.values())


def fails(report: Report, fail_on: FailOn) -> bool:
    """Whether the build must exit with 1."""
    if fail_on == "never":
        return False
    limit = SEVERITIES.index(fail_on)
    return any(SEVERITIES.index(finding.severity) <= limit for finding in report.findings)


def _waived(finding: Finding, waivers: Mapping[str, Waiver]) -> Finding:
    old = (waiver for name, waiver in waivers.items() if is_now(name, finding))
    waiver = waivers.get(finding.rule) or next(old, None)
    if waiver is None or waiver.severity == finding.severity:
        return finding
    data = {**finding.data, WAIVED: finding.severity, "because": waiver.because}
    return replace(finding, severity=waiver.severity, data=data)


def _remarks(findings: Sequence[Finding], waivers: Mapping[str, Waiver]) -> Iterator[Finding]:
    """What is said of rules that the recipe changes by their old names, or in vain."""
    rules = {finding.rule for finding in findings}
    for rule in waivers:
        subject = f"recipe rules.{rule}"
        if rule in RENAMED:
            new = dict.fromkeys(f"`{pattern.partition(' ')[0]}`" for pattern in RENAMED[rule])
            message = f"rule `{rule}` is called {', '.join(new)} now"
            yield OLD_NAME(subject, message)
        elif rule not in rules:
            message = f"the recipe changes rule `{rule}`, which found nothing"
            near = nearest(rule, rules)
            yield UNUSED(subject, message, hint=f"did you mean `{near}`?" if near else "")
