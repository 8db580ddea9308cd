"""`report/index.html`: one self-contained page, readable in a minute."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape

from assetbuild.findings import Finding
from assetbuild.report.document import CheckResult, Report

_FIRST = ("rank", "row", "of", "mujoco", "physx", "off", "unit")
"""Columns of a figure's table that come first, in this order."""
_STYLE = """
:root { color-scheme: light dark; --line: #8884; --bad: #c62828; --warn: #b26a00; --ok: #2e7d32; }
@media (prefers-color-scheme: dark) { :root { --bad: #ef9a9a; --warn: #ffcc80; --ok: #a5d6a7; } }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
table { border-collapse: collapse; width: 100%; font-size: .92rem; }
th, td { text-align: left; vertical-align: top; padding: .3rem .6rem; }
th, td { border-top: 1px solid var(--line); }
code { font: .9em ui-monospace, monospace; overflow-wrap: anywhere; }
td:nth-child(2) > code { white-space: nowrap; } pre { overflow: auto; } summary { cursor: pointer; }
.error, .fail { color: var(--bad); font-weight: 600; } .warning, .skip { color: var(--warn); }
.pass, .ready { color: var(--ok); font-weight: 600; }
.verdict { font-size: 1.2rem; padding: .8rem 1rem; border: 2px solid; border-radius: .5rem; }
.hint { opacity: .8; }
figure { display: inline-block; margin: .3rem; } figure img { max-width: 18rem; }
"""


def html_page(report: Report, card: str, images: Mapping[str, bytes]) -> str:
    """The whole page. card: the model card's Markdown; images: name -> PNG bytes."""
    return "\n".join(
        (
            "<!doctype html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(report.robot)}: report</title><style>{_STYLE}</style></head>",
            f"<body><main><h1>{escape(report.robot)}</h1>",
            _verdict(report),
            _pictures(images),
            f"<h2>Findings ({len(report.findings)})</h2>",
            _findings(report.findings),
            "<h2>Checks</h2>",
            _checks(report.checks),
            f"<h2>Model card</h2><pre>{escape(card)}</pre>",
            "</main></body></html>",
            "",
        )
    )


def _verdict(report: Report) -> str:
    verdict = report.verdict
    kind = "ready" if verdict.ready else "error"
    answer = "yes" if verdict.ready else "no"
    blocked = ", ".join(f"<code>{escape(rule)}</code>" for rule in verdict.blocked_by)
    parts = [f"Ready for training: {answer}."]
    if blocked:
        parts.append(f"Blocked by {blocked}.")
    parts.append(f"Next: {escape(verdict.next_step)}.")
    return f'<p class="verdict {kind}" role="status">{" ".join(parts)}</p>'


def _pictures(images: Mapping[str, bytes]) -> str:
    figures = []
    for name, png in sorted(images.items()):
        data = base64.b64encode(png).decode("ascii")
        caption = escape(name.removesuffix(".png").replace("_", " "))
        figures.append(
            f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">'
            f"<figcaption>{caption}</figcaption></figure>"
        )
    return "".join(figures)


def _findings(findings: tuple[Finding, ...]) -> str:
    """What matters in the open; what merely informs folded away."""
    loud = [finding for finding in findings if finding.severity != "info"]
    quiet = [finding for finding in findings if finding.severity == "info"]
    parts = [_finding_table(loud) if loud else "<p>No errors and no warnings.</p>"]
    if quiet:
        summary = f"<summary>{len(quiet)} for information</summary>"
        parts.append(f"<details>{summary}{_finding_table(quiet)}</details>")
    return "".join(parts)


def _finding_table(findings: list[Finding]) -> str:
    rows = []
    for finding in findings:
        because = finding.data.get("because")
        waived = f'<br><span class="hint">waived: {escape(str(because))}</span>' if because else ""
        hint = f'<br><span class="hint">{escape(finding.hint)}</span>' if finding.hint else ""
        rows.append(
            f'<tr><td class="{finding.severity}">{finding.severity}</td>'
            f"<td><code>{escape(finding.rule)}</code></td>"
            f"<td>{escape(finding.subject)}<br><code>{escape(finding.where)}</code></td>"
            f"<td>{escape(finding.message)}{hint}{waived}</td></tr>"
        )
    head = "<tr><th>Severity</th><th>Rule</th><th>Where</th><th>What</th></tr>"
    return f"<table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>"


def _checks(checks: Mapping[str, CheckResult]) -> str:
    rows = []
    for name, check in sorted(checks.items()):
        figures = "<br>".join(_figure(key, v) for key, v in sorted(check.figures.items()))
        rows.append(
            f'<tr><td>{escape(name)}</td><td class="{check.status}">{check.status}</td>'
            f"<td>{escape(check.note)}{figures}</td></tr>"
        )
    head = "<tr><th>Check</th><th>Status</th><th>Figures</th></tr>"
    return f"<table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>"


def _figure(key: str, value: object) -> str:
    """A number with its name; a list of rows as a table of its own."""
    rows = [row for row in value if isinstance(row, dict)] if isinstance(value, list) else []
    if not rows or len(rows) != len(list(value)):  # type: ignore[call-overload] # a list, see above
        return f"{escape(key)}: {escape(_shown(value))}"
    columns = sorted(rows[0], key=lambda c: (_FIRST.index(c) if c in _FIRST else len(_FIRST), c))
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(_shown(row.get(c)))}</td>" for c in columns) + "</tr>"
        for row in rows
    )
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f"<details><summary>{escape(key)} ({len(rows)})</summary>{table}</details>"


def _shown(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
