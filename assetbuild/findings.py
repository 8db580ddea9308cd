"""Findings about a robot, as data: rule, severity, subject, numbers, next move.

A `Rule` is declared once, beside the code that finds it, and makes its findings:

    SAG = Rule("stand.sag", "warning", "the base sinks more than allowed", "raise kp")
    ...
    yield SAG("robot", f"base height changed by {sag:.3g} m", data={"sag_m": sag})

Findings are cached with the result of the step that made them and replayed on a warm build,
so they carry the name of what they speak of (`subject`), not its line: the report looks the
line up in the source map of the day.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from fnmatch import fnmatchcase
from math import floor, isfinite, log10
from types import ModuleType
from typing import Literal, TypeVar, get_args

T = TypeVar("T")
Severity = Literal["error", "warning", "info"]
Scalar = float | int | str | bool | None
Data = Mapping[str, Scalar | tuple[Scalar, ...]]
"""The numbers behind a finding."""
SEVERITIES: tuple[Severity, ...] = get_args(Severity)


@dataclass(frozen=True, slots=True)
class Finding:
    """One statement about the robot.

    rule: stable id, `family.name`; each has an entry in docs/reference/rules/.
    subject: `link trunk`, `joint FR_hip_joint`, `mesh meshes/trunk.dae`, `actuator ...`,
        `recipe collision.links`: the key into the source map.
    where: `file:line`, filled in by the report; empty inside steps.
    data: the numbers behind the message, SI units, names carry the unit.
    blocks: whether as a warning it keeps the robot from being ready, as every error does.
    """

    rule: str
    severity: Severity
    subject: str
    message: str
    hint: str = ""
    where: str = ""
    data: Data = field(default_factory=dict)
    blocks: bool = False

    @property
    def unready(self) -> bool:
        """Whether the robot is not ready because of it. What a waiver makes information is not."""
        return self.severity == "error" or (self.blocks and self.severity == "warning")

    def at(self, where: str) -> Finding:
        """The same finding with its place in the source filled in."""
        return replace(self, where=where)

    def to_json(self) -> dict[str, object]:
        """Plain data in the field order of `report.json`."""
        return asdict(self) | {"data": {k: self.data[k] for k in sorted(self.data)}}


NEW_IDS: Mapping[str, str] = {
    "collision.open_piece": "collision.not_convex",
    "inertia.between": "inertia.massless_intermediate_link",
    "loop.rigid": "loop.no_mobility",
    "mjcf.tether": "mjcf.base_constrained",
    "mjx.untouchable": "mjx.collision_disabled",
    "stand.start": "stand.sole_gap",
    "trials.shaken": "trials.random_targets_diverge",
    "trials.untried": "trials.not_simulated",
    "urdf.blank": "urdf.empty_attribute",
    "urdf.xml_version": "urdf.xml",
}
"""Ids of version 0.1 -> today's. Whoever reads a recipe need not import these rules."""
RENAMED: dict[str, tuple[str, ...]] = {old: (new,) for old, new in NEW_IDS.items()}
"""Also `was` of all rules that have been declared so far."""


def moved(old: str, module: ModuleType) -> Callable[[str], object]:
    """The `__getattr__` of a module by its old name: it warns, and gives what the new one has."""

    def get(name: str) -> object:
        if name.startswith("__"):  # what Python itself asks of a module
            raise AttributeError(name)
        message = f"import `{name}` from `{module.__name__}`: `{old}` is its old name"
        warnings.warn(message, FutureWarning, stacklevel=2)
        return getattr(module, name)

    return get


def is_now(old: str, finding: Finding) -> bool:
    """Whether a finding says what the rule with the old id `old` said."""
    text = f"{finding.rule} {finding.subject.partition(' ')[0]}"
    return any(
        fnmatchcase(text, pattern if " " in pattern else f"{pattern} *")
        for pattern in RENAMED.get(old, ())
    )


