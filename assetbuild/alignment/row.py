"""Rows of the form: two values, how far apart they are, two limits, one verdict."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from assetbuild.findings import Finding, Rule, known, rounded

Rank = Literal["HIGH", "MEDIUM"]

HINTS: Mapping[str, str] = {
    "sine_as_is PhysX": "where kd dt is large beside the joint's inertia, its joint friction "
    "sticks: "
    "give the joint its motor's armature, or raise `usd.articulation.solver_position_iterations`",
    "stand_height": "do the soles start inside of the floor, or does a body touch another?",
}
SLOWER = (
    "a slower `validate.sine.frequency` compares both below the limit; a policy for both engines "
    "must stay below it too"
)
SOFT = (
    "both are what the engines do: the motor's armature on the joint makes MuJoCo's constraint "
    "harder; else randomize `friction`"
)


@dataclass(frozen=True)
class Row:
    """One line of the form.

    off: what the limits bound; share, m, s or rad as `unit` says. warn: infinite = only reported.
    because: a proven reason for the difference, which then is a warning at most; advice: its hint.
    """

    name: str
    rank: Rank
    subject: str
    mujoco: float | str
    theirs: float | str
    off: float
    warn: float
    error: float
    unit: str
    because: str = ""
    advice: str = ""

    @property
    def verdict(self) -> Literal["ok", "warning", "error", "told"]:
        """Judge it by the two limits; what is not a number is over both."""
        if self.warn == math.inf and not math.isnan(self.off):
            return "told"
        if not self.off <= self.error and not self.because:
            return "error"
        return "ok" if self.off <= self.warn else "warning"

    def shown(self, engine: str) -> dict[str, object]:
        """Return the figures, under the name of the other engine: no NaN, which JSON lacks."""
        off = known(rounded(self.off, self.warn))
        values = {"mujoco": known(self.mujoco), engine.lower(): known(self.theirs), "off": off}
        head = {"rank": self.rank, "row": self.name, "of": self.subject}
        reason = {"because": self.because} if self.because else {}
        return {**head, **values, "unit": self.unit, "verdict": self.verdict, **reason}


def findings_of(rows: Sequence[Row], off: Rule, engine: str) -> Iterator[Finding]:
    """One finding for each kind of row that is off: about the worst of its joints."""
    for name in dict.fromkeys(row.name for row in rows):
        bad = [row for row in rows if row.name == name and row.verdict in ("warning", "error")]
        if not bad:
            continue
        # What is not a number is worst.
        worst = max(bad, key=lambda row: (row.verdict == "error", math.isnan(row.off), row.off))
        usual = HINTS.get(name, "the report's table of the check has every row")
        more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
        limit = worst.error if worst.verdict == "error" else worst.warn
        yield off.named(name)(
            worst.subject,
            f"{worst.rank}: MuJoCo {_text(worst.mujoco)}, {engine} {_text(worst.theirs)}: "
            f"{worst.off:.3g} {worst.unit} apart, more than {limit:.3g}"
            f"{f'; {worst.because}' if worst.because else ''}{more}",
            severity="error" if worst.verdict == "error" else "warning",
            hint=worst.advice if worst.because else HINTS.get(f"{name} {engine}", usual),
            data={"rank": worst.rank, "off": known(worst.off), "rows": len(bad)},
        )


def _text(value: float | str) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
