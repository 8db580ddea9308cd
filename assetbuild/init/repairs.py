"""Edits for what no simulator takes: each stands in the recipe with what it heals and how.

Only what would stop the build is repaired; what is odd but works stays a finding. What a user must
measure (the mass of a link that states none) is a guess that says so.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from assetbuild.body.inertia_rules import MASS_SMALL
from assetbuild.body.lint import MIMIC_LIMITS
from assetbuild.engine.scratch import Scratch, scratch
from assetbuild.errors import AssetBuildError
from assetbuild.findings import Finding
from assetbuild.geometry.convert_mesh import ConvertMesh
from assetbuild.grouping import grouped
from assetbuild.init.draft import Draft, inline, patterns_of, plain, some
from assetbuild.init.look import InspectedRobot, mesh_file, not_in_usd, wrong_links, zeroed
from assetbuild.mesh.primitives import volume_of
from assetbuild.plugin_types import Edit
from assetbuild.plugins import load_plugin
from assetbuild.robot.codec import encode
from assetbuild.robot.contradictions import FACTOR
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.inertia import principal_moments
from assetbuild.robot.mimic import common_range, has_range, leading
from assetbuild.robot.shapes import MeshFile
from assetbuild.robot.tree import PLACEHOLDER_KG, merge_fixed_joints

GUESSED_DENSITY = 1000
"""kg/m3, of links without a mass: water's, and that of many a printed or hollow part."""
GUESSED_MASS = 0.01
"""kg, of a moving link that has neither a mass nor a shape."""
LEAST_M3 = 1e-12
"""A cube of 0.1 mm; no smaller shape has mass to spread, such as the 1 um of a camera's frame."""
DUMMY_DENSITY = 1e6
"""kg/m3: fifty times the densest matter. Below, a small inertia is odd but can be simulated."""

EDITS = (
    "The source states what no simulator takes, or what contradicts itself; these edits repair it.",
    "Check the numbers: the report compares before and after.",
)

_BROKEN = {"inertia.missing", "inertia.mass", "inertia.positive", "inertia.dense"}


@dataclass(frozen=True)
class Repair:
    """on: a link or joint. keys: of the edit, besides the name of it; why: of its kind."""

    on: str
    edit: str
    keys: Mapping[str, object]
    why: str
    finding: str

    @property
    def kind(self) -> str:
        """What `on` names, as the edit's key spells it."""
        return "joint" if self.edit in ("set_limits", "split_joint") else "link"


def repairs(robot: InspectedRobot, *, usd: bool = True) -> tuple[Repair, ...]:
    """What stops a build, mended; in the order of the recipe.

    usd: whether the robot's other facts let it have one.
    """
    shares = _shares(robot) if usd else ()
    why = "two slides and a hinge move alike, in every format, and actuators can drive them"
    planar = "MJCF and USD have no planar joint"
    splits = (Repair(joint, "split_joint", {}, why, planar) for joint in robot.planar)
    return (*splits, *_all_inertias(robot), *shares, *_limits(robot))


def put_repairs(draft: Draft, robot: InspectedRobot, needed: Sequence[Repair]) -> None:
    """The section `edits`; nothing where none is needed."""
    alike = grouped(needed, lambda repair: f"{repair.edit} {inline(repair.keys)}")
    draft.note(*EDITS * bool(alike), at=("edits",))
    for first, *others in alike.values():
        names = tuple(dict.fromkeys(repair.on for repair in (first, *others)))
        joints = (*robot.links.by_joint, *robot.planar)
        known = joints if first.kind == "joint" else tuple(robot.links.by_body)
        lines = [f"{some(names)}: {plain(first.finding, 300)}", first.why]
        for number, pattern in enumerate(patterns_of(names, known)):
            edit = {first.edit: {first.kind: pattern, **first.keys}}
            draft.add(edit, "edits", above=lines if not number else ())
    _note_locked(draft, robot, {repair.on for repair in needed if repair.kind == "joint"})


def _subject(finding: Finding) -> str:
    """The name of the link or joint that it speaks of."""
    return finding.subject.partition(" ")[2]


# --- what to do -----------------------------------------------------------------------------


def _all_inertias(robot: InspectedRobot) -> list[Repair]:
    """Those of the source, then what their absurd numbers hid: a part that added little to them."""
    done, new, whole = list[Repair](), list(_inertias(robot)), robot
    while new:
        done, whole = [*done, *new], mended(whole, new)
        wrong, known = wrong_links(whole), {repair.on for repair in done}
        new = [_remade(robot, link, wrong[link]) for link in wrong if link not in known]
    return done


def _inertias(robot: InspectedRobot) -> Iterator[Repair]:
    """One repair for each link that makes a body impossible or contradicts its shapes or twin."""
    wrong = wrong_links(robot) | _weightless(robot)
    for link, finding in _broken_links(robot).items():
        if finding.rule in _BROKEN or link not in wrong:
            wrong[link] = finding
    for link, finding in wrong.items():
        if finding.rule == "inertia.triangle" and _is_near(robot, link):
            why = "MuJoCo refuses such a tensor; the smallest moment is raised as far as needed"
            yield Repair(link, "balance_inertia", {}, why, finding.message)
        else:
            yield _remade(robot, link, finding)


