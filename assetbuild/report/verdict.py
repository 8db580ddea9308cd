"""Is the robot ready for training? Three parts (formats, physics, trainers) and what blocks it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

from assetbuild.findings import Finding, Rule, is_consequence

Status = Literal["pass", "fail", "skip"]
FormatsStatus = Literal["agree", "differ", "not compared"]
PhysicsStatus = Literal["stands", "holds", "falls", "rests", "unstable", "not tried"]
TrainerStatus = Literal["yes", "failed", "not tried"]

NOT_RUN = Rule(
    "check.not_run",
    "warning",
    "the recipe asks for a check that did not run, so the robot is not ready for training",
    "provide what the message names, or remove the request from `validate`",
    blocks=True,
)
NOT_COMPARED = Rule(
    "formats.not_compared",
    "warning",
    "no reader of facts compares what a target wrote with the robot, so the robot is not ready",
    "write a reader for the format (docs/how-to/plugins.md), or waive the rule with the reason",
    blocks=True,
)
EXPERIMENTS = (("stand", "stood"), ("trials", "untouched"))
"""Checks that leave the robot alone under its drives, and the figure that says what it did."""
TRAINER_CHECKS = "smoke_"
"""Beginning of the names of the checks in which a trainer tries the bundle."""


@dataclass(frozen=True)
class CheckResult:
    """One check: its numbers, or why it was skipped."""

    status: Status
    figures: Mapping[str, object] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True)
class Formats:
    """Whether every format says the same of the robot.

    differences: findings of equality checks; not_compared: targets that no check compares.
    """

    status: FormatsStatus
    sentence: str
    differences: int = 0
    not_compared: tuple[str, ...] = ()


@dataclass(frozen=True)
class Physics:
    """What the robot does under its drives when nobody touches it. height_m: of its base."""

    status: PhysicsStatus
    sentence: str
    check: str = ""
    height_before_m: float | None = None
    height_after_m: float | None = None


@dataclass(frozen=True)
class Trainer:
    """What one consumer made of the bundle. command: what tries it."""

    status: TrainerStatus
    sentence: str
    command: str


@dataclass(frozen=True)
class Verdict:
    """Ready for training or not, what blocks, the next move, and how each part was judged.

    not_tried: checks that did not run, each with the reason.
    """

    ready: bool
    blocked_by: tuple[str, ...]
    next_step: str
    formats: Formats
    physics: Physics
    trainers: Mapping[str, Trainer]
    not_tried: Mapping[str, str]


BESIDE = "in the folder of the recipe, "
"""Where commands work that name the recipe without its folder."""


def verdict_rows(verdict: Verdict) -> tuple[tuple[str, str], ...]:
    """(part, what to say of it) for people; literals stand in backticks."""
    formats, physics = verdict.formats, verdict.physics
    plain = physics.status not in ("not tried", "unstable")  # the others begin with their verb
    rows = [
        ("formats", f"{formats.status}: {formats.sentence}"),
        ("physics", physics.sentence if plain else f"{physics.status}: {physics.sentence}"),
    ]
    tried = [(n, t) for n, t in verdict.trainers.items() if t.status != "not tried"]
    rows += [("trainers", f"{name}: {one.status}; {one.sentence}") for name, one in tried]
    untried = [name for name in verdict.trainers if name not in dict(tried)]
    if untried:
        shown = "mjlab" if "mjlab" in untried else untried[0]
        command = verdict.trainers[shown].command
        others = ", ".join(untried)
        run = f"{BESIDE}run `{command}` to try {shown}"
        rows.append(("trainers", f"not tried: {others}; {run}"))
    if verdict.not_tried:
        notes = (f"`{name}`" + f": {why}" * bool(why) for name, why in verdict.not_tried.items())
        rows.append(("checks", f"not run: {'; '.join(notes)}"))
    return tuple(rows)


def judge(
    findings: Sequence[Finding],
    checks: Mapping[str, CheckResult],
    commands: Mapping[str, str] | None = None,
) -> Verdict:
    """The verdict on located and waived findings, worst first.

    commands: trainer -> the command with which it tries the bundle.
    """
    blocked_by, next_step = _blocked(findings, checks)
    trainers = {name: _trainer(name, line, checks) for name, line in (commands or {}).items()}
    skipped = {
        name: check.note
        for name, check in sorted(checks.items())
        if check.status == "skip" and not name.startswith(TRAINER_CHECKS)
    }
    formats, physics = _formats(findings, checks), _physics(findings, checks)
    return Verdict(not blocked_by, blocked_by, next_step, formats, physics, trainers, skipped)


def _blocked(
    findings: Sequence[Finding], checks: Mapping[str, CheckResult]
) -> tuple[tuple[str, ...], str]:
    """The rules that block training, and the next step."""
    blocking = [f for f in findings if f.unready]
    if blocking:
        causes = [f for f in blocking if not is_consequence(f)] or blocking
        first = causes[0]
        place = f"{first.where}: " if first.where else ""
        step = f"{place}{first.subject}: {first.hint or first.message}"
        return tuple(dict.fromkeys(f.rule for f in causes)), step
    warnings = [f for f in findings if f.severity == "warning"]
    if warnings:
        them = "the warning" if len(warnings) == 1 else f"the {len(warnings)} warnings"
        return (), f"read {them}, then train"
    skipped = sorted(name for name, check in checks.items() if check.status == "skip")
    return (), f"train; not checked here: {', '.join(skipped)}" if skipped else "train"


# --- formats ----------------------------------------------------------------------------------


def _formats(findings: Sequence[Finding], checks: Mapping[str, CheckResult]) -> Formats:
    """Judge formats by the rules `equal.<format>.<quantity>`, waived ones included."""
    equality = [f for f in findings if f.rule.startswith("equal.")]
    unreadable = [f for f in equality if f.rule.endswith(".load")]
    different = [f for f in equality if f not in unreadable]
    named = [name for f in findings if f.rule == NOT_COMPARED.id for name in _targets_of(f)]
    named += [f.rule.split(".")[1] for f in unreadable]
    left = tuple(dict.fromkeys(named))
    tail = f"; not compared: {', '.join(left)}" if left else ""
    if different:
        kinds = ", ".join(dict.fromkeys(f.rule.split(".")[1] for f in different))
        count = f"{len(different)} finding{'s' if len(different) > 1 else ''}"
        sentence = f"{count} of the equality checks ({kinds}){tail}"
        silent = [f.message.partition(":")[0] for f in different if f.rule == "equal.unreadable"]
        if len(silent) == len(different):
            sentence = f"{', '.join(dict.fromkeys(silent))} could not be read{tail}"
        return Formats("differ", sentence, len(different), left)
    if left:
        return Formats("not compared", f"no check compares {', '.join(left)}", 0, left)
    read = [c.figures.get("facts") for n, c in checks.items() if n.endswith("_equal") and c.figures]
    facts = sum(count for count in read if isinstance(count, int))
    if not facts:
        return Formats("agree", "no equality check found a difference")
    return Formats("agree", f"{facts:,} values across {len(read)} files match")


def _targets_of(finding: Finding) -> tuple[str, ...]:
    """The target that a finding names, as `data["target"]` or as its subject."""
    named = finding.data.get("target", finding.subject.rpartition(" ")[2])
    return tuple(map(str, named)) if isinstance(named, tuple) else (str(named),)


# --- physics ----------------------------------------------------------------------------------


def _physics(findings: Sequence[Finding], checks: Mapping[str, CheckResult]) -> Physics:
    """What `stand` saw, else what the trials saw; and the error that the same check found."""
    reasons = []
    for name, figure in EXPERIMENTS:
        check = checks.get(name)
        if check is None:
            continue
        did = check.figures.get(figure)
        if isinstance(did, Mapping) and did.get("outcome") in get_args(PhysicsStatus):
            wrong = (f for f in findings if f.severity == "error" and f.rule.startswith(f"{name}."))
            error = None if did["outcome"] in FALLEN else next(wrong, None)
            who = "" if error is None or error.subject == "robot" else f"{error.subject}: "
            but = "" if error is None else f"; but {who}{error.message}"
            return Physics(
                did["outcome"],
                f"{did['sentence']}{but}",
                name,
                did.get("height_before_m"),
                did.get("height_after_m"),
            )
        reasons.append(check.note or str(check.figures.get("skipped", "")))
    why = next(filter(None, reasons), "no simulator ran, or there is no keyframe to hold")
    return Physics("not tried", why)


FALLEN = ("falls", "unstable")
"""Outcomes whose sentence says already what the error says."""


# --- trainers ---------------------------------------------------------------------------------


def _trainer(name: str, command: str, checks: Mapping[str, CheckResult]) -> Trainer:
    check = checks.get(TRAINER_CHECKS + name)
    if check is None or check.status == "skip":
        return Trainer("not tried", f"`{command}` tries it", command)
    sentence = str(check.figures.get("summary") or check.figures.get("failure") or "")
    if check.status == "pass":
        return Trainer("yes", sentence or "it took the bundle", command)
    return Trainer("failed", sentence or "see the findings `smoke.*`", command)
