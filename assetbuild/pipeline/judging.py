"""From findings and figures to the report, each finding with its place."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path

from assetbuild.compose.compose_parts import prefixed_subject
from assetbuild.control.findings import NO_ACTUATOR
from assetbuild.engine.make import NodeResult
from assetbuild.engine.planner import Settled
from assetbuild.engine.session import Session
from assetbuild.errors import AssetBuildError, Where
from assetbuild.facts.reader import Reader
from assetbuild.findings import NOT_LOADED, Finding, Rule
from assetbuild.lock import lock_path, place_of_pin
from assetbuild.pipeline.answers import answers, renamed
from assetbuild.plan import Outline
from assetbuild.plan.asked import asked
from assetbuild.plan.edits import AGAIN
from assetbuild.plugin_types import Check
from assetbuild.plugins import plugin_names
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.recipe.models import Recipe, Waiver
from assetbuild.rendering.plan import PICTURE_MODEL
from assetbuild.report.document import Report, make_report
from assetbuild.report.verdict import NOT_COMPARED, NOT_RUN, TRAINER_CHECKS, CheckResult
from assetbuild.source.patches import patch_keys


def evaluate(loaded: LoadedRecipe, done: Settled[Outline], session: Session) -> Report:
    """The report of one recipe whose steps all went well."""
    outline, recipe = done.outline, loaded.recipe
    checks: dict[str, CheckResult] = {
        name: CheckResult("skip", note=note) for name, note in outline.skipped.items()
    }
    for name, node in outline.checks.items():
        result = done.results[node.label]
        checks[name] = _result(result, json.loads(session.read(result["figures.json"])))
    findings = [
        *_licences(loaded, outline),
        *findings_of(loaded, done),
        *_not_run(recipe, checks),
        *_not_compared(outline),
    ]
    locate = locator(loaded, done, session)
    return make_report(recipe.robot, findings, checks, _waivers(recipe), locate, _commands(loaded))


def _result(ran: NodeResult, figures: Mapping[str, object]) -> CheckResult:
    """A check that could not read a file did not run; the finding of another says why."""
    if any(finding.severity == "error" for finding in ran.findings):
        return CheckResult("fail", figures)
    rows = [row for row in (figures, *figures.values()) if isinstance(row, Mapping)]
    if any(NOT_LOADED in row for row in rows):
        return CheckResult("skip", figures, "its file does not load")
    return CheckResult("pass", figures)


def _waivers(recipe: Recipe) -> Mapping[str, Waiver]:
    """A robot that nothing drives is only accepted where `actuators: []` says so itself."""
    on_purpose = recipe.states("actuators") and recipe.agrees("actuators", ())
    return {
        rule: waiver
        for rule, waiver in recipe.rules.items()
        if on_purpose or rule != NO_ACTUATOR.id
    }


def _not_run(recipe: Recipe, checks: Mapping[str, CheckResult]) -> Iterator[Finding]:
    """One for each request of the recipe that no check answered."""
    for request in asked(recipe):
        results = {name: checks[name] for name in request.checks if name in checks}
        if all(result.status == "skip" and not result.figures for result in results.values()):
            notes = [f"`{name}`: {result.note}" for name, result in results.items()]
            why = request.lack or "; ".join(notes) or "nothing that it reads was built"
            yield NOT_RUN(
                f"recipe {request.key}",
                f"`{request.key}` asks for a check that did not run: {why}",
                data={"checks": request.checks},
            )


def _not_compared(outline: Outline) -> Iterator[Finding]:
    """One for each target that no reader of facts reads back."""
    steps = [node.step for node in outline.checks.values()]
    read = {need for step in steps if isinstance(step, Reader) for need in step.needs}
    for target in outline.targets:
        if target not in read:
            yield NOT_COMPARED(
                f"recipe targets {target}",
                f"no reader of facts compares what `{target}` wrote with the robot",
                hint="`assetbuild.facts.readers` is the entry point of readers",
                data={"target": target},
            )


def _commands(loaded: LoadedRecipe) -> dict[str, str]:
    """Trainer -> the command that lets it try the bundle; not as seen from the working folder."""
    variant = f" --variant {loaded.variant}" if loaded.variant else ""
    checks = [name for name in plugin_names(Check) if name.startswith(TRAINER_CHECKS)]
    smoke = f"assetbuild smoke {loaded.path.name}{variant} --consumer"
    trainers = (name.removeprefix(TRAINER_CHECKS) for name in checks)
    return {trainer: f"{smoke} {trainer}" for trainer in trainers}


def findings_of(loaded: LoadedRecipe, done: Settled[Outline]) -> list[Finding]:
    """What the steps say, under the names of the robot: a step knows neither mesh nor part."""
    findings = [one for each in (loaded, *loaded.parts) for one in each.renamed]
    results = done.results
    whole = answers(loaded.recipe, results, "")
    of_parts = {
        prefix: answers(part.recipe, results, f"{prefix} ")
        for prefix, part in loaded.by_prefix.items()
    }
    for label, result in results.items():
        if label != PICTURE_MODEL:  # the target `mjcf` says the same
            subject, again = done.outline.subjects.get(label), results.get(label + AGAIN)
            prefix = label.partition(" ")[0]
            whose = of_parts.get(prefix, whole)
            left = whose.left_open(result.findings, again.findings if again else None)
            said = left if whose is whole else _of_part(prefix, left)
            findings += (replace(f, subject=subject) for f in said) if subject else said
    return findings


def _licences(loaded: LoadedRecipe, outline: Outline) -> Iterator[Finding]:
    """What the licences of the robot and of its parts ask; texts lie below each part's prefix."""
    parts = loaded.by_prefix
    prefixes = [path.partition("/")[0] for path in outline.licenses]
    robot_licences = sum(prefix not in parts for prefix in prefixes)
    yield from licence_findings(loaded.recipe.source.license, robot_licences)
    for name, part in parts.items():
        for finding in licence_findings(part.recipe.source.license, prefixes.count(name)):
            message = f"part `{name}`: {finding.message}"
            yield replace(finding, subject="recipe compose", message=message)


