"""What a build leaves for CI: events as JSON lines, JUnit, GitHub's summary and annotations."""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import IO, NamedTuple
from xml.etree import ElementTree

from assetbuild.engine.execute import Event
from assetbuild.errors import AssetBuildError, MachineError
from assetbuild.findings import is_consequence, worst_first
from assetbuild.pipeline.building import Outcome
from assetbuild.report.summary import markdown_text, public_message, summary
from assetbuild.report.tables import markdown_table, table


@contextmanager
def event_log(path: Path | None) -> Iterator[EventLog]:
    """The log at `path`, replaced; one that is thrown away without a path. MachineError."""
    with _writable(path, "w") if path else nullcontext() as file:
        yield EventLog(file)


class EventLog:
    """One JSON object per line: `event`, `at` (seconds since 1970), and what it tells."""

    def __init__(self, file: IO[str] | None) -> None:
        self._file = file

    def write(self, event: str, **details: object) -> None:
        """Add a line; readers may follow the file while the build runs."""
        if self._file is not None:
            line = {"event": event, "at": round(time.time(), 3), **details}
            self._file.write(json.dumps(line, sort_keys=True) + "\n")
            self._file.flush()

    def on_event(self, event: Event) -> None:
        """A step began or ended."""
        details: dict[str, object] = {"done": event.done, "total": event.total}
        result = event.result
        if event.label:
            details["step"] = event.label
        else:
            details["whole"] = event.whole
        if result is not None:
            details |= {"status": result.status, "seconds": result.seconds, "key": result.key}
            details |= {"reason": result.reason, "outputs": dict(result.outputs or {})}
            details["error"] = None if result.error is None else str(result.error)
        self.write(event.kind, **details)

    def on_outcome(self, outcome: Outcome) -> None:
        """A recipe is done."""
        report = outcome.report
        findings = () if report is None else report.findings
        self.write(
            "outcome",
            robot=outcome.loaded.recipe.robot,
            exit_code=outcome.exit_code,
            seconds=round(outcome.seconds, 3),
            bundle=None if outcome.out is None else str(outcome.out),
            ready=report is not None and report.verdict.ready,
            errors=[str(error) for error in outcome.errors],
            differences=[str(difference) for difference in outcome.differences],
            findings=[finding.to_json() for finding in findings],
        )


