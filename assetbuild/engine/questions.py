"""Questions about the world, and how each one is asked: by a build, and again by the null build.

A question is (kind, subject, detail), its answer a text:

    bytes     path             SHA-256 of the file, behind all links
    kind      path             `file`, `folder` or `other`, behind all links; "" = nothing is there
    link      path             where the link leads, as it says; "" = no link
    names     folder, pattern  names in the folder that match, see `names_text`
    variable  name             `=` and the value of the environment variable; "" = not set
    stamp     path             what `stat` says of a file that nobody reads; "" = nothing is there

The null build imports this module: standard library only, heavy parts inside functions.
"""

# pathlib is not loaded on the way of the null build:
# ruff: noqa: PTH115, PTH116
from __future__ import annotations

import os
import stat

BYTES, KIND, LINK = "bytes", "kind", "link"
NAMES, VARIABLE, STAMP = "names", "variable", "stamp"
DEEP = "/"
"""Begins a pattern that all folders match, but for hidden ones."""
BUT = "/"
"""Before the ends of names that a pattern leaves out: no name holds it."""
BETWEEN = "\0"
"""Between the names of an answer: no name holds it."""

Question = tuple[str, str, str]


def answer(question: Question) -> str:
    """What the world says now; of `bytes` nothing, since who asks for them has a cache."""
    kind, subject, detail = question
    if kind == NAMES:
        return names_text(subject, detail)
    if kind == VARIABLE:
        value = os.environ.get(subject)
        return "" if value is None else f"={value}"
    if kind not in (KIND, LINK, STAMP):
        raise ValueError(f"no question: {kind}")
    try:
        if kind == LINK:
            return os.readlink(subject)
        status = os.stat(subject)
    except (OSError, ValueError):  # what cannot be looked at is not there
        return ""
    if kind == STAMP:
        return signature_text(status)
    if stat.S_ISREG(status.st_mode):
        return "file"
    return "folder" if stat.S_ISDIR(status.st_mode) else "other"


def signature_text(status: os.stat_result) -> str:
    """What identifies an unchanged file, as text."""
    return (
        f"{status.st_mtime_ns} {status.st_ctime_ns} {status.st_size} "
        f"{status.st_ino} {status.st_dev}"
    )


def pattern_of(
    starts: tuple[str, ...],
    ends: tuple[str, ...],
    *,
    deep: bool = False,
    but: tuple[str, ...] = (),
) -> str:
    """Names that begin with one of `starts` and end with one of `ends`, in whatever case.

    () = any. Give them in lower case. deep: and all folders. but: none that ends so, and no hidden
    file.
    """
    pattern = f"{DEEP if deep else ''}{'|'.join(starts)}*{'|'.join(ends)}"
    return f"{pattern}{BUT}{'|'.join(but)}" if but else pattern


def names_text(folder: str, pattern: str) -> str:
    """Names in a folder that match, sorted; a folder's ends in a slash.

    A link is no folder, wherever it leads. Hidden folders match nothing, nor do those that Python
    fills. A folder that cannot be read holds nothing.
    """
    deep = pattern.startswith(DEEP)
    wanted, _, unwanted = pattern.removeprefix(DEEP).partition(BUT)
    first, _, last = wanted.partition("*")
    starts, ends, but = tuple(first.split("|")), tuple(last.split("|")), tuple(unwanted.split("|"))
    names = []
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                name, lower = entry.name, entry.name.lower()
                is_folder = entry.is_dir(follow_symlinks=False)
                if is_folder and (name[0] == "." or name == "__pycache__"):
                    continue
                if not is_folder and unwanted and (name[0] == "." or lower.endswith(but)):
                    continue
                if (is_folder and deep) or (lower.startswith(starts) and lower.endswith(ends)):
                    names.append(f"{name}/" if is_folder else name)
    except (OSError, ValueError):
        return ""
    return BETWEEN.join(sorted(names))
