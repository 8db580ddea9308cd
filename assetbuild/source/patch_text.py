"""One passage of a text of the source is replaced, before anything is read."""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.engine.step import Files, Step
from assetbuild.errors import SourceError
from assetbuild.findings import Finding, Rule

PATCHED = Rule(
    "source.patch",
    "info",
    "a passage of the source's text was replaced before it was read, as `source.patches` asks",
    "check that its reason still holds; tell the source's authors",
)
LONGEST = 1 << 26
"""Bytes of a file that is patched, and of what comes of it."""
SHOWN = 60
"""Characters of a passage in a message."""


class PatchText(Step):
    """`text` -> `text`. SourceError when the passage does not occur as often as it should."""

    outputs = ("text",)

    file: str
    """Path below the source's root, for messages."""
    find: str
    replace: str
    times: int = 1
    because: str

    def run(self, files: Files) -> Iterator[Finding]:
        """Line ends of the passage follow those of the file."""
        data = (files.inputs / "text").read_bytes()
        find, replace = (self._encoded(text, b"\r\n" in data) for text in (self.find, self.replace))
        count = data.count(find)
        if count != self.times:
            raise SourceError(
                f"`find` occurs {_often(count)} in `{self.file}`, not {_often(self.times)}: "
                f"`{_shortened(self.find)}`",
                hint=_ADVICE_MANY if count else _ADVICE_NONE,
            )
        if len(data) + count * (len(replace) - len(find)) > LONGEST:
            raise SourceError(f"`{self.file}` would grow beyond {LONGEST >> 20} MiB")
        (files.outputs / "text").write_bytes(data.replace(find, replace))
        line = data[: data.index(find)].count(b"\n") + 1
        yield PATCHED(
            "recipe source.patches",
            f"{self.file}:{line}: `{_shortened(self.find)}` was replaced by "
            f"`{_shortened(self.replace)}`"
            f"{f' {count} times' if count > 1 else ''}: {self.because}",
            data={"file": self.file, "line": line, "because": self.because, "times": count},
        )

    def _encoded(self, text: str, dos: bool) -> bytes:
        plain = text.replace("\r\n", "\n")
        return (plain.replace("\n", "\r\n") if dos else plain).encode()


def _often(count: int) -> str:
    return {0: "nowhere", 1: "once"}.get(count, f"{count} times")


def _shortened(text: str) -> str:
    """One line of at most `SHOWN` characters."""
    line = " ".join(text.split())
    return line if len(line) <= SHOWN else f"{line[: SHOWN - 3]}..."


_ADVICE_NONE = "copy the passage from the file, blanks and line breaks too; has the source changed?"
_ADVICE_MANY = "add text around it until it occurs once, or state `times`"
