"""What the console may show where everybody reads it: a CI job's log is a public page.

PhysX's licence does not let its figures be published. At home they are the user's own.
"""

from __future__ import annotations

import os
from pathlib import Path

from assetbuild.cli.values import given_as
from assetbuild.findings import Finding
from assetbuild.report.document import Report
from assetbuild.report.summary import WITHHELD, public_message, public_rows
from assetbuild.report.verdict import Verdict, verdict_rows


def in_public() -> bool:
    """Whether the log of this command is published: CI services set `CI`."""
    return bool(os.environ.get("CI") or os.environ.get("GITHUB_ACTIONS"))


def shown_message(finding: Finding) -> str:
    """The finding's message; in CI without PhysX's figures."""
    return public_message(finding) if in_public() else finding.message


def shown_next_step(report: Report) -> str:
    """The verdict's next step, which may end in the message of a finding."""
    text = report.verdict.next_step
    for finding in report.findings if in_public() else ():
        if finding.message and text.endswith(finding.message):
            return text.removesuffix(finding.message) + public_message(finding)
    return text


def shown_rows(verdict: Verdict, recipe: Path) -> tuple[tuple[str, str], ...]:
    """The verdict's parts; in CI without figures of PhysX.

    recipe: as it was given, so that the commands work where they are printed.
    """
    rows = public_rows(verdict) if in_public() else verdict_rows(verdict)
    verb = "assetbuild smoke"
    named, given = f"{verb} {recipe.name} ", f"{verb} {given_as(recipe)} "
    return tuple((part, said.replace(named, given)) for part, said in rows)


def shown_seconds(label: str, seconds: float) -> str:
    """How long a step took; in CI not that of a check that runs PhysX."""
    hidden = in_public() and any(word in label for word in ("physx", "alignment", "isaaclab"))
    return "" if hidden else f"{seconds:.1f} s"


def shown_figures(simulator: str, text: str) -> str:
    """Figures of a trainer; in CI not those of Isaac Lab, which simulates with PhysX."""
    return WITHHELD if in_public() and simulator == "isaaclab" else text