@dataclass(frozen=True, slots=True)
class Rule:
    """What the code can find, declared beside it as a constant; calling it makes the finding.

    id: `family.name`; a last part `*` stands for what the call names: see `named`.
    severity: the usual one, or several of which the first is the usual one.
    meaning, remedy: a cell each of docs/reference/rules/<family>.md, in Markdown.
    was: old ids, which recipes may still waive for one minor version -> patterns of what says it
    now, as `equal.usd.lower`, or `equal.mjcf.* joint`: of joints alone.
    blocks: whether its warnings keep a robot from being ready, though its files are right.
    """

    id: str
    severity: Severity | tuple[Severity, ...]
    meaning: str
    remedy: str
    was: Mapping[str, tuple[str, ...]] = field(default_factory=dict, hash=False)
    blocks: bool = False

    def __post_init__(self) -> None:
        """The old ids are known as soon as the rule is declared."""
        RENAMED.update(self.was)

    @property
    def severities(self) -> tuple[Severity, ...]:
        """All that its findings can have, the usual one first."""
        return (self.severity,) if isinstance(self.severity, str) else self.severity

    def named(self, part: str) -> Rule:
        """The rule with `part` in place of its `*`: `equal.mjcf.*` -> `equal.mjcf.mass`."""
        if not self.id.endswith("*"):
            raise ValueError(f"rule `{self.id}` has no `*` that a name could replace")
        return replace(self, id=self.id.removesuffix("*") + part, was={})

    def __call__(
        self,
        subject: str,
        message: str,
        hint: str = "",
        *,
        severity: Severity | None = None,
        where: str = "",
        data: Data | None = None,
        blocks: bool | None = None,
    ) -> Finding:
        """A finding of this rule, of its usual severity unless another declared one is given.

        blocks: None = as the rule says.
        """
        severity = severity or self.severities[0]
        if severity not in self.severities:
            raise ValueError(f"rule `{self.id}` does not declare the severity `{severity}`")
        if self.id.endswith("*"):
            raise ValueError(f"rule `{self.id}` has a part without a name: `named` gives it one")
        steady_data = {name: steady(value) for name, value in (data or {}).items()}
        stops, advice = self.blocks if blocks is None else blocks, hint or self.advice
        return Finding(self.id, severity, subject, message, advice, where, steady_data, stops)

    @property
    def advice(self) -> str:
        """What to do where a finding has no hint of its own; "" where there is nothing to do."""
        return "" if self.remedy.startswith("nothing") else self.remedy


def steady(value: T) -> T:
    """Leave out the digits that differ between CPUs: 12 significant ones stay.

    Of several numbers, those of the largest: what cancels to nearly nothing beside it is zero.
    """
    if isinstance(value, float):
        return float(f"{value:.12g}") + 0.0  # type: ignore[return-value] # a float again
    if isinstance(value, tuple):
        largest = max((abs(v) for v in value if isinstance(v, float) and isfinite(v)), default=0.0)
        return tuple(  # type: ignore[return-value] # as above
            rounded(v, largest * 1e-9) if isinstance(v, float) and largest else v for v in value
        )
    return value


def known(value: T) -> T | None:
    """None for a number that is not finite, which JSON cannot say; anything else as it is."""
    return None if isinstance(value, float) and not isfinite(value) else value


def rounded(value: float, limit: float) -> float:
    """Round to a thousandth of the power of ten below `limit`, if it is one; no negative zero."""
    if not (isfinite(value) and isfinite(limit) and limit > 0.0):
        return value
    return round(value, 3 - floor(log10(limit))) + 0.0


def finding_from_json(raw: Mapping[str, object]) -> Finding:
    """Inverse of `Finding.to_json`; raises KeyError or TypeError on foreign data."""
    data = raw["data"]
    severity = raw["severity"]
    if not isinstance(data, Mapping) or severity not in SEVERITIES:
        raise TypeError("not a finding")
    return Finding(
        rule=str(raw["rule"]),
        severity=severity,
        subject=str(raw["subject"]),
        message=str(raw["message"]),
        hint=str(raw.get("hint", "")),
        where=str(raw.get("where", "")),
        data={k: tuple(v) if isinstance(v, list) else v for k, v in data.items()},
        blocks=bool(raw.get("blocks", False)),
    )


NOT_LOADED = "not_loaded"
"""Key of a check's figures, or of those of one file: why a file could not be read."""
FOLLOWS = "follows_from"
"""Key of the data of a finding that another one explains: the rule of the other."""


def is_consequence(finding: Finding) -> bool:
    """Whether another finding says why: a check was skipped because MuJoCo refuses the MJCF."""
    silent = finding.rule.endswith(".load") and finding.rule != "mjcf.load"
    return silent or FOLLOWS in finding.data


WAIVED = "severity_before"
"""Key of the data of a finding that the recipe waives: how severe it would be."""


def is_waived(finding: Finding) -> bool:
    """Whether the recipe accepts it, and says why."""
    return WAIVED in finding.data


def worst_first(findings: list[Finding]) -> list[Finding]:
    """Errors, warnings, infos; causes before consequences; else by rule and subject."""
    return sorted(
        findings,
        key=lambda f: (SEVERITIES.index(f.severity), is_consequence(f), f.rule, f.subject),
    )
