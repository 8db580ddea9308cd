"""Findings as HTML: grouped by rule with counts, worst first."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from itertools import groupby

from assetbuild.findings import Finding, is_consequence
from assetbuild.report.markup import code, folded, prose
from assetbuild.report.tables import text_of

OPEN = 3
"""Findings of one rule that are in the open; the others are folded."""


def findings_section(findings: Sequence[Finding]) -> str:
    """What matters in the open, waived ones beside it; what merely informs folded away."""
    loud = [f for f in findings if f.severity != "info"]
    waived = [f for f in findings if f.severity == "info" and "because" in f.data]
    quiet = [f for f in findings if f.severity == "info" and "because" not in f.data]
    following = [f for f in loud if is_consequence(f)]
    parts = _by_rule([f for f in loud if f not in following])
    if following:
        head = f"{len(following)} more findings that follow from the errors above"
        parts.append(folded(head, "".join(_by_rule(following))))
    parts = parts or ["<p>No errors and no warnings.</p>"]
    if waived:
        parts += [f"<h3>Waived by the recipe ({len(waived)})</h3>", *_by_rule(waived)]
    if quiet:
        rules = len({f.rule for f in quiet})
        head = f"{_count(len(quiet), 'note')} from {_count(rules, 'rule')}"
        parts.append(folded(head, "".join(_by_rule(quiet))))
    return "".join(parts)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _by_rule(findings: Sequence[Finding]) -> list[str]:
    """One box for each rule, in order of the worst."""
    order = list(dict.fromkeys((f.severity, f.rule) for f in findings))
    ordered = sorted(findings, key=lambda f: order.index((f.severity, f.rule)))
    return [
        _box(severity, rule, list(same))
        for (severity, rule), same in groupby(ordered, key=lambda f: (f.severity, f.rule))
    ]


def _box(severity: str, rule: str, findings: Sequence[Finding]) -> str:
    count = f' <span class="count">{len(findings)} findings</span>' if len(findings) > 1 else ""
    parts = [
        f'<div class="finding {severity}"><h3><span class="{severity}">{severity}</span> '
        f"{code(rule)}{count}</h3>"
    ]
    # What the recipe waives asks for nothing.
    hints = list(dict.fromkeys(f.hint for f in findings if f.hint and "because" not in f.data))
    label = "Hint" if severity == "info" else "To do"
    same_hint = len(hints) == 1
    alone = "" if same_hint else label
    parts += [_item(f, alone) for f in findings[:OPEN]]
    others = findings[OPEN:]
    if others:
        names = escape(", ".join(f.subject for f in others))
        rest = "".join(_item(f, alone) for f in others)
        parts.append(folded(f"{len(others)} more of {code(rule)}: {names}", rest))
    if same_hint:
        parts.append(f"<p><b>{label}:</b> {prose(hints[0])}</p>")
    if severity != "info":
        waiver = f'rules: {{{rule}: {{severity: info, because: "..."}}}}'
        shown = f'<pre class="fix" tabindex="0">{escape(waiver)}</pre>'
        parts.append(folded("Accept it as it is: write the reason into the recipe", shown))
    return "".join([*parts, "</div>"])


def _item(finding: Finding, label: str) -> str:
    """label: of its hint; "" = without it."""
    where = f' <span class="where">{code(finding.where)}</span>' if finding.where else ""
    said = f"<b>{escape(finding.subject)}</b>: {prose(finding.message)}{where}"
    parts = [f'<div class="said"><p>{said}</p>']
    numbers = dict(sorted(finding.data.items()))
    before, because = numbers.pop("severity_before", None), numbers.pop("because", None)
    if because:
        parts.append(f"<p>Waived, was {escape(str(before))}: {escape(str(because))}</p>")
    if label and finding.hint and not because:
        parts.append(f"<p><b>{label}:</b> {prose(finding.hint)}</p>")
    if numbers:
        rows = "".join(
            f"<div><dt>{escape(key)}</dt><dd>{escape(text_of(value))}</dd></div>"
            for key, value in numbers.items()
        )
        parts.append(folded("numbers", f'<dl class="numbers">{rows}</dl>'))
    return "".join([*parts, "</div>"])
