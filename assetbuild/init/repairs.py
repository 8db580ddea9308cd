"""Edits for what no simulator takes: each stands in the recipe with what it heals and how.

Only what would stop the build is repaired; what is odd but works stays a finding. What a user must
measure (the mass of a link that states none) is a guess that says so.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from assetbuild.findings import Finding
from assetbuild.init.look import Looked
from assetbuild.init.mesh_points import is_flat
from assetbuild.init.patterns import patterns_of
from assetbuild.init.targets import not_in_usd
from assetbuild.init.words import plain, quoted, some
from assetbuild.robot.model import MeshFile

GUESSED_DENSITY = 1000
"""kg/m3, of links without a mass: water's, and that of many a printed or hollow part."""
GUESSED_MASS = 0.01
"""kg, of a moving link that has neither a mass nor a shape."""
DUMMY_DENSITY = 1e6
"""kg/m3: fifty times the densest matter. Below, a small inertia is odd but can be simulated."""

_BROKEN = {"inertia.missing", "inertia.mass", "inertia.positive", "inertia.dense"}
_LIMITS = {"joint.limits", "joint.locked"}


@dataclass(frozen=True)
class _Repair:
    """edit: with `{name}` for the pattern; why: of its kind, beside it; on: a link or joint."""

    on: str
    edit: str
    why: str
    finding: str


def repairs(robot: Looked, root: Path) -> list[str]:
    """The section `edits:`; [] when there is nothing to repair. root: of the source's files."""
    wanted = [*_inertias(robot, root), *_shares(robot), *_limits(robot)]
    if not wanted:
        return [*_hints(robot)]
    lines = [
        "# The source says what no simulator takes; these edits repair it. Check the numbers: the",
        "# report compares before and after.",
        "edits:",
    ]
    for edit in dict.fromkeys(repair.edit for repair in wanted):
        alike = [repair for repair in wanted if repair.edit == edit]
        names = tuple(dict.fromkeys(repair.on for repair in alike))
        lines.append(f"  # {some(names)}: {plain(alike[0].finding, 300)}")
        lines.append(f"  # {alike[0].why}")
        known = robot.links.by_joint if "{joint:" in edit else robot.links.by_body
        patterns = patterns_of(names, list(known))
        lines += ["  - " + edit.format(name=quoted(pattern)) for pattern in patterns]
    return [*lines, *_hints(robot)]


# --- what to do -----------------------------------------------------------------------------


def _inertias(robot: Looked, root: Path) -> Iterator[_Repair]:
    """One repair for each link that makes a body impossible."""
    for link, findings in _broken_links(robot).items():
        rules = {finding.rule for finding in findings}
        worst = next((f for f in findings if f.rule in _BROKEN), findings[0])
        if rules & _BROKEN:
            yield _remade(robot, root, link, worst)
        else:
            yield _Repair(
                link,
                "balance_inertia: {{link: {name}}}",
                "MuJoCo refuses such a tensor; the smallest moment is raised as far as needed",
                worst.message,
            )


def _broken_links(robot: Looked) -> dict[str, list[Finding]]:
    """Links to repair with the findings on them; of a merged body those that spoil it."""
    bad: dict[str, Finding] = {}
    for finding in robot.body_findings:
        grave = finding.rule in _BROKEN and (finding.severity == "error" or _is_dummy(finding))
        if grave or finding.rule == "inertia.triangle":  # MuJoCo refuses small violations too
            bad[finding.subject.partition(" ")[2]] = finding
    found: dict[str, list[Finding]] = {}
    for finding in robot.link_findings:
        kind, _, name = finding.subject.partition(" ")
        if kind == "link" and finding.rule in {*_BROKEN, "inertia.triangle"}:
            body, _ = robot.tree.placement(name)
            if body in bad and _spoils(robot, name):
                found.setdefault(name, []).append(finding)
    explained = {robot.tree.placement(link)[0] for link in found}
    return found | {body: [f] for body, f in bad.items() if body not in explained}


def _is_dummy(finding: Finding) -> bool:
    """So much mass in so little inertia that a touch of the body ends in NaN (iCub's root link)."""
    if finding.rule != "inertia.dense":
        return False
    radius, mass = (float(str(finding.data[key])) for key in ("radius_m", "mass_kg"))
    return mass > DUMMY_DENSITY * 4.0 / 3.0 * math.pi * radius**3