def write_junit(
    path: Path, outcomes: Sequence[Outcome], error: AssetBuildError | None = None
) -> None:
    """One suite per recipe; its cases are the checks, the errors found, and the failed steps.

    error: what kept the build from beginning. MachineError.
    """
    root = ElementTree.Element("testsuites")
    for outcome in outcomes:
        _add_suite(root, outcome.loaded.recipe.robot, list(_cases(outcome)))
    if error is not None:
        cases = [Case("build", "error", str(each)) for each in error.each()]
        _add_suite(root, "assetbuild", cases)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, "unicode")
    with _writable(path, "w") as file:
        file.write(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n')


class Case(NamedTuple):
    """kind: `failure`, `error`, `skipped`, or "" for a case that passed."""

    name: str
    kind: str
    message: str


def _add_suite(root: ElementTree.Element, name: str, cases: Sequence[Case]) -> None:
    kinds = Counter(case.kind for case in cases)
    counts = {"failures": kinds["failure"], "errors": kinds["error"], "skipped": kinds["skipped"]}
    attributes = {key: str(count) for key, count in {"tests": len(cases), **counts}.items()}
    suite = ElementTree.SubElement(root, "testsuite", {"name": name, **attributes})
    for case in cases:
        names = {"classname": name, "name": _printable(case.name)}
        one = ElementTree.SubElement(suite, "testcase", names)
        if case.kind:
            ElementTree.SubElement(one, case.kind, message=_printable(case.message.strip()))


def _cases(outcome: Outcome) -> Iterator[Case]:
    for label, result in outcome.results.items():
        if result.error is not None:
            yield Case(f"step {label}", "error", str(result.error))
    for difference in outcome.differences:
        yield Case(f"reproducible {difference.label}", "failure", str(difference))
    if outcome.report is None:
        return
    failed = "failure" if outcome.report.has_errors else "skipped"  # where its errors are waived
    for name, check in sorted(outcome.report.checks.items()):
        kind = {"fail": failed, "skip": "skipped"}.get(check.status, "")
        yield Case(f"check {name}", kind, check.note or check.status)
    only_warned = outcome.exit_code == 1 and not outcome.report.has_errors  # --fail-on warning
    for finding in outcome.report.findings:
        if finding.severity == ("warning" if only_warned else "error"):
            name = f"{finding.rule} {finding.subject}"
            yield Case(name, "failure", f"{finding.where} {public_message(finding)}")


def _printable(text: str) -> str:
    """Leave out what XML 1.0 cannot hold."""
    return "".join(c for c in text if c in "\t\n" or (c >= " " and not "\ud800" <= c <= "\udfff"))


def tell_github(outcomes: Sequence[Outcome], error: AssetBuildError | None = None) -> None:
    """Add to the job's summary, if GitHub names a file for it, and print annotations in a job.

    MachineError.
    """
    place, checkout = os.environ.get("GITHUB_STEP_SUMMARY"), workspace()
    if place:
        with _writable(Path(place), "a") as file:
            file.write(step_summary(outcomes, error))
    if checkout is not None:
        print("\n".join(annotation_lines(outcomes, checkout)), end="\n")


@contextmanager
def _writable(path: Path, mode: str) -> Iterator[IO[str]]:
    try:
        with path.open(mode, encoding="utf-8", errors="backslashreplace") as file:
            yield file
    except OSError as error:
        raise MachineError(f"cannot write `{path}`: {error.strerror or error}") from error


MOST_ANNOTATIONS = 10
"""Most annotations of one severity: GitHub shows no more from one step."""
LEVELS = ("error", "warning")


def step_summary(outcomes: Sequence[Outcome], error: AssetBuildError | None = None) -> str:
    """Markdown: a table with a row for each robot, then what each of them has to say."""
    head = ("robot", "ready", "checks", "errors", "warnings", "steps run", "seconds")
    rows = table("", head, map(_overview, outcomes))
    parts = [f"{markdown_table(rows)}\n"] if outcomes else []
    parts += [markdown(outcome) for outcome in outcomes]
    if error is not None:
        messages = "\n\n".join(_code(str(each)) for each in error.each())
        parts.append(f"### assetbuild: not built\n\n{messages}\n")
    return "\n".join(parts) + "\n"


def _overview(outcome: Outcome) -> tuple[object, ...]:
    """Return the row of one recipe."""
    ran = sum(result.status == "ran" for result in outcome.results.values())
    work = (f"{ran} of {len(outcome.results)}", f"{outcome.seconds:.1f}")
    robot, report = markdown_text(outcome.loaded.recipe.robot), outcome.report
    if report is None:
        return (robot, "not built", "", len(outcome.errors), "", *work)
    states = Counter(check.status for check in report.checks.values())
    counts = Counter(finding.severity for finding in report.findings)
    checks = f"{states['pass']} of {states['pass'] + states['fail']}"
    ready = "yes" if report.verdict.ready else "**no**"
    return (robot, ready, checks, counts["error"], counts["warning"], *work)


def markdown(outcome: Outcome) -> str:
    """Verdict, checks and findings of one recipe."""
    report = outcome.report
    if report is None:
        messages = "\n".join(_code(str(error)) for error in outcome.errors)
        return f"### {outcome.loaded.recipe.robot}: not built\n\n{messages}\n"
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
        for finding in worst_first(list(findings)):
            if finding.severity not in marks or is_consequence(finding):
                continue
            file, line = _place(outcome, finding.where, workspace)
            text = f"{finding.subject}: {public_message(finding)}"
            if finding.hint:
                text += f"\nhint: {finding.hint}"
            if file is None:
                file, text = recipe, f"{finding.where}: {text}" if finding.where else text
            marks[finding.severity].append(_mark(finding.severity, file, line, finding.rule, text))
    return [mark for level in LEVELS for mark in marks[level][:MOST_ANNOTATIONS]]


def _place(outcome: Outcome, where: str, workspace: Path) -> tuple[str | None, str]:
    """(file in the checkout, line) of `file:line` in the source or the recipe; None elsewhere."""
    name, _, line = where.partition(":")
    source, folder = outcome.loaded.recipe.source, outcome.loaded.path.parent
    for base in (folder / (source.path or ""), folder, Path.cwd()):
        file = (base / source.root / name) if source.path else base / name
        if name and file.is_file() and (path := _below(file, workspace)):
            return path, line.partition(":")[0]
    return None, ""


def _below(file: Path, workspace: Path) -> str | None:
    try:
        return file.resolve().relative_to(workspace.resolve()).as_posix()
    except ValueError:
        return None


def _mark(level: str, file: str | None, line: str, title: str, text: str) -> str:
    """`::error file=...,line=...::text`, with GitHub's own escapes."""
    parameters = {"file": file or "", "line": line, "title": title}
    properties = ",".join(f"{key}={_escaped(v, ':,')}" for key, v in parameters.items() if v)
    return f"::{level} {properties}::{_escaped(text, '')}"


def _escaped(text: str, more: str) -> str:
    return "".join(f"%{ord(c):02X}" if c in f"%\r\n{more}" else c for c in text)


def workspace() -> Path | None:
    """The checkout that GitHub Actions works in; None elsewhere."""
    if os.environ.get("GITHUB_ACTIONS") != "true":
        return None
    return Path(os.environ.get("GITHUB_WORKSPACE") or Path.cwd())
