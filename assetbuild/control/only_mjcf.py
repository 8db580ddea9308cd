"""What only the MJCF holds, one finding for each kind of thing."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from xml.etree import ElementTree

from assetbuild.errors import quoted
from assetbuild.findings import Finding, Rule
from assetbuild.grouping import grouped
from assetbuild.robot.files import SourceControl
from assetbuild.robot.mjcf_only import (
    EFFORT_WORDS,
    SPRING_WORDS,
    force_range,
    joint_springs,
    lost_motion,
    parsed,
)
from assetbuild.robot.model import Actuator, Keyframe, MjcfOnly, Tree
from assetbuild.robot.shapes import Shapes

ONLY_IN_MJCF = Rule(
    "mjcf.only",
    "info",
    "what only MJCF can express (sizes of sites, tendons, lights, solver options, ...) is kept "
    "in the MJCF; the other formats are written without it",
    "nothing",
)
UNEVEN_EFFORT = Rule(
    "mjcf.uneven_effort",
    "warning",
    "`actuatorfrcrange` limits a joint's effort more in one direction than in the other; the "
    "MJCF has both numbers, URDF, USD and the trainers' modules have one, the larger",
    "give the joint a row in `actuators` with the `effort` that all formats shall have",
)


SPRING = Rule(
    "mjcf.spring",
    "warning",
    "joints of the MJCF have springs (`stiffness`, `springref`), which the MJCF, the mjx model and "
    "mjlab's model keep; the USD holds them as drives where the joints have no other; the URDF is "
    "written without them",
    "command no targets to these joints in PhysX and Newton, whose drives rest where the springs "
    "do; do not use the URDF where the spring matters",
)
MOTION = Rule(
    "mjcf.motion",
    "warning",
    "the MJCF says what moves the robot and only MJCF can say (tendons, couplings beyond a linear "
    "one, actuators of anything but a joint, gravity compensation, a medium, flags that switch "
    "something off): other formats are written without it and move otherwise",
    "use the MJCF, the mjx model or mjlab's model where the motion matters",
)
GEAR = Rule(
    "mjcf.gear",
    "info",
    "actuators of the MJCF have a `gear`: the MJCF keeps it and its commands, all other formats "
    "have the drive as it acts on the joint",
    "multiply a position or a speed by the gear, and divide an effort by it, where you send it to "
    "the MJCF's actuator",
)


OWN_DRIVE = Rule(
    "mjcf.own_drive",
    "info",
    "an actuator of the MJCF pulls a tendon over joints that follow one another, or scales its "
    "command: the MJCF keeps it, all other formats have the same drive on the joint",
    "outside of the MJCF command a position or a speed of the joint",
)


def explain_gears(actuators: Iterable[Actuator]) -> Iterator[Finding]:
    """What was folded into the joints' numbers."""
    geared = {row.joint: row.gear for row in actuators if row.gear != 1.0}
    if geared:
        gears = {name: f"{gear:.4g}" for name, gear in geared.items()}
        listed = quoted(gears, 4, notes=gears)
        yield GEAR(
            "robot",
            f"actuators of {len(geared)} joints have a gear g: {listed}; URDF, USD and the "
            "trainers' modules have the drive on the joint: kp and kd times g^2, effort times |g|, "
            "commands of position and speed divided by g, of effort times g",
            data=geared,
        )


def explain_opaque(items: tuple[MjcfOnly, ...]) -> Iterator[Finding]:
    """One finding for each kind of thing that only the MJCF holds."""
    if springs := {joint: spring.text for joint, spring in joint_springs(items).items()}:
        has = "1 joint has a spring" if len(springs) == 1 else f"{len(springs)} joints have springs"
        yield SPRING(
            "robot",
            f"{has} (N m/rad or N/m): {quoted(springs, 4, notes=springs)}; the URDF cannot hold "
            "them, so it moves differently; in the USD a spring is the drive of a joint that has "
            "no other",
            data=springs,
        )
    for what, names in lost_motion(items).items():
        yield MOTION(
            "robot",
            f"{what}: in the MJCF only, the other formats move otherwise: "
            f"{quoted(filter(None, names), 4) or 'the whole robot'}",
            data={"what": what, "names": names},
        )
    groups: dict[tuple[str, str], list[str]] = {}
    for item in items:
        if item.place in ("equality", "actuator") and lost_motion((item,)):
            continue
        if item.place == "actuator" and item.owner:
            yield _own_drive(item)
            continue
        element = parsed(item)
        yield from _uneven(item)
        # The robot's effort limit holds it, or `SPRING` says it; an empty one is left to MuJoCo.
        springs_too = SPRING_WORDS if item.place == "joint" else ()
        covered = {*EFFORT_WORDS.get(item.place, ()), *springs_too}
        stated = [key for key, value in element.attrib.items() if value and key not in covered]
        if not stated and (covered or item.place == "camera"):
            continue
        summary = f"<{element.tag}>"
        if item.place in _BY_ATTRIBUTES:
            summary = ", ".join(f"`{key}`" for key in stated)
        groups.setdefault((item.place, summary), []).append(item.owner or element.get("name", ""))
    lines = []
    for (place, summary), owners in groups.items():
        listed = quoted(filter(None, owners), 4)
        lines.append(f"{summary} of {_WORDS.get(place, place)} {listed}" if listed else summary)
    if lines:
        yield ONLY_IN_MJCF(
            "robot",
            f"in the MJCF only, the other formats are written without it: {'; '.join(lines)}",
            data={"said": tuple(lines)},
        )


