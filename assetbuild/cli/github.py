"""What a build leaves for GitHub Actions: a summary with a row for each robot, annotations."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from assetbuild.errors import AssetBuildError
from assetbuild.findings import is_consequence, worst_first
from assetbuild.pipeline.building import Outcome
from assetbuild.report.summary import markdown_cell, public_message, summary

MOST_ANNOTATIONS = 10
"""Of each severity: GitHub shows no more from one step."""
LEVELS = ("error", "warning")


def step_summary(outcomes: Sequence[Outcome], error: AssetBuildError | None = None) -> str:
    """Markdown: a table with a row for each robot, then what each of them has to say."""
    parts = ["\n".join(_overview(outcomes))] if outcomes else []
    parts += [markdown(outcome) for outcome in outcomes]
    if error is not None:
        told = "\n\n".join(_code(str(each)) for each in error.each())
        parts.append(f"### assetbuild: not built\n\n{told}\n")
    return "\n".join(parts) + "\n"


def _overview(outcomes: Sequence[Outcome]) -> Iterator[str]:
    yield "| robot | ready | checks | errors | warnings | steps run | seconds |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for outcome in outcomes:
        ran = sum(result.status == "ran" for result in outcome.results.values())
        work = (f"{ran} of {len(outcome.results)}", f"{outcome.seconds:.1f}")
        robot, report = markdown_cell(outcome.loaded.recipe.robot), outcome.report
        if report is None:
            cells = (robot, "not built", "", str(len(outcome.errors)), "", *work)
        else:
            states = Counter(check.status for check in report.checks.values())
            found = Counter(finding.severity for finding in report.findings)
            checks = f"{states['pass']} of {states['pass'] + states['fail']}"
            ready = "yes" if report.verdict.ready else "**no**"
            cells = (robot, ready, checks, f"{found['error']}", f"{found['warning']}", *work)
        yield f"| {' | '.join(cells)} |"
    yield ""


def markdown(outcome: Outcome) -> str:
    """Verdict, checks and findings of one recipe."""
    report = outcome.report
    if report is None:
        told = "\n".join(_code(str(error)) for error in outcome.errors)
        return f"### {outcome.loaded.recipe.robot}: not built\n\n{told}\n"
    return summary(report, *(f"- {difference}" for difference in outcome.differences))


def _code(text: str) -> str:
    return "\n".join(f"    {line}" for line in text.splitlines())


# --- annotations ----------------------------------------------------------------------------


def annotation_lines(outcomes: Sequence[Outcome], workspace: Path) -> list[str]:
    """GitHub's commands that mark errors and warnings at their file and line.

    workspace: the checkout; what lies in an archive or elsewhere is marked at the recipe.
    """
    marks: dict[str, list[str]] = {level: [] for level in LEVELS}
    for outcome in outcomes:
        recipe = _below(outcome.loaded.path, workspace)
        for error in outcome.errors:
            marks["error"].append(_mark("error", recipe, "", "assetbuild", str(error)))
        findings = () if outcome.report is None else outcome.report.findings
        for found in worst_first(list(findings)):
            if found.severity not in marks or is_consequence(found):
                continue
            file, line = _place(outcome, found.where, workspace)
            text = f"{found.subject}: {public_message(found)}"
            if found.hint:
                text += f"\nhint: {found.hint}"
            if file is None:
                file, text = recipe, f"{found.where}: {text}" if found.where else text
            marks[found.severity].append(_mark(found.severity, file, line, found.rule, text))
    return [mark for level in LEVELS for mark in marks[level][:MOST_ANNOTATIONS]]


def _place(outcome: Outcome, where: str, workspace: Path) -> tuple[str | None, str]:
    """(file in the checkout, line) of `file:line` in the source or the recipe; None elsewhere."""
    name, _, line = where.partition(":")
    source, folder = outcome.loaded.recipe.source, outcome.loaded.path.parent
    for base in (folder / (source.path or ""), folder, Path.cwd()):
        file = (base / source.root / name) if source.path else base / name
        if name and file.is_file() and (found := _below(file, workspace)):
            return found, line.partition(":")[0]
    return None, ""


def _below(file: Path, workspace: Path) -> str | None:
    try:
        return file.resolve().relative_to(workspace.resolve()).as_posix()
    except ValueError:
        return None


def _mark(level: str, file: str | None, line: str, title: str, text: str) -> str:
    """`::error file=...,line=...::text`, with GitHub's own escapes."""
    told = {"file": file or "", "line": line, "title": title}
    properties = ",".join(f"{key}={_escaped(v, ':,')}" for key, v in told.items() if v)
    return f"::{level} {properties}::{_escaped(text, '')}"


def _escaped(text: str, more: str) -> str:
    return "".join(f"%{ord(c):02X}" if c in f"%\r\n{more}" else c for c in text)


def workspace() -> Path | None:
    """The checkout that GitHub Actions works in; None elsewhere."""
    if os.environ.get("GITHUB_ACTIONS") != "true":
        return None
    return Path(os.environ.get("GITHUB_WORKSPACE") or Path.cwd())