def _spoils(robot: Looked, link: str) -> bool:
    """A massless frame that was merged into a body is no reason for its mass properties."""
    inertial = robot.links.by_body[link].inertial
    return link in robot.tree.by_body or (inertial is not None and inertial.mass_kg > 0.0)


def _remade(robot: Looked, root: Path, link: str, finding: Finding) -> _Repair:
    inertial = robot.links.by_body[link].inertial
    mass = inertial.mass_kg if inertial else 0.0
    shown = [role for role in ("visual", "collision") if _is_solid(robot, root, link, role)]
    if not shown:
        return _ball(link, mass, finding)
    how = f"from: {shown[0]}, open: hull" if shown[0] != "visual" else "open: hull"
    if mass > 0.0:
        return _Repair(
            link,
            f"inertia_from_geometry: {{{{link: {{name}}, mass: {mass!r}, {how}}}}}",
            f"its mass as it is, spread over its {shown[0]} shapes (an open mesh: over its hull)",
            finding.message,
        )
    return _Repair(
        link,
        f"inertia_from_geometry: {{{{link: {{name}}, density: {GUESSED_DENSITY}, {how}}}}}",
        f"a guess, as the source states no mass: the volume of its {shown[0]} shapes times the "
        "density of water; put the `mass` here when you know it",
        finding.message,
    )


def _is_solid(robot: Looked, root: Path, link: str, role: str) -> bool:
    """Whether the link has shapes of this role, and each spans a volume."""
    shapes = [s.geometry for s in robot.shapes.shapes if (s.link, s.role) == (link, role)]
    meshes = [geometry for geometry in shapes if isinstance(geometry, MeshFile)]
    return bool(shapes) and not any(is_flat(root, mesh) for mesh in meshes)


def _ball(link: str, mass: float, finding: Finding) -> _Repair:
    """A solid ball of water's density: there is nothing to compute it from."""
    ball = mass or GUESSED_MASS
    radius = (3.0 * ball / (4.0 * math.pi * GUESSED_DENSITY)) ** (1.0 / 3.0)
    moment = float(f"{0.4 * ball * radius**2:.3g}")
    stated = "" if mass else f"mass: {ball!r}, "
    moments = f"{{{{ixx: {moment!r}, iyy: {moment!r}, izz: {moment!r}}}}}"
    return _Repair(
        link,
        f"set_inertia: {{{{link: {{name}}, {stated}inertia: {moments}}}}}",
        f"a guess, as it has no solid shape: a ball of {ball:g} kg and the density of water",
        finding.message,
    )


def _shares(robot: Looked) -> Iterator[_Repair]:
    if not_in_usd(robot):
        return  # MuJoCo needs none: several joints on one body
    for finding in robot.link_findings:
        if finding.rule == "inertia.between":
            yield _Repair(
                finding.subject.partition(" ")[2],
                "share_mass: {{link: {name}}}",
                "PhysX wants mass on every body: some is moved here from the body beyond, to where "
                "the axes meet, which changes no motion; without the target usd, leave it out",
                "a massless link between two joints",
            )


def _limits(robot: Looked) -> Iterator[_Repair]:
    for finding in robot.link_findings:
        if finding.rule == "joint.limits":
            joint = robot.links.by_joint[finding.subject.partition(" ")[2]]
            lower, upper = joint.limits.upper, joint.limits.lower
            yield _Repair(
                joint.name,
                f"set_limits: {{{{joint: {{name}}, lower: {lower!r}, upper: {upper!r}}}}}",
                "the two limits change places",
                finding.message,
            )
        if finding.rule == "joint.mimic_limits":
            name = finding.subject.partition(" ")[2]
            lower, upper = (
                float(f"{finding.data[f'led_{end}']:.9g}") for end in ("lower", "upper")
            )
            yield _Repair(
                name,
                f"set_limits: {{{{joint: {{name}}, lower: {lower!r}, upper: {upper!r}}}}}",
                "no simulator holds both orders: it gets the range that it is led to",
                finding.message,
            )


def _hints(robot: Looked) -> Iterator[str]:
    """What builds but may be a mistake, as a comment."""
    locked = [f for f in robot.link_findings if f.rule == "joint.locked"]
    if locked:
        yield "# Equal limits lock a joint. If it is meant to move, give it a range under `edits`:"
    for finding in locked:
        name = finding.subject.partition(" ")[2]
        yield f"#   - set_limits: {{joint: {quoted(name)}, lower: 0, upper: 0}}"
