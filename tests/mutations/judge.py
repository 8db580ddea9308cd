"""What the product says of a bundle in which one file was changed."""

from __future__ import annotations

import json
import traceback
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from assetbuild.errors import AssetBuildError
from assetbuild.facts.compare import Difference, differences
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Table
from assetbuild.findings import Finding
from assetbuild.plugins import load_plugin, plugin_names
from tests.mutations.bundle import form_of

Word = Literal["found", "vague", "missed"]
"""found: a finding names subject, quantity and both values. vague: only that something is wrong:
a file is not readable, or an attribute has no known meaning. missed: nothing was said."""

Identity = tuple[str, str, str]
"""Rule, subject and data of a finding."""


@dataclass(frozen=True)
class Verdict:
    """How both judges did, and what `validate` said."""

    validate: Word
    diff: Word
    said: tuple[str, ...] = ()


@dataclass(frozen=True)
class Read:
    """What a reader made of the untouched bundle."""

    reader: Reader
    file: Path
    table: Table
    findings: frozenset[Identity]

    def news(self, findings: Iterable[Finding]) -> list[Finding]:
        """Those that the untouched bundle does not have, of any of its subjects."""
        return [finding for finding in findings if not _identities(finding) <= self.findings]


class Judge:
    """Compares a bundle with what it was when the judge first saw it."""

    def __init__(self, bundle: Path) -> None:
        """Reads all files of the untouched bundle."""
        self.bundle = bundle
        robot = json.loads((bundle / "manifest.json").read_bytes())["robot"]
        self.reference = Reference.of_bundle(bundle)
        self.reads: list[Read] = []
        for name in plugin_names(Reader):
            reader = load_plugin(Reader, name)(robot=robot)
            path = reader.file(bundle / reader.folder, robot)
            if path is not None:
                proof = reader.prove(self.reference, path)
                known = frozenset(one for f in proof.findings for one in _identities(f))
                self.reads.append(Read(reader, path, proof.found, known))

    @property
    def alarms(self) -> list[Identity]:
        """What the readers find in the untouched bundle."""
        return sorted(finding for read in self.reads for finding in read.findings)

    def ask(self, file: str) -> Verdict:
        """The verdict on the bundle as it lies now; `file` was changed."""
        if form_of(file) == "robot":
            return self._ask_robot()
        said: list[Finding] = []
        told: list[Difference] = []
        for read in self._concerned(file):
            if _word(said) == _diff_word(told) == "found":
                break  # the others read the same file, or files around it, once more
            try:
                proof = read.reader.prove(self.reference, read.file)
            except Exception:  # a reader that breaks is a finding of this run
                said.append(_crash(read))
                continue
            said += read.news(proof.findings)
            told += differences(read.table, proof.found, read.reader.precision)
        return Verdict(_word(said), _diff_word(told), tuple(map(_line, said)))

    def _concerned(self, file: str) -> list[Read]:
        """The readers of a file's format, first the one whose main file it is."""
        own = [r for r in self.reads if form_of(str(r.file.relative_to(self.bundle))) == form_of(file)]
        return sorted(own, key=lambda read: read.file != self.bundle / file)

    def _ask_robot(self) -> Verdict:
        """Of `report/robot.json`: every file is now compared with another robot."""
        said: list[Finding] = []
        told: list[Difference] = []
        try:
            reference = Reference.of_bundle(self.bundle)
            for merged in (False, True):
                before = robot_table(self.reference, merged=merged)
                after = robot_table(reference, merged=merged)
                told += differences(before, after, self.reads[0].reader.precision)
        except AssetBuildError:
            return Verdict("vague", "vague", ("the robot is not readable",))
        except Exception:
            last = traceback.format_exc().strip().splitlines()[-1]
            return Verdict("missed", "missed", (f"crash: {last}",))
        for read in self.reads:
            try:
                proof = _remembering(read).prove(reference, read.file)
                said += read.news(proof.findings)
            except Exception:
                said.append(_crash(read))
        return Verdict(_word(said), _diff_word(told), tuple(map(_line, said)))


def _remembering(read: Read) -> Reader:
    """The reader with the table of the file, which did not change."""
    own = type(read.reader)
    kind = type(own.__name__, (own,), {"read": lambda self, path: read.table, "__module__": __name__})
    made: Reader = kind(robot=read.reader.robot)
    return made


def _crash(read: Read) -> Finding:
    last = traceback.format_exc().strip().splitlines()[-1]
    return Finding("crash", "error", read.reader.form, last)


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


def _diff_word(told: Iterable[Difference]) -> Word:
    return "found" if list(told) else "missed"


def _line(finding: Finding) -> str:
    return f"{finding.rule}: {finding.subject}: {finding.message}"