def _is_near(robot: InspectedRobot, link: str) -> bool:
    """Whether the largest moment is not so much too large that no smaller one can explain it."""
    inertial = robot.links.by_body[link].inertial
    if inertial is None:
        return False
    a, b, c = principal_moments(inertial.inertia_com_kg_m2)
    return c <= FACTOR * (a + b)


def _broken_links(robot: InspectedRobot) -> dict[str, Finding]:
    """Links to repair with the gravest finding on them; of a merged body those that spoil it."""
    bad: dict[str, Finding] = {}
    for finding in robot.body_findings:
        grave = finding.rule in _BROKEN and (finding.severity == "error" or _is_dummy(finding))
        if grave or finding.rule == "inertia.triangle":  # MuJoCo refuses small violations too
            bad[_subject(finding)] = finding
    broken: dict[str, Finding] = {}
    for finding in robot.link_findings:
        kind, _, name = finding.subject.partition(" ")
        if kind == "link" and finding.rule in {*_BROKEN, "inertia.triangle"}:
            (body, _), inertial = robot.tree.placement(name), robot.links.by_body[name].inertial
            # A massless frame that was merged into a body is no reason for its mass properties.
            weighs = inertial is not None and inertial.mass_kg > 0.0
            of_mass = body in bad and bad[body].rule != "inertia.missing"
            if of_mass and (name in robot.tree.by_body or weighs):
                graver = finding.rule in _BROKEN and broken.get(name, finding).rule not in _BROKEN
                broken[name] = finding if graver else broken.get(name, finding)
    explained = {robot.tree.placement(link)[0] for link in broken}
    for body in [body for body in bad if body not in explained]:
        solid = _solid(robot, body) if bad[body].rule == "inertia.missing" else []
        broken |= dict.fromkeys(solid or [body], bad[body])
    return broken


def _weightless(robot: InspectedRobot) -> dict[str, Finding]:
    """Links with a volume in bodies of no real mass: an export gives 1e-9 kg to unknown matter."""
    return {
        link: finding
        for finding in robot.body_findings
        if finding.rule == MASS_SMALL.id and float(str(finding.data["mass_kg"])) < PLACEHOLDER_KG
        for link in _solid(robot, _subject(finding))
    }


def _solid(robot: InspectedRobot, body: str) -> list[str]:
    """The links of a body with shapes that span a volume."""
    roles = ("visual", "collision")
    return [n for n in robot.links_of(body) if any(_is_solid(robot, n, role) for role in roles)]


def _is_dummy(finding: Finding) -> bool:
    """So much mass in so little inertia that a touch of the body ends in NaN (iCub's root link)."""
    if finding.rule != "inertia.dense":
        return False
    radius, mass = (float(str(finding.data[key])) for key in ("radius_m", "mass_kg"))
    return mass > DUMMY_DENSITY * 4.0 / 3.0 * math.pi * radius**3


def _remade(robot: InspectedRobot, link: str, finding: Finding) -> Repair:
    inertial = robot.links.by_body[link].inertial
    mass = inertial.mass_kg if inertial and inertial.mass_kg >= PLACEHOLDER_KG else 0.0
    shown = [role for role in ("visual", "collision") if _is_solid(robot, link, role)]
    if not shown:
        return _ball(link, mass, finding)
    how = {"open": "hull"} if shown[0] == "visual" else {"from": shown[0], "open": "hull"}
    if mass > 0.0:
        matter: dict[str, object] = {"mass": mass}
        why = f"its mass as it is, spread over its {shown[0]} shapes (an open mesh: over its hull)"
    else:
        matter = {"density": GUESSED_DENSITY, "guessed": True}
        why = (
            f"a guess, as the source states no real mass: the volume of its {shown[0]} shapes "
            "times the density of water; put the `mass` here when you know it"
        )
    return Repair(link, "inertia_from_geometry", {**matter, **how}, why, finding.message)


def _is_solid(robot: InspectedRobot, link: str, role: str) -> bool:
    """Whether the link has shapes of this role, and each spans a volume."""
    shapes = [s.geometry for s in robot.shapes.shapes if (s.link, s.role) == (link, role)]
    return bool(shapes) and not any(
        robot.is_flat(shape) if isinstance(shape, MeshFile) else volume_of(shape) < LEAST_M3
        for shape in shapes
    )


def _ball(link: str, mass: float, finding: Finding) -> Repair:
    """A solid ball of water's density: there is nothing to compute it from."""
    ball = mass or GUESSED_MASS
    radius = (3.0 * ball / (4.0 * math.pi * GUESSED_DENSITY)) ** (1.0 / 3.0)
    moment = float(f"{0.4 * ball * radius**2:.3g}")
    keys: dict[str, object] = {} if mass else {"mass": ball, "guessed": True}
    keys["inertia"] = dict.fromkeys(("ixx", "iyy", "izz"), moment)
    why = f"a guess, as it has no solid shape: a ball of {ball:g} kg and the density of water"
    return Repair(link, "set_inertia", keys, why, finding.message)


