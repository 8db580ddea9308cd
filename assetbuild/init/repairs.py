"""Edits that would heal what the lints found, as a comment: the user decides, not `init`."""

from __future__ import annotations

from assetbuild.findings import Finding
from assetbuild.init.look import Looked

_EDITS = {
    "inertia.triangle": "balance_inertia: {{link: {name}}}",
    "inertia.positive": "inertia_from_geometry: {{link: {name}}}",
    "inertia.missing": "inertia_from_geometry: {{link: {name}}}",
    "inertia.mass": "inertia_from_geometry: {{link: {name}}}",
    "inertia.radius": "inertia_from_geometry: {{link: {name}}}",
    "joint.limits": "set_limits: {{joint: {name}, lower: 0, upper: 0}}",
    "joint.locked": "set_limits: {{joint: {name}, lower: 0, upper: 0}}",
}


def repairs(robot: Looked) -> list[str]:
    """Commented-out edits for the errors of the lints; [] when there is nothing to repair."""
    bad = [f for f in robot.body_findings if f.severity == "error"]
    bodies = {f.subject.partition(" ")[2] for f in bad}
    wrong = [*_links_of(robot, bodies, bad)]
    wrong += [f for f in robot.link_findings if f.rule in ("joint.limits", "joint.locked")]
    lines = []
    for finding in wrong:
        name = finding.subject.partition(" ")[2]
        edit = _EDITS.get(finding.rule)
        if edit is not None:
            lines.append(f"#   {finding.subject}: {finding.message}")
            lines.append(f"#   - {edit.format(name=name)}")
    if not lines:
        return []
    head = "# The source has mistakes; these edits would repair them, once you agree:"
    return [head, "# edits:", *lines]


def _links_of(robot: Looked, bodies: set[str], bad: list[Finding]) -> list[Finding]:
    """The findings on the links that make a broken body broken; on the body where none does."""
    found, explained = [], set()
    for finding in robot.link_findings:
        name = finding.subject.partition(" ")[2]
        if finding.rule not in _EDITS or not finding.subject.startswith("link "):
            continue
        body, _ = robot.tree.placement(name)
        if body in bodies:
            found.append(finding)
            explained.add(body)
    return found + [f for f in bad if f.subject.partition(" ")[2] not in explained]
