"""Other people's programs that judge a built file: a command, and what its report means."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Files, Limits
from assetbuild.engine.world import World
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule, Severity
from assetbuild.kinds import Check, write_figures
from assetbuild.simulators.children import environment, last_line
from assetbuild.simulators.consumers import ConsumerCheck

REPORT = "../report.json"
"""Where a program may write its report, seen from the folder it runs in; else it prints it."""
SEVERITIES: Mapping[str, Severity] = {"error": "error", "warning": "warning", "warn": "warning"}


def severity_of(word: str) -> Severity:
    """Ours for theirs; what is neither an error nor a warning informs."""
    return SEVERITIES.get(word.lower(), "info")


class ForeignTool(Check):
    """Runs a program on a copy of a target's folder; one that breaks is a finding."""

    reads: ClassVar[tuple[str, ...]] = ()
    no_report: ClassVar[Rule]

    words: ClassVar[tuple[str, ...]]
    """Words after `python -P`, in the folder of the target; `{tool.robot}` is a field of it."""

    robot: str
    """Name of the robot: the stem of the main file."""

    def command(self) -> Sequence[str]:
        """Those words, of this robot."""
        return [word.format(tool=self) for word in self.words]

    def judge(self, report: str, figures: dict[str, object]) -> Iterator[Finding]:
        """The report's findings; puts its numbers into `figures`.

        ValueError, LookupError or TypeError: it is no report.
        """
        raise NotImplementedError

    def interpreter(self) -> Path:
        """The Python that has the program."""
        return Path(sys.executable)

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: none where there is no report."""
        report, failure = self._said(files.inputs / self.needs[0])
        figures: dict[str, object] = {}
        try:
            findings = [*self.judge(report, figures)]
        except (ValueError, LookupError, TypeError) as error:
            why = failure or f"it is not as expected: {error}"
            findings = [self.no_report("robot", f"{self.no_report.meaning}: {why}")]
        write_figures(files, figures)
        yield from findings

    def _said(self, folder: Path) -> tuple[str, str]:
        """Its report, and the last line that it says."""
        with tempfile.TemporaryDirectory(prefix="foreign-") as scratch:
            # A program that resolves links would find the store's files, each in another folder.
            place = Path(shutil.copytree(folder, Path(scratch).resolve() / "files"))
            try:
                done = subprocess.run(
                    [str(self.interpreter()), "-P", *self.command()],
                    cwd=place,
                    env=environment(),
                    stdin=subprocess.DEVNULL,
                    capture_output=True,
                    check=False,
                    timeout=self.limits.wall_s,
                )
            except subprocess.TimeoutExpired:
                return "", f"it took more than {self.limits.wall_s:g} s"
            report = place / REPORT
            said = report.read_bytes() if report.exists() else done.stdout
        return said.decode("utf-8", "replace"), last_line(done.stderr or done.stdout)


class Validator(ForeignTool, ConsumerCheck):
    """A validator of USD, in an environment of its own: its OpenUSD or numpy clashes with ours."""

    needs: ClassVar[tuple[str, ...]] = ("usd",)
    limits: ClassVar[Limits] = Limits(wall_s=600.0)

    def interpreter(self) -> Path:
        """That of its environment."""
        python = self.home.python(World())
        if python is None:
            raise StepError(f"the environment of {self.consumer} is not there", hint=self.absent())
        return python