def _shares(robot: InspectedRobot) -> Iterator[Repair]:
    if not_in_usd(robot):
        return  # MuJoCo needs none: several joints on one body
    why = (
        "PhysX wants mass on every body: some is moved here from the body beyond, where it "
        "changes no motion; without the target usd, leave it out"
    )
    for finding in robot.link_findings:
        if finding.rule == "inertia.massless_intermediate_link":
            message = "a massless link between two joints"
            yield Repair(_subject(finding), "share_mass", {}, why, message)


def _limits(robot: InspectedRobot) -> Iterator[Repair]:
    locked = "without a range urdfdom locks it at 0; MuJoCo, PyBullet and Isaac Sim let it turn"
    zeros = "exporters write zeros where nobody states limits, and MuJoCo lets it turn"
    for names, why, message in (
        (robot.unranged, locked, "<limit> states no range"),
        (zeroed(robot.links), zeros, "all limits of all joints are 0"),
    ):
        why += ": put `lower` and `upper` here when you know them"
        for name in names:
            yield Repair(name, "set_limits", {"unlimited": True}, why, message)
    for finding in robot.link_findings:
        name = _subject(finding)
        if finding.rule == "joint.limits":
            limits = robot.links.by_joint[name].limits
            keys = {"lower": limits.upper, "upper": limits.lower}
            yield Repair(name, "set_limits", keys, "the two limits change places", finding.message)
    yield from _led(robot)


def _led(robot: InspectedRobot) -> Iterator[Repair]:
    """A leader is narrowed until its followers keep their ranges: no stop is moved outwards.

    A follower that states no range gets the one that it is led to. Where no range suits both,
    nothing is repaired: see `urdf_recipe`.
    """
    narrowed = set()
    for finding in robot.link_findings:
        if finding.rule != MIMIC_LIMITS.id or finding.blocks:
            continue
        follower = robot.links.by_joint[_subject(finding)]
        leader, _, _ = leading(robot.links, follower)
        common = common_range(robot.links, leader)
        if not has_range(follower):
            ends = (finding.data["led_lower"], finding.data["led_upper"])
            why = "it states no range of its own: it gets the one that it is led to"
            yield Repair(follower.name, "set_limits", _ends(ends), why, finding.message)
        elif common is not None and leader.name not in narrowed:
            narrowed.add(leader.name)
            why = "the leader is narrowed: no simulator holds both orders, and no stop is passed"
            yield Repair(leader.name, "set_limits", _ends(common), why, finding.message)


def _ends(ends: Sequence[object]) -> dict[str, object]:
    return {n: float(f"{end:.9g}") for n, end in zip(("lower", "upper"), ends, strict=True)}


def _note_locked(draft: Draft, robot: InspectedRobot, mended: Collection[str]) -> None:
    """What builds but may be a mistake, as a comment; mended: joints that an edit repairs."""
    names = [_subject(f) for f in robot.link_findings if f.rule == "joint.locked"]
    for number, name in enumerate(name for name in names if name not in mended):
        if not number:
            why = (
                "Equal limits lock a joint. If it is meant to move, give it a range under `edits`:"
            )
            draft.note(why, at=("edits",))
        edit = inline({"joint": name, "lower": 0, "upper": 0})
        draft.note(f"- set_limits: {edit}", at=("edits",))


def mended(robot: InspectedRobot, repairs: Iterable[Repair]) -> InspectedRobot:
    """Apply the edits in order; one whose mesh only the build can read is left out.

    The findings stay those of the source.
    """
    for repair in repairs:
        robot = _applied(robot, repair)
    return robot


def _applied(robot: InspectedRobot, repair: Repair) -> InspectedRobot:
    try:
        plugin = load_plugin(Edit, repair.edit)
        edit = plugin.model_validate({repair.kind: re.escape(repair.on), **repair.keys})
        with scratch() as ports:
            ports.put("links.json", encode(robot.links))
            ports.put("shapes.json", encode(robot.shapes))
            _convert(edit, robot, ports)
            ports.run(edit)
            done = RobotFiles(ports.folder)
            links, shapes = done.links, done.source_shapes
    except (AssetBuildError, OSError):
        return robot
    tree, _ = merge_fixed_joints(links, True, ())
    return replace(robot, links=links, tree=tree, shapes=shapes)


def _convert(edit: Edit, robot: InspectedRobot, ports: Scratch) -> None:
    """The meshes that the edit reads, where it looks for them. Raises OSError for a huge one."""
    for index, shape in enumerate(edit.meshes(robot.shapes)):
        assert isinstance(shape.geometry, MeshFile)  # noqa: S101 # that is what it asked for
        format, data, beside = mesh_file(robot.root / shape.geometry.path)
        mesh_ports = Scratch(ports.folder / "mesh" / str(index))
        mesh_ports.put("mesh", data)
        for number, content in enumerate(beside.values()):
            mesh_ports.put(f"companions/{number}", content)
        convert = ConvertMesh(
            format=format,
            scale=shape.geometry.scale,
            up_axis="honour" if shape.geometry.path in robot.turned else "ignore",
            companions=tuple(beside),
        )
        mesh_ports.run(convert)
