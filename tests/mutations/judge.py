"""What the product says of a bundle in which one file was changed."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from assetbuild.errors import AssetBuildError
from assetbuild.facts.reference import Reference
from assetbuild.findings import Finding
from assetbuild.pipeline.again import prove_again
from assetbuild.report.diff import Change, changes
from assetbuild.report.sides import Side, bundle_readers, bundle_side
from tests.mutations.bundle import form_of

Word = Literal["found", "vague", "missed"]
"""found: a finding names subject, quantity and both values. vague: only that something is wrong:
a file is not readable, or an attribute has no known meaning. missed: nothing was said."""

Identity = tuple[str, str, str]
"""Rule, subject and data of a finding."""


@dataclass(frozen=True)
class Verdict:
    """How both judges did, what `validate` said, and the rows of `diff`."""

    validate: Word
    diff: Word
    said: tuple[str, ...] = ()
    told: tuple[str, ...] = ()


@dataclass(frozen=True)
class Read:
    """What a reader made of the untouched bundle."""

    form: str
    file: Path
    findings: frozenset[Identity]

    def news(self, findings: Iterable[Finding]) -> list[Finding]:
        """Those that the untouched bundle does not have, of any of its subjects."""
        return [finding for finding in findings if not _identities(finding) <= self.findings]


class Judge:
    """Compares a bundle with what it was when the judge first saw it."""

    def __init__(self, bundle: Path, untouched: Path) -> None:
        """Reads all files of the untouched bundle. bundle: the copy that will be changed."""
        self.bundle = bundle
        self.robot = str(json.loads((bundle / "manifest.json").read_bytes())["robot"])
        self.before = _side(untouched)
        reference = Reference.of_bundle(bundle)
        self.reads: list[Read] = []
        for form, reader, file in bundle_readers(bundle, self.robot, reference):
            findings = reader.prove(reference, file).findings
            known = frozenset(one for finding in findings for one in _identities(finding))
            self.reads.append(Read(form, file, known))

    @property
    def alarms(self) -> list[Identity]:
        """What the readers find in the untouched bundle."""
        return sorted(finding for read in self.reads for finding in read.findings)

    def ask(self, file: str) -> Verdict:
        """The verdict on the bundle as it lies now; `file` was changed."""
        said = self._validate(file)
        rows = self._diff()
        told = [f"diff: {', '.join(row.subjects)}: {row.quantity}" for row in rows]
        return Verdict(_word(said), _diff_word(rows), tuple(map(_line, said)), tuple(told))

    def _written_again(self) -> list[Finding]:
        """What the writers write otherwise; information is no finding here."""
        try:
            found = prove_again(self.bundle, self.robot, Reference.of_bundle(self.bundle))
            return [finding for finding in found if finding.severity != "info"]
        except Exception as error:
            return [_broken("again", error)]

    def _validate(self, file: str) -> list[Finding]:
        """What the comparison of every file with the bundle's robot says now, and did not."""
        try:
            reference = Reference.of_bundle(self.bundle)
            found = bundle_readers(self.bundle, self.robot, reference)
            readers = {form: reader for form, reader, _ in found}
        except AssetBuildError as error:
            return [_broken("robot", error)]
        said: list[Finding] = []
        for read in self._concerned(file):
            if _word(said) == "found":
                break  # the others read the same file, or files around it, once more
            try:
                said += read.news(readers[read.form].prove(reference, read.file).findings)
            except Exception as error:  # a reader that breaks is a finding of this run
                said.append(_broken(read.form, error))
        return said if _word(said) == "found" else said + self._written_again()

    def _concerned(self, file: str) -> list[Read]:
        """The readers of a file, first the one whose main file it is; of the robot's own, all."""
        if form_of(file) == "robot":
            return self.reads
        own = [read for read in self.reads if file in self.before.forms[read.form].covers]
        return sorted(own, key=lambda read: read.file != self.bundle / file)

    def _diff(self) -> list[Change]:
        try:
            return list(changes(self.before, bundle_side(self.bundle)).rows)
        except Exception as error:
            return [Change("CRITICAL", ("file",), str(error), "", "")]


def _side(untouched: Path) -> Side:
    """The untouched bundle for `diff`; each table is read once."""
    side = bundle_side(untouched)
    read = {n: replace(f, read=functools.cache(f.read)) for n, f in side.forms.items()}
    return replace(side, forms=read)


def _broken(form: str, error: Exception) -> Finding:
    """What an error of ours says is said; another one is no answer."""
    if isinstance(error, AssetBuildError):
        return Finding("equal.unreadable", "error", "robot", error.message)
    return Finding("crash", "error", form, repr(error))


def _identities(finding: Finding) -> frozenset[Identity]:
    """One for each subject that a finding is about, in whatever order it names them."""
    data = {key: value for key, value in finding.data.items() if key != "subjects"}
    text = json.dumps(data, sort_keys=True, default=str)
    several = finding.data.get("subjects")
    subjects = several if isinstance(several, tuple) else (finding.subject,)
    return frozenset((finding.rule, str(subject), text) for subject in subjects)


def names_both_values(finding: Finding) -> bool:
    """Whether it says of whom, what, what it is and what it should be."""
    family, *quantity = finding.rule.split(".", maxsplit=2)
    if family != "equal" or len(quantity) < 2 or not finding.subject:
        return False
    if quantity[1] in ("missing", "extra"):
        return True
    data: Mapping[str, object] = finding.data
    return {"expected", "found"} <= data.keys() and data["expected"] != data["found"]


def _word(said: Iterable[Finding]) -> Word:
    findings = list(said)
    if any(map(names_both_values, findings)):
        return "found"
    return "vague" if any(f.rule != "crash" for f in findings) else "missed"


def _diff_word(rows: Sequence[Change]) -> Word:
    """A row about a file names a line of text, and no quantity of a subject."""
    if any(not row.subjects[0].startswith("file") for row in rows):
        return "found"
    return "vague" if rows else "missed"


def _line(finding: Finding) -> str:
    return f"{finding.rule}: {finding.subject}: {finding.message}"
