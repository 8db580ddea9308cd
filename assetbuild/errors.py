"""Errors, one class per person who must act; each builds its own sentence.

An error stops the build. What only informs is a `Finding` (see `findings.py`).
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True, slots=True)
class Where:
    """A place in a file that the user wrote; lines and columns count from 1, 0 = unknown."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        parts = [self.file]
        if self.line:
            parts.append(str(self.line))
            if self.column:
                parts.append(str(self.column))
        return ":".join(parts)


class AssetBuildError(Exception):
    """Base of all errors that a user can cause: what, where, next move."""

    exit_code: ClassVar[int] = 1

    def __init__(self, message: str, *, where: Where | None = None, hint: str = "") -> None:
        super().__init__(message, where, hint)
        self.message = message
        self.where = where
        self.hint = hint
        self.also: tuple[AssetBuildError, ...] = ()
        self.uncounted = 0

    def __str__(self) -> str:
        text = f"{self.where}: {self.message}" if self.where else self.message
        return f"{text}\nhint: {self.hint}" if self.hint else text

    def each(self) -> tuple[AssetBuildError, ...]:
        """This error and those that `Gather` found with it; `uncounted` more were left out."""
        return (self, *self.also)

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (type(self), self.args, vars(self) | {"also": (), "uncounted": 0})


def _rebuild(
    cls: type[AssetBuildError], args: tuple[object, ...], kept: Mapping[str, object]
) -> AssetBuildError:
    error = cls.__new__(cls, *args)
    vars(error).update(kept)
    return error


class UsageError(AssetBuildError):
    """The command line is wrong."""

    exit_code = 2


class RecipeError(AssetBuildError):
    """The author of the recipe must act."""

    exit_code = 2


class SourceError(AssetBuildError):
    """The robot's description (URDF, xacro, archive, paths) is wrong; nothing can be built."""

    exit_code = 2


class LockError(AssetBuildError):
    """The lock file and what was found do not agree."""

    exit_code = 2


class OutOfDateError(AssetBuildError):
    """Something that should have been up to date is not (`check`, `--frozen`)."""

    exit_code = 3


class StepError(AssetBuildError):
    """A step failed on what it was given, or crashed, or ran over a limit."""

    exit_code = 1


class MachineError(AssetBuildError):
    """This machine lacks something: disk space, a permission, an optional package."""

    exit_code = 1


ALIKE = 0.75
"""Share of letters in common from which on a name counts as misspelt (see `difflib`)."""


ALIKE_STEM = 0.5
"""The share from which on the name of a file, without its ending, counts as misspelt."""


class Gather:
    """Collects what independent checks raise, so that one run names every mistake.

    `with wrong: check()` for each of them, then `wrong.stop()`.
    """

    def __init__(self, kind: type[AssetBuildError]) -> None:
        self._kind = kind
        self.gathered: list[AssetBuildError] = []
        self._uncounted = 0

    def __enter__(self) -> None:
        """Nothing is needed to begin."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        """Keep an error of the kind that is collected; others pass."""
        if not isinstance(error, self._kind):
            return False
        self.gathered += error.each()
        self._uncounted = max(self._uncounted, error.uncounted)  # variants repeat each other
        return True

    def stop(self, uncounted: int = 0) -> None:
        """Raise the first error in file order, with the others in `also`; none, if there is none.

        uncounted: errors that were found and are not worth a sentence each.
        """
        files = list(
            dict.fromkeys(error.where.file if error.where else "" for error in self.gathered)
        )

        def place(error: AssetBuildError) -> tuple[int, int, int]:
            at = error.where or Where("")
            return files.index(at.file), at.line, at.column

        ordered = sorted({str(error): error for error in self.gathered}.values(), key=place)
        if ordered:
            first, *others = ordered
            first.also = tuple(others)
            first.uncounted = max(self._uncounted, uncounted)
            raise first


def did_you_mean(wrong: str, known: Iterable[str]) -> str:
    """A hint that names what was meant, or lists `known` when no name is near."""
    names = sorted(set(known))
    near = nearest(wrong, names)
    if near is not None:
        return f"did you mean `{near}`?"
    return f"known: {quoted(names, 12)}" if names else ""


def quoted(
    names: Iterable[str], most: int, more: str = ", ...", notes: Mapping[str, str] | None = None
) -> str:
    """`a`, `b`, ...: at most so many names. more: for the others, with `{}` for their number.

    notes: what to say of each name: `a` (30), `b` (5), ...
    """
    each = [f"`{name}` ({notes[name]})" if notes else f"`{name}`" for name in names]
    return ", ".join(each[:most]) + (more.format(len(each) - most) if len(each) > most else "")


_PLAIN = re.compile(r"([\w.|/()\[\]-]|(?<!\))\*){1,100}")
"""Patterns that can be put into others: they refer to no group and repeat none."""


def meant_pattern(pattern: str, known: Iterable[str]) -> str:
    """A hint for a pattern that matches none of `known`, such as a part of a name or a shell's."""
    names = sorted(set(known))
    if not _PLAIN.fullmatch(pattern) or pattern.count("*") > 4:
        return did_you_mean(pattern, names)
    text = re.sub(r"(?<![.\])])\*", ".*", pattern)
    text = f"({text})" if "|" in text else text
    for meant in (text, f"{text}.*", f".*{text}", f".*{text}.*"):
        if sum(bool(re.fullmatch(meant, name)) for name in names) > 1:
            return f"did you mean `{meant}`? a pattern matches whole names"
    return did_you_mean(pattern, names)


def nearest(wrong: str, known: Iterable[str]) -> str | None:
    """The one of `known` that `wrong` misspells, shortens, or names in another folder."""
    names = sorted(set(known))
    word = wrong.lower()
    same = [name for name in names if name.lower() == word]
    same = same or [name for name in names if word and _file(name) == _file(word)]
    if same:
        return same[0]
    by_word = {name.lower(): name for name in names}
    if "." in _file(word):  # a folder or an ending in common makes no files alike
        by_word = {
            name: by_word[name]
            for name in by_word
            if _common(_file(word), _file(name)) >= ALIKE
            and _common(_stem(word), _stem(name)) >= ALIKE_STEM
        }
    close = difflib.get_close_matches(word, by_word, n=1, cutoff=ALIKE)
    if close:
        return by_word[close[0]]
    longer = [name for name in names if len(word) > 2 and name.lower().startswith(word)]
    return longer[0] if len(longer) == 1 else None


def _file(path: str) -> str:
    return path.rpartition("/")[2].lower()


def _common(wrong: str, name: str) -> float:
    return difflib.SequenceMatcher(None, name, wrong).ratio()


def _stem(path: str) -> str:
    name = _file(path)
    return name.rpartition(".")[0] or name


def counted(number: int, one: str, many: str = "") -> str:
    """`1 body`, `2 bodies`. many: default, `one` with an s."""
    return f"{number} {one if number == 1 else many or f'{one}s'}"


def one_line(error: object, most: int = 200) -> str:
    """What an error of another library says, without line breaks."""
    return " ".join(str(error).split())[:most]
