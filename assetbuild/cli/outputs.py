"""What a build leaves for CI: events as JSON lines, JUnit; `github.py` has GitHub's own."""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, NamedTuple
from xml.etree import ElementTree

from assetbuild.cli.github import annotation_lines, step_summary, workspace
from assetbuild.engine.execute import Event
from assetbuild.errors import AssetBuildError, MachineError
from assetbuild.pipeline.building import Outcome
from assetbuild.report.summary import public_message


@contextmanager
def event_log(path: Path | None) -> Iterator[EventLog]:
    """The log at `path`, replaced; one that is thrown away without a path. MachineError."""
    if path is None:
        yield EventLog(None)
        return
    with _writable(path, "w") as file:
        yield EventLog(file)


class EventLog:
    """One JSON object per line: `event`, `at` (seconds since 1970), and what it tells."""

    def __init__(self, file: IO[str] | None) -> None:
        self._file = file

    def write(self, event: str, **told: object) -> None:
        """Add a line; readers may follow the file while the build runs."""
        if self._file is not None:
            line = {"event": event, "at": round(time.time(), 3), **told}
            self._file.write(json.dumps(line, sort_keys=True) + "\n")
            self._file.flush()

    def on_event(self, event: Event) -> None:
        """A step began or ended."""
        told: dict[str, object] = {"done": event.done, "total": event.total}
        result = event.result
        if event.label:
            told["step"] = event.label
        else:
            told["whole"] = event.whole
        if result is not None:
            told |= {"status": result.status, "seconds": result.seconds, "key": result.key}
            told |= {"reason": result.reason, "outputs": dict(result.outputs or {})}
            told["error"] = None if result.error is None else str(result.error)
        self.write(event.kind, **told)

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
    told = {key: str(count) for key, count in {"tests": len(cases), **counts}.items()}
    suite = ElementTree.SubElement(root, "testsuite", {"name": name, **told})
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
    for name, check in sorted(outcome.report.checks.items()):
        kind = {"fail": "failure", "skip": "skipped"}.get(check.status, "")
        yield Case(f"check {name}", kind, check.note or check.status)
    for finding in outcome.report.findings:
        if finding.severity == "error":
            name = f"{finding.rule} {finding.subject}"
            yield Case(name, "failure", f"{finding.where} {public_message(finding)}")


def _printable(text: str) -> str:
    """Without what XML 1.0 cannot hold."""
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