def _of_part(prefix: str, findings: Iterable[Finding]) -> Iterator[Finding]:
    """What a step says of a part by the part's own names, under the names of the whole."""
    for finding in findings:
        kind = finding.subject.partition(" ")[0]
        subject = "recipe compose"
        if kind not in ("recipe", "robot"):
            subject = prefixed_subject(finding.subject, prefix)
        message = f"part `{prefix}`: {finding.message}" if kind == "robot" else finding.message
        yield replace(finding, subject=subject, message=message)


# --- places ---------------------------------------------------------------------------------


def locator(loaded: LoadedRecipe, done: Settled[Outline], session: Session) -> Callable[[str], str]:
    """Find for a finding's subject its `file:line` in the source or the recipe."""
    outline, results = done.outline, done.results
    lines: dict[str, int | str] = {}  # text where an included file says it: `file:line`
    file = loaded.recipe.source.description
    # Not there where it failed, and while `check` runs light steps alone.
    made = results.get(outline.source_map.node) if outline.source_map else None
    if outline.source_map and made and made.outputs:
        source_map = json.loads(session.read(made[outline.source_map.output]))
        file, lines = source_map["file"], source_map["lines"]
    edits = (results[label].findings for label in outline.edits if label in results)
    for before, now in renamed(chain.from_iterable(edits)):
        lines[now] = lines.get(before, 0)  # the source knows its own names only
    recipe = outline.composed or loaded
    joints = {f"actuator {name[6:]}": line for name, line in lines.items() if name[:6] == "joint "}

    def locate(subject: str) -> str:
        if subject.startswith("recipe "):
            key = subject.removeprefix("recipe ")
            # A rule's name has dots of its own.
            keys = key.split(".", 1) if key.startswith("rules.") else key.split(".")
            where = recipe.where(tuple(int(k) if k.isdigit() else k for k in keys))
            # Not as seen from the working folder: the report must not depend on that.
            return str(replace(where, file=Path(where.file).name))
        line = lines.get(subject) or joints.get(subject)
        if isinstance(line, str):
            return line
        return f"{file}:{line}" if line else ""

    return locate


def failures(
    loaded: LoadedRecipe, done: Settled[Outline], session: Session
) -> Iterator[AssetBuildError]:
    """The errors of the steps, with the name and place of what each worked on."""
    failed = {label: result.error for label, result in done.results.items() if result.error}
    if not failed:
        return
    locate = locator(loaded, done, session)
    for label, error in failed.items():
        where = (
            _where_of(loaded, done.outline, label)
            or _where_named(loaded, error.message)
            or _where_in_source(error.message, locate)
        )
        yield _located(error, done.outline.subjects.get(label, ""), where)


