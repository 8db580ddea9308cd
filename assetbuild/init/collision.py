"""What each link hits with, where one rule does not suit all; contacts of hands, and loops."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from assetbuild.checks.trials import START_M
from assetbuild.errors import StepError
from assetbuild.facts.derived import SOLIMP
from assetbuild.init.anatomy import Anatomy, roles
from assetbuild.init.draft import Draft, inline, patterns_of
from assetbuild.init.home import Pair
from assetbuild.init.look import InspectedRobot
from assetbuild.init.wheels import COINCIDENT_M
from assetbuild.robot.contact import Contact
from assetbuild.robot.mimic import with_mimics
from assetbuild.robot.model import Control, Mimic, Tree
from assetbuild.robot.pose import Array, Pose
from assetbuild.robot.shapes import MeshFile, Role, SourceShape
from assetbuild.robot.tree import forward_kinematics
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import trials as mujoco_trials

COMPOUND = 0.15
"""Joints closer than this share of the robot's size make one compound joint (a hip, a wrist)."""

ALIKE = 0.9
"""Cosine between two axes that count as parallel."""
AS_DRAWN = (("method", "auto"), ("from", "visual"))
BALL = 3.0
"""Longest extent over the shortest of a foot that a sphere stands for; more is a disc or a rod."""

Rule = tuple[str, tuple[tuple[str, str], ...]]
"""The reason for a rule of the section, and the keys that it states."""

CLOSE: Rule = ("What grips stays close to its mesh.", (("preset", "manipulation"),))


def put_collision(
    draft: Draft,
    robot: InspectedRobot,
    anatomy: Anatomy,
    pairs: Sequence[Pair],
    overlaps: Mapping[Pair, float],
    inside: Mapping[Pair, float],
    hand: Sequence[str],
) -> None:
    """The whole section.

    pairs: see `compound_pairs`; overlaps: bodies whose hulls throw the robot over at home, and
    depths, m; inside: bodies that lie in each other in every pose; hand: links that grip.
    """
    origin, why = "visual", "the source has no collision shapes"
    if robot.shapes.of("collision"):
        seen = {shape.link for shape in robot.shapes.of("visual")}
        idle = len(seen - robot.solid_links)
        why = f"links that are drawn but collide with nothing, as in the source: {idle}"
        why = why if idle else "every link has some"
        origin = "collision"
    how = "coarse and fast; `manipulation` stays close to the mesh"
    draft.put("locomotion", "collision", "preset", beside=how)
    auto = "auto: a primitive stays as it is, a mesh becomes few convex pieces within tolerances"
    rule = {"method": "auto", "from": origin}
    draft.put(rule, "collision", "default", beside=why, above=[auto])
    _put_rules(draft, robot, anatomy, hand)
    joined = "bodies that a joint connects never collide"
    draft.put(True, "collision", "exclude", "adjacent", beside=joined)
    why = "Hulls overlap around joints that act as one (a hip, a wrist), and where links lie side"
    lines = [f"{why} by side."] * bool(pairs)
    if overlaps:
        lines.append("Hulls of these bodies overlap at home and push the robot over or askew. They")
        lines.append("pass through each other now; another pose of `home` may free them:")
        lines += _named(overlaps)
    if inside:
        lines.append("These bodies, or their hulls, lie in each other whatever the pose:")
        lines += _named(inside)
    if excluded := [*dict.fromkeys((*pairs, *overlaps, *inside))]:
        draft.put(excluded, "collision", "exclude", "pairs", above=lines)


def _put_rules(draft: Draft, robot: InspectedRobot, anatomy: Anatomy, hand: Sequence[str]) -> None:
    """Links with a rule of their own, one comment for each kind of it."""
    close = () if anatomy.legs else hand  # what walks is seldom trained to grip
    rules = dict.fromkeys(close, CLOSE) | _rules(robot, anatomy)
    for reason, rule in dict.fromkeys(rules.values()):
        links = [link for link, stated in rules.items() if stated == (reason, rule)]
        for number, pattern in enumerate(patterns_of(links, list(robot.links.by_body))):
            above = [] if number else [reason]
            draft.put(dict(rule), "collision", "links", pattern, above=above)


def _named(depths: Mapping[Pair, float]) -> list[str]:
    """Pairs of bodies and how deep they lie in each other, m."""
    return [f"{a} in {b}: {1e3 * depth:.3g} mm" for (a, b), depth in depths.items()]