def _own_drive(item: MjcfOnly) -> Finding:
    element = parsed(item)
    name, tendon = element.get("name", ""), element.get("tendon", "")
    why = f"pulls the tendon `{tendon}`, whose joints follow this one" if tendon else ""
    return OWN_DRIVE(
        f"joint {item.owner}",
        f"`{name}` {why or 'scales its command'}: the MJCF keeps it, in all other formats it is "
        "the drive of this joint, which moves alike",
        data={"actuator": name, "tendon": tendon},
    )


def _uneven(item: MjcfOnly) -> Iterator[Finding]:
    ends = force_range(item)
    if ends is not None and -ends[0] != ends[1]:
        lower, upper = ends
        yield UNEVEN_EFFORT(
            f"joint {item.owner}",
            f"its effort lies in {lower:.4g}..{upper:.4g} (`actuatorfrcrange`): the MJCF has both "
            f"ends, URDF, USD and the trainers' modules are limited to {max(-lower, upper):.4g} "
            "either way",
            data={"lower": lower, "upper": upper},
        )


_BY_ATTRIBUTES = frozenset(
    ("joint", "shape", "frame", "camera", "material", "option", "size", "drive", "mimic", "root")
)
_WORDS = {"shape": "geom", "frame": "site", "drive": "actuator", "mimic": "coupled joint"}


def commands_of(
    source: SourceControl,
    keyframes: Sequence[Keyframe],
    replaces: Callable[[str], bool],
    has_table: Callable[[str], bool],
) -> Iterator[MjcfOnly]:
    """The commands of each keyframe, by actuator.

    A drive whose joint stands elsewhere now than in the source gets the command of that place.
    replaces: whether the recipe says what drives a joint; has_table: whether it says so of all
    drives where an actuator belongs.
    """
    joint_of = {a.name: a.joint for a in source.control.actuators if a.name}
    before = {key.name: dict(key.joints) for key in source.control.keyframes}
    stated = dict(source.ctrl)
    resting = stated.pop("", ())
    drives = [i for i in source.control.mjcf_only if i.place == "actuator" and i.owner]
    drives = [item for item in drives if not replaces(item.owner)]
    for key in keyframes:
        now, was = dict(key.joints), before.get(key.name, {})
        holding = (_holding(item, source.control.by_joint[item.owner], now) for item in drives)
        commands = dict(filter(None, holding))
        for actuator, value in stated.get(key.name, () if key.name in before else resting):
            joint = joint_of.get(actuator)
            if joint is None:
                if has_table(actuator):
                    continue
            elif replaces(joint) or (joint in was and was[joint] != now.get(joint, was[joint])):
                continue
            commands[actuator] = value
        element = ElementTree.Element("key")
        for actuator, value in commands.items():
            ElementTree.SubElement(element, "ctrl", {"actuator": actuator, "value": repr(value)})
        if len(element):
            yield MjcfOnly("keyframe", ElementTree.tostring(element, "unicode"), key.name)


def _holding(item: MjcfOnly, row: Actuator, pose: Mapping[str, float]) -> tuple[str, float] | None:
    """(actuator, its command at rest in a pose) of one that holds positions: see `MjcfOnly`."""
    element = parsed(item)
    if row.model != "pd":
        return None
    gain = float(element.get("gainprm", "").split()[0])
    constant, stiff = (float(word) for word in element.get("biasprm", "").split()[:2])
    length = row.gear * pose.get(row.joint, 0.0)
    return row.name, (0.0 - stiff * length - constant) / gain


WIDER_EXCLUDE = Rule(
    "mjcf.wider_exclude",
    "warning",
    "the source excludes one of several links that were merged into one body: now it excludes all",
    "`fixed_joints.keep_bodies` keeps a link as a body",
)


def wider_excludes(
    excludes: Collection[tuple[str, str]], tree: Tree, shapes: Shapes
) -> Iterator[Finding]:
    """A finding for each pair of bodies that loses contacts. excludes: pairs of the source's links.

    Bodies that a joint connects never touch in MuJoCo.
    """
    excluded = {frozenset(pair) for pair in excludes}
    adjacent = {frozenset((joint.parent, joint.child)) for joint in tree.joints}
    links = dict.fromkeys(shape.link for shape in shapes.of("collision"))
    solid = grouped(links, lambda link: tree.placement(link)[0])
    bodies = (sorted(tree.placement(link)[0] for link in pair) for pair in excludes)
    for a, b in sorted({(a, b) for a, b in bodies if a != b}):
        pairs = [(one, two) for one in solid.get(a, ()) for two in solid.get(b, ())]
        lost = [pair for pair in pairs if frozenset(pair) not in excluded]
        if not lost or frozenset((a, b)) in adjacent:
            continue
        shown = ", ".join(f"`{one}` and `{two}`" for one, two in lost[:3])
        yield WIDER_EXCLUDE(
            f"pair {a} {b}",
            f"{shown}{', ...' if len(lost) > 3 else ''} touch in the source, and no longer here",
            f"name {lost[0][0]} or {lost[0][1]} in `fixed_joints.keep_bodies`",
            data={"pairs": len(lost)},
        )