def _where_of(loaded: LoadedRecipe, outline: Outline, label: str) -> Where | None:
    """Who asked for a step: the line of an edit or patch, or the pin of what is fetched."""
    if label in outline.edits:
        return loaded.where(outline.edits[label])
    if label == "fetch":
        if loaded.recipe.source.moving is None:
            return loaded.where(("source", "sha256"))
        return place_of_pin(lock_path(loaded.path))
    for prefix, part in loaded.by_prefix.items():
        if label.startswith(f"{prefix} "):
            keys = patch_keys(part.recipe.source.patches, part.folder, part.world)
            key = ({"fetch": ("source",)} | keys).get(label.removeprefix(f"{prefix} "))
            return part.where(key) if key else None
    return None


def _where_named(loaded: LoadedRecipe, message: str) -> Where | None:
    """The line of the key that a message begins with: `keyframes.home: ...`."""
    section, *keys = message.partition(":")[0].partition(" ")[0].split(".")
    if not keys or section not in type(loaded.recipe).model_fields:
        return None
    return loaded.where((section, *(int(key) if key.isdigit() else key for key in keys)))


_THING = re.compile(r"(joint|link) (?:`([^`]+)`|([^:]+):)")
"""The start of a step's error that names a part: ``joint `j` is ...``, `link a: ...`."""


def _where_in_source(message: str, locate: Callable[[str], str]) -> Where | None:
    """The line of the joint or link that a message begins with."""
    thing = _THING.match(message)
    place = locate(f"{thing[1]} {thing[2] or thing[3]}") if thing else ""
    file, _, line = place.rpartition(":")
    return Where(file, int(line)) if file else None


def _located(error: AssetBuildError, subject: str, where: Where | None) -> AssetBuildError:
    """The error of a step with the name of what it worked on, which the step did not know."""
    if where is not None and error.where is None:
        return type(error)(error.message, where=where, hint=error.hint)
    kind, _, name = subject.partition(" ")
    if not name:
        return error
    message = error.message.removeprefix(f"{kind}: ")
    if kind != "mesh":
        return type(error)(f"{subject}: {message}", where=error.where, hint=error.hint)
    line, column = (error.where.line, error.where.column) if error.where else (0, 0)
    return type(error)(message, where=Where(name, line, column), hint=error.hint)


# --- what the source's licence asks of who passes the bundle on -----------------------------

UNSTATED = Rule(
    "license.unstated",
    "warning",
    "the recipe does not say under which licence the robot comes",
    "add `license:` with an SPDX identifier below `source`",
)
NO_DERIVATIVES = Rule(
    "license.no_derivatives",
    "warning",
    "the licence (CC ...-ND) forbids passing on what was made from the work: converted meshes, an "
    "edited URDF",
    "keep the bundle to yourself, or ask the rights holder",
)
NON_COMMERCIAL = Rule(
    "license.non_commercial",
    "info",
    "the licence (CC ...-NC) allows no commercial use",
    "ask the rights holder before you sell what was made with it",
)
SHARE_ALIKE = Rule(
    "license.share_alike",
    "info",
    "the licence (CC ...-SA) asks that what was made from the work be passed on under the same "
    "licence",
    "pass the bundle on under that licence",
)
NO_TEXT = Rule(
    "license.no_text",
    "info",
    "the source brings no licence text, so the bundle has none",
    "add the text to the source: most licences require that it is passed on",
)
_TERMS = {"ND": NO_DERIVATIVES, "NC": NON_COMMERCIAL, "SA": SHARE_ALIKE}
"""Terms of Creative Commons in an SPDX identifier, `CC-BY-NC-ND-4.0`."""


def licence_findings(license_id: str | None, texts: int) -> Iterator[Finding]:
    """license_id: SPDX expression of the recipe; texts: licence files that the source brings."""
    if license_id is None:
        yield UNSTATED("recipe source", UNSTATED.meaning)
    for word in re.findall(r"[A-Za-z0-9.+-]+", license_id or ""):
        first, *terms = word.upper().split("-")
        for term, rule in _TERMS.items():
            if first == "CC" and term in terms:
                message = f"{word}: {rule.meaning}"
                yield rule("recipe source.license", message, data={"license": word})
    if not texts:
        yield NO_TEXT("recipe source", NO_TEXT.meaning)