def put_own_shapes(draft: Draft, robot: InspectedRobot, inside: Mapping[Pair, float]) -> None:
    """The section for an MJCF, which states its shapes. inside: see `lying_inside`."""
    count = len(robot.shapes.of("collision"))
    rule = (
        {"method": "keep", "from": "collision"} if count else {"method": "auto", "from": "visual"}
    )
    why = f"its {count} shapes as they are" if count else "the source has no collision shapes"
    draft.put(rule, "collision", "default", beside=why)
    if inside:
        lines = ["In the source these bodies lie in each other at home, so that MuJoCo throws them"]
        lines += ["apart. They pass through each other now:", *_named(inside)]
        draft.put([*inside], "collision", "exclude", "pairs", above=lines)


def lying_inside(mjcf: Path, tree: Tree, pose: Mapping[str, float]) -> dict[Pair, float]:
    """Bodies that lie in each other in a pose, as MuJoCo reads the source, and how deep, m.

    Without those of two mechanisms: one may be there for the other to touch.
    """
    try:
        model = mujoco.load(mjcf, visuals=False).model
    except StepError:  # the build says what is wrong with it
        return {}
    depths = mujoco_trials.depths(model, with_mimics(tree, pose), "body")
    ours = {*tree.by_body}

    def is_one_mechanism(pair: Pair) -> bool:
        return ours >= {*pair} and len({model.body(name).rootid.item() for name in pair}) == 1

    return {p: depth for p, depth in depths.items() if depth > START_M and is_one_mechanism(p)}


def soles_of(robot: InspectedRobot, anatomy: Anatomy) -> list[str]:
    """Links that the robot stands on in the build: those of its soles that have a shape."""
    shaped = {shape.link for shape in robot.shapes.shapes}
    return [sole for leg in anatomy.legs for sole in leg.soles if sole in shaped]


def _rules(robot: InspectedRobot, anatomy: Anatomy) -> dict[str, Rule]:
    """Return the rule of each link that needs one; the last word wins."""
    role: Role = "collision" if robot.shapes.of("collision") else "visual"
    solid, rules = robot.shapes.of(role), dict[str, Rule]()
    for shape in solid:  # no method can use a mesh that spans no volume
        if robot.is_flat(shape.geometry):
            rules[shape.link] = _instead(robot, shape.link, role)
    for leg in anatomy.legs if len(anatomy.legs) >= 4 else ():
        shapes = [s for s in solid if s.link == leg.foot]
        separate = not leg.rolls and (leg.foot != leg.tip or len(leg.joints) >= 4)
        is_ball = bool(shapes) and separate and all(_is_ball(robot, shape) for shape in shapes)
        if is_ball and leg.foot not in rules:
            why = "A foot that meets the ground in a point rolls best as a sphere."
            rules[leg.foot] = (why, (("method", "primitive"), ("shape", "sphere")))
    if role == "collision":
        for link in soles_of(robot, anatomy):
            if link not in robot.solid_links:
                why = "The source's collision leaves out this foot, so that it would stand on air."
                rules[link] = (why, AS_DRAWN)
    return rules


def _instead(robot: InspectedRobot, link: str, role: Role) -> Rule:
    why = f"A {role} mesh of this link is flat and can be no collision shape: "
    shapes = [shape for shape in robot.shapes.shapes if shape.link == link]
    drawn = [shape for shape in shapes if shape.role == "visual"]
    if role == "collision" and drawn and not any(robot.is_flat(s.geometry) for s in drawn):
        return why + "what is drawn of it is taken.", AS_DRAWN
    return why + "it hits nothing.", (("method", "none"),)


def _is_ball(robot: InspectedRobot, shape: SourceShape) -> bool:
    """Whether the mesh's extents, m, differ by less than BALL; a mesh that init leaves unread."""
    if not isinstance(shape.geometry, MeshFile):
        return False
    hull = robot.hull_of(shape.geometry)
    if hull is None:
        return True
    extents = np.ptp(hull.vertices, axis=0)
    return float(extents.max()) < BALL * float(extents.min())


def compound_pairs(tree: Tree, size: float) -> list[tuple[str, str]]:
    """A body and the one two joints further, where the joints are close together, or more joints,
    where they turn about one point; and linkages.
    """
    poses = forward_kinematics(tree, {})
    pairs = []
    for joint in tree.joints:
        above, near = tree.joint_above.get(joint.parent), COMPOUND * size
        while above and math.dist(poses[joint.child].xyz, poses[above.child].xyz) < near:
            pairs.append((above.parent, joint.child))
            above, near = tree.joint_above.get(above.parent), COINCIDENT_M
    return [*pairs, *_linkage_pairs(tree, poses)]


