"""What a reader of facts is: a plug-in that turns the files of one format into a table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from glob import escape
from pathlib import Path
from typing import Any, ClassVar

from pydantic import BaseModel, Field

from assetbuild.engine.step import Files
from assetbuild.errors import AssetBuildError, quoted
from assetbuild.facts.compare import Difference, Precision, differences, equality_findings
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key, Table
from assetbuild.facts.vocabulary import VOCABULARY
from assetbuild.findings import Finding, Rule, Severity
from assetbuild.grouping import grouped
from assetbuild.plugin_types import Check, RecipeView, Target, write_figures

UNREADABLE = Rule(
    "equal.unreadable",
    "error",
    "a file of the bundle cannot be read back",
    "if nobody edited the bundle, this is a bug: please report it",
)

BROKEN = (ValueError, TypeError, LookupError, ArithmeticError, AttributeError, RuntimeError)
"""What a reader runs into where a file is not of its format at all."""


SHOWN = 4
MOVES = frozenset(
    ("joint type", "joint axis", "joint lower", "joint upper", "joint mimics", "loop")
)
"""`kind` or `kind quantity`: without it the robot moves otherwise."""

LOST = Rule(
    "lost.*",
    ("error", "warning", "info"),
    "facts of the robot that a format cannot hold (error where it is simulated and moves otherwise "
    "without them, warning where it only describes the robot)",
    "take them from another format of the bundle",
)


class Lost(str):
    """Why a format lacks a fact; a plain text says instead where the format has it."""

    __slots__ = ()


def all_but(held: Iterable[str], reason: str) -> dict[str, str]:
    """A reason for every quantity but some. held: `kind quantity`, or a whole `kind`."""
    kept = {*held}
    names = [(kind, f"{kind} {name}") for kind, name in VOCABULARY]
    return {name: reason for kind, name in names if not {kind, name} & kept}


@dataclass(frozen=True)
class Proof:
    """What the comparison of one file with the robot gave."""

    found: Table
    differences: tuple[Difference, ...]
    findings: tuple[Finding, ...]
    compared: int


class Reader(Check):
    """Reads one format back and compares it with the robot: findings `equal.<form>.<quantity>`.

    It shares no code with the writer of its format.
    """

    group: ClassVar[str] = "facts.readers"
    reads: ClassVar[tuple[str, ...]] = (
        "links.json",
        "tree.json",
        "shapes.json",
        "control.json",
        "assets.json",
    )
    isolated: ClassVar[bool] = True
    format_id: ClassVar[str] = ""
    """The format's name in rules: `mjcf` in `equal.mjcf.mass`."""
    display_name: ClassVar[str] = ""
    """The format's name in sentences: "the MJCF"."""
    folder: ClassVar[str] = ""
    """Where a bundle keeps what the target writes at the top of its own folder."""
    file_globs: ClassVar[tuple[str, ...]] = ()
    """The files of a bundle that it reads, as globs, the main one first; `{robot}` is the robot's
    name."""
    suffixes: ClassVar[tuple[str, ...]] = ()
    """Endings of files that it may read when a person names one; none: only in a bundle."""
    precision: ClassVar[Precision] = Precision()
    lacks: ClassVar[Mapping[str, str]] = {}
    """`kind quantity`, or a whole `kind` -> why this format cannot say it; `Lost`: it goes without,
    which `facts.losses` reports."""
    simulated: ClassVar[bool] = True
    """Whether robots are simulated from this format; else it describes them."""
    recipe_sections: ClassVar[tuple[str, ...]] = ()
    """Sections of the recipe that decide how the format is written."""

    robot: str
    options: dict[str, Any] = Field(default_factory=dict)  # Any: plain JSON
    """Those sections."""

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any] | None:  # Any: values of its fields
        """Add the sections that it asks for."""
        values, options = super().values(recipe), stated_options(recipe, cls.recipe_sections)
        return None if values is None else values | {"options": options}

    def file(self, root: Path, robot: str) -> Path | None:
        """The main file below `root`, the target's folder; None where there is none."""
        main = Path(self.file_globs[0]).relative_to(self.folder)
        found = sorted(root.glob(str(main).replace("{robot}", escape(robot))))
        return found[0] if found and found[0].is_file() else None

    def read(self, path: Path) -> Table:
        """The facts of a file. AssetBuildError where it is not readable."""
        raise NotImplementedError

    def expected(self, reference: Reference) -> Table:
        """What the file must say: the robot's facts as far as the format holds them."""
        return robot_table(reference).only(self.holds)

    @classmethod
    def covers(cls, path: str, robot: str) -> bool:
        """Whether it reads a file of a bundle, by its path there."""
        return any(fnmatchcase(path, glob.replace("{robot}", robot)) for glob in cls.file_globs)

    @property
    def exactness(self) -> Precision:
        """How exactly this file must agree."""
        return self.precision

    def found(self, path: Path, reference: Reference) -> Table:
        """What is compared with `expected` of all that a file of this robot says."""
        return self.read(path).only(self.holds)

    @classmethod
    def why_not(cls, key: Key) -> str | None:
        """Why the format cannot say this; None where it can, as every word of its own."""
        reason = cls.lacks.get(f"{key.kind} {key.quantity}", cls.lacks.get(key.kind))
        return None if key.is_foreign else reason

    @classmethod
    def holds(cls, key: Key) -> bool:
        """Whether the format can say this."""
        return cls.why_not(key) is None

    def prove(self, reference: Reference, path: Path) -> Proof:
        """Compares a file with the robot."""
        try:
            known = self.found(path, reference)
            expected = self.expected(reference)
        except (AssetBuildError, *BROKEN) as error:  # a file may hold anything
            why, hint = f"{type(error).__name__}: {error}", ""
            if isinstance(error, AssetBuildError):
                why, hint = error.message, error.hint
            finding = UNREADABLE("robot", f"{self.display_name}: {why}", hint)
            return Proof(Table(), (), (finding,), 0)
        different = differences(expected, known, self.exactness)
        findings = [*equality_findings(different, self.format_id, self.display_name, known.places)]
        compared = len(dict.fromkeys((*expected.facts, *known.facts)))
        return Proof(known, tuple(different), tuple(findings), compared)

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads what the target wrote; figures: how many facts were compared and differ.

        What the format goes without is one finding besides.
        """
        reference = Reference.of_ports(files.inputs, self.options)
        path = self.file(files.inputs / self.needs[0], self.robot)
        if path is None:
            write_figures(files, {"facts": 0})
            yield UNREADABLE("robot", f"{self.display_name} is not there: its target wrote none")
            return
        proof = self.prove(reference, path)
        write_figures(files, {"facts": proof.compared, "differ": len(proof.differences)})
        yield from proof.findings
        if any(isinstance(reason, Lost) for reason in self.lacks.values()):
            yield from self.losses(robot_table(reference))

    @classmethod
    def losses(cls, table: Table) -> Iterator[Finding]:
        """One finding for all that the format goes without. table: all that the robot says."""
        lost = [
            key
            for key, value in table.facts.items()
            if isinstance(
                cls.lacks.get(f"{key.kind} {key.quantity}", cls.lacks.get(key.kind)), Lost
            )
            and value != VOCABULARY[key.kind, key.quantity].unstated
        ]
        if not lost:
            return
        moves = any({key.kind, f"{key.kind} {key.quantity}"} & MOVES for key in lost)
        severity: Severity = "info" if not moves else "error" if cls.simulated else "warning"
        parts, data = [], dict[str, int]()
        for kind, keys in grouped(lost, lambda key: key.kind).items():
            # `home/FR_hip_joint` is part of the keyframe `home`.
            names = (name.partition("/")[0] if kind == "keyframe" else name for _, name, _ in keys)
            subjects = dict.fromkeys(names)
            data[kind] = len(subjects)
            plural = "s" if len(subjects) > 1 else ""
            counted = f"{len(subjects)} {kind}{plural}" if any(subjects) else f"the {kind}"
            if kind not in cls.lacks:
                quantities = dict.fromkeys(key.quantity for key in keys)
                counted = f"{quoted(quantities, SHOWN)} of {counted}"
            elif any(subjects):
                counted = f"{counted} ({quoted(subjects, SHOWN)})"
            parts.append(counted)
        text = f"{cls.display_name} lacks {'; '.join(parts)}"
        yield LOST.named(cls.format_id)("robot", text, severity=severity, data=data)


def asked_sections(
    readers: Iterable[type[Reader]], writers: Iterable[type[Target]]
) -> tuple[str, ...]:
    """What a bundle keeps of its recipe: for its readers, and to be written again."""
    asked = {section for reader in readers for section in reader.recipe_sections}
    paths = {path for writer in writers for path in writer.recipe_fields.values()}
    return tuple(sorted(asked | {path for path in paths if path.partition(".")[0] not in asked}))


def stated_options(recipe: RecipeView, sections: tuple[str, ...]) -> dict[str, Any]:  # Any: JSON
    """Sections of a recipe as plain data; one that it cannot have is left out."""
    options: dict[str, Any] = {}  # Any: as above
    for section in sections:
        with suppress(KeyError):
            value = recipe.value(section)
            options[section] = (
                value.model_dump(mode="json", by_alias=True)
                if isinstance(value, BaseModel)
                else value
            )
    return options