def _linkage_pairs(tree: Tree, poses: Mapping[str, Pose]) -> Iterator[tuple[str, str]]:
    """Bodies beside each other on one body that one drive turns alike, as in a parallelogram.

    Fingers that face each other turn against each other; those in a row turn about one line.
    """
    turned: dict[tuple[str, str], list[tuple[str, Array]]] = {}
    for joint in tree.moving_joints:
        mimic = joint.mimic or Mimic(joint.name)
        axis = (
            math.copysign(1.0, mimic.multiplier)
            * poses[joint.child].rotation
            @ np.asarray(joint.axis)
        )
        alike = turned.setdefault((joint.parent, mimic.joint), [])
        for other, other_axis in alike if joint.kind != "prismatic" else ():
            way = np.subtract(poses[joint.child].xyz, poses[other].xyz)
            if axis @ other_axis > ALIKE and abs(axis @ way) < (1 - ALIKE) * np.linalg.norm(way):
                yield other, joint.child
        alike.append((joint.child, axis))


PRESS_S = 0.004
"""Time constant of contacts of what grips, as a Robotiq 2F-85 has it in MuJoCo Menagerie."""
PRESSED = (0.95, 0.99, 0.001, 0.5, 2)
SOFTNESS = ("condim", "priority", "solref", "solimp")


def hand_of(robot: InspectedRobot, anatomy: Anatomy, driven: Collection[str]) -> list[str]:
    """Links of the source that touch what is held: of driven fingers, of those that follow, and
    their palms, each with what fixed joints hold on to it."""
    tree = robot.tree
    parts = roles(tree, anatomy)
    fingers = [joint for joint in tree.moving_joints if parts[joint.name] == "finger"]
    if not any(joint.name in driven for joint in fingers):
        return []
    touching = {name for joint in fingers for name in (joint.parent, joint.child)}
    body_of = {frame.name: frame.body for frame in tree.frames}
    return [
        link.name
        for link in robot.links.bodies
        if body_of.get(link.name, link.name) in touching and link.name in robot.solid_links
    ]


def put_pads(
    draft: Draft,
    robot: InspectedRobot,
    hand: Sequence[str],
    timestep: float,
    stated: Iterable[Contact] = (),
) -> None:
    """Surfaces of what grips, below `contact`, where no surface of the source says how it gives
    way. stated: these surfaces.
    """
    usual = Contact()
    gives_way = any(getattr(one, key) != getattr(usual, key) for one in stated for key in SOFTNESS)
    if not hand or gives_way:
        return
    soft = {"solref": [float(f"{max(PRESS_S, 2.0 * timestep):g}"), 1], "solimp": [*PRESSED]}
    for pattern in patterns_of(hand, list(robot.links.by_body)):
        draft.put({"condim": 4, "priority": 1, **soft}, "contact", "links", pattern)
    why = "Stiffer than MuJoCo's default of 0.02 s, so that what the hand grips does not slip."
    draft.note(why, at=("contact", "links"))


LOOP = re.compile(r"clos|loop|constraint|fermeture", re.IGNORECASE)
SIDES = ({"A", "B"}, {"a", "b"}, {"1", "2"})
"""What names of frames at a cut loop have in them, and by what those of its two sides differ."""


def note_loops(draft: Draft, links: Tree) -> None:
    """A row to uncomment for each pair of frames that are named as the two sides of a cut.

    Exporters that cut a loop leave a frame on both sides of the cut: `closedloop1_A` and `_B`,
    `closing_knee_1` and `_2`, `constraint_A`.
    """
    names = sorted(body.name for body in links.bodies if LOOP.search(body.name))
    pairs = [pair for pair in itertools.combinations(names, 2) if _are_sides(*pair)]
    if pairs:
        what = "These frames are named as the ends of a cut loop. To close it, state the rows here"
        more = "and `model: passive` for the joints that the loop moves:"
        draft.note(what, more, at=("loops",))
    for one, other in pairs:
        name = re.sub(r"[^A-Za-z0-9_.-]", "_", one)
        row = {"name": name, "kind": "connect", "a": {"link": one}, "b": {"link": other}}
        draft.note(f"- {inline(row)}", at=("loops",))


def _are_sides(one: str, other: str) -> bool:
    """Whether the names differ in their side alone."""
    apart = [{a, b} for a, b in zip(one, other, strict=False) if a != b]
    return len(one) == len(other) and len(apart) == 1 and apart[0] in SIDES


def put_own_loops(draft: Draft, hand: Collection[str], control: Control) -> None:
    """The section `loops`: those of a hand whose impedance the source leaves to MuJoCo, firmer."""
    for loop in control.loops:
        of_hand = {loop.a.body, loop.b.body} & {*hand}
        if loop.kind == "connect" and loop.solimp == SOLIMP and of_hand:
            a, b = (
                {"link": end.body, "xyz": [round(x, 9) for x in end.X_body_end.xyz]}
                for end in loop.ends
            )
            row = {"name": loop.name, "kind": loop.kind, "a": a, "b": b, "solref": [*loop.solref]}
            draft.add(row, "loops")
            draft.beside["loops",] = "the source's, but firm: else fingers tilt while they press"
