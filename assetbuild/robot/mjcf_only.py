"""What only an MJCF says of how a robot moves: springs, its own limits of effort, and the rest."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from xml.etree import ElementTree

from assetbuild.robot.model import Actuator, Control, MjcfOnly
from assetbuild.robot.pose import IDENTITY, Pose, Quat, Vec3, normalised_quat, vec3

Element = ElementTree.Element
SPRING_WORDS = ("stiffness", "springref")


def parsed(item: MjcfOnly) -> Element:
    """The element of an item."""
    return ElementTree.fromstring(item.element)  # noqa: S314 # our own reader wrote it


def without(item: MjcfOnly, keys: Iterable[str]) -> MjcfOnly:
    """The item without some of its attributes."""
    element = parsed(item)
    for key in keys:
        element.attrib.pop(key, "")
    return replace(item, element=ElementTree.tostring(element, "unicode"))


def words(values: Iterable[float]) -> str:
    """Numbers as XML has them: the shortest that are exact."""
    return " ".join(repr(float(v) + 0.0).removesuffix(".0") for v in values)


def move(element: Element, X: Pose) -> None:
    """Write where an element stands in another frame. X: pose of its own frame there."""
    if X == IDENTITY:
        return
    place, turn, direction = (_numbers(element, key) for key in ("pos", "quat", "dir"))
    pose = X @ Pose(vec3(place or (0.0, 0.0, 0.0)), _quat(turn))
    element.set("pos", words(pose.xyz))
    if turn:
        element.set("quat", words(pose.quat))
    if direction:
        element.set("dir", words(X.rotation @ direction))


def moved(item: MjcfOnly, body: str, X_body_owner: Pose) -> MjcfOnly:
    """The item on another body."""
    element = parsed(item)
    move(element, X_body_owner)
    return replace(item, element=ElementTree.tostring(element, "unicode"), owner=body)


def _numbers(element: Element, key: str) -> list[float]:
    return [float(word) for word in element.get(key, "").split()]


def _quat(numbers: Sequence[float]) -> Quat:
    w, x, y, z = numbers or IDENTITY.quat
    return normalised_quat((w, x, y, z))


def ellipsoids(items: Iterable[MjcfOnly]) -> Iterator[tuple[str, Pose, Vec3]]:
    """(link, X_link_ellipsoid, semi-axes in m) of each that collides; only MJCF has the shape."""
    for geom, link in [(parsed(item), item.owner) for item in items if item.place == "body"]:
        masks = [geom.get(mask, "1") for mask in ("contype", "conaffinity")]
        if geom.get("type") == "ellipsoid" and masks != ["0", "0"]:
            place = vec3(_numbers(geom, "pos") or (0.0, 0.0, 0.0))
            yield link, Pose(place, _quat(_numbers(geom, "quat"))), vec3(_numbers(geom, "size"))


def root_pose(items: Iterable[MjcfOnly], fixed: Pose = IDENTITY) -> Pose:
    """Where the source's world holds a floating root: torsos of some lie along their z.

    fixed: the pose of one that is held, which no item states.
    """
    for item in items:
        if item.place == "root":
            element = parsed(item)
            xyz = _numbers(element, "pos") or (0.0, 0.0, 0.0)
            return Pose(vec3(xyz), _quat(_numbers(element, "quat")))
    return fixed


@dataclass(frozen=True)
class Spring:
    """coefficients: stiffness in N m/rad or N/m, then those of a polynomial; rest: rad or m."""

    coefficients: tuple[float, ...]
    rest: float = 0.0

    @property
    def stiffness(self) -> float:
        """N m/rad or N/m, of a linear spring and of a polynomial at its rest."""
        return self.coefficients[0]

    @property
    def text(self) -> str:
        """The stiffness as the MJCF states it."""
        return " ".join(f"{number:g}" for number in self.coefficients)


def joint_springs(items: Iterable[MjcfOnly]) -> dict[str, Spring]:
    """The springs by the name of their joint."""
    springs = {}
    for item in items:
        if item.place == "joint":
            element = parsed(item)
            stiffness = tuple(float(word) for word in element.get("stiffness", "").split())
            if any(stiffness):
                springs[item.owner] = Spring(stiffness, float(element.get("springref", "0")))
    return springs


def as_drives(control: Control) -> dict[str, Spring]:
    """The springs that a simulator can hold as the drive of their joint.

    k (rest - q) is the law of both. Beside a drive of its own there is no room: the sum of
    kp (target - q) and k (rest - q) is one drive for one target alone, and the drive's limit of
    effort would hold back the spring.
    """
    why = no_drives(control)
    return {name: s for name, s in joint_springs(control.mjcf_only).items() if name not in why}


def no_drives(control: Control) -> dict[str, str]:
    """Why a spring cannot be the drive of its joint, by the joint's name."""
    rows, reasons = control.by_joint, {}
    for name, spring in joint_springs(control.mjcf_only).items():
        if any(spring.coefficients[1:]):
            reasons[name] = f"its stiffness is a polynomial ({spring.text})"
        elif (row := rows.get(name)) is not None and row.model != "passive":
            reasons[name] = f"its joint has a drive of its own (`{row.model}`)"
    return reasons


EFFORT_WORDS: Mapping[str, tuple[str, ...]] = {
    "joint": ("actuatorfrcrange", "actuatorfrclimited"),
    "drive": ("forcerange", "forcelimited", "ctrlrange", "ctrllimited"),
}
"""Attributes that limit the effort of a joint, by the place of `MjcfOnly`."""


def of_same_effort(
    items: Iterable[MjcfOnly], before: Mapping[str, Actuator], now: Mapping[str, Actuator]
) -> Iterator[MjcfOnly]:
    """The items without the old limits of joints whose effort limit is another one now."""
    for item in items:
        old, new = before.get(item.owner), now.get(item.owner)
        if item.place in EFFORT_WORDS and old and (new is None or new.effort != old.effort):
            item = without(item, EFFORT_WORDS[item.place])
            if not parsed(item).attrib:
                continue
        yield item


def force_range(item: MjcfOnly) -> tuple[float, float] | None:
    """The `actuatorfrcrange` of a joint that an item states, N m or N."""
    element = parsed(item)
    stated = element.get("actuatorfrcrange", "") if item.place == "joint" else ""
    if not stated or element.get("actuatorfrclimited") == "false":
        return None
    lower, upper = (float(end) for end in stated.split())
    return lower, upper


_HELD = {"connect": "bodies at a point", "weld": "bodies", "flex": "flexible bodies"}
TENDON = ("stiffness", "damping", "frictionloss", "armature", "range", "actuatorfrcrange")
MEDIUM = ("wind", "density", "viscosity", "magnetic")
FLAGS = ("actuation", "clampctrl", "constraint", "contact", "damper", "equality", "frictionloss",
         "limit", "spring")  # fmt: skip
"""Flags of `<option>` that switch off something that every other format has."""
_BRAKES = ("damping", "armature", "frictionloss", "stiffness")


def lost_motion(items: Iterable[MjcfOnly]) -> dict[str, tuple[str, ...]]:
    """What is lost in words, with the names of the things that it concerns."""
    lost: dict[str, list[str]] = {}
    for item in items:
        element = parsed(item)
        for what in _lost(item, element):
            lost.setdefault(what, []).append(item.owner or element.get("name", ""))
    return {what: tuple(names) for what, names in lost.items()}


def lost_in_usd(items: Sequence[MjcfOnly]) -> dict[str, tuple[str, ...]]:
    """What `lost_motion` lists, without bodies that gravity does not pull, which PhysX knows."""
    weightless = whole_gravity(items)
    return lost_motion(i for i in items if i.place != "body" or i.owner not in weightless)


def whole_gravity(items: Iterable[MjcfOnly]) -> frozenset[str]:
    """Bodies whose weight is compensated wholly (`gravcomp` 1), so that gravity does not pull them.

    None where a joint's drive makes that force itself (`actuatorgravcomp`).
    """
    items = tuple(items)
    for item in items:
        if item.place == "joint" and 'actuatorgravcomp="true"' in item.element:
            return frozenset()
    return frozenset(body for body, share in carried_weight(items).items() if share == 1.0)


def base_brakes(items: Iterable[MjcfOnly]) -> str:
    """What brakes or holds the floating base, in words; "" where nothing does."""
    bases = (parsed(item) for item in items if item.place == "freejoint")
    stated = ((key, base) for base in bases for key in _BRAKES if _some(base, (key,)))
    return ", ".join(f"`{key}` {base.get(key)}" for key, base in stated)


def carried_weight(items: Iterable[MjcfOnly]) -> dict[str, float]:
    """Body -> share of its weight that MuJoCo compensates (`gravcomp`)."""
    bodies = (i for i in items if i.place == "body" and i.element.startswith("<body"))
    return {item.owner: float(parsed(item).get("gravcomp", "0")) for item in bodies}


def _lost(item: MjcfOnly, element: Element) -> Iterator[str]:
    if item.place == "equality" and (what := _of_equality(element)):
        yield what
    if item.place == "tendon" and _some(element, TENDON):
        yield "tendons that pull, brake or stop"
    if item.place == "actuator" and not item.owner:
        yield "actuators that no drive of a joint can be"
    if item.place == "body" and element.tag == "body" and _some(element, ("gravcomp",)):
        yield "gravity compensation of bodies"
    if item.place == "option":
        yield from _of_option(element)
    if brakes := base_brakes((item,)):
        taken = "a `<freejoint>` takes none from its class"
        yield f"what brakes or holds the floating base ({brakes}; {taken})"
    if item.place == "joint" and len(element.get("damping", "").split()) > 1:
        yield "damping of joints by a polynomial"
    if item.place == "shape" and _some(element, ("surfacevel",)):
        yield "surfaces that move what touches them (`surfacevel`)"


def _of_option(element: Element) -> Iterator[str]:
    if _some(element, MEDIUM):
        yield "the medium around the robot (`wind`, `density`, `viscosity`)"
    if element.get("actuatorgroupdisable"):
        yield "groups of actuators that are switched off (`actuatorgroupdisable`)"
    off = [k for flag in element for k, v in flag.attrib.items() if k in FLAGS and v == "disable"]
    for name in off:
        yield f"flags that switch something off (`{name}`)"


def _of_equality(element: Element) -> str:
    if element.get("active") == "false":
        return ""
    if element.tag == "joint":
        return "joints that follow others by a polynomial, or are held at a position"
    if element.tag == "tendon":
        return "couplings of tendons"
    return f"constraints that hold {_HELD.get(element.tag, 'parts')} together"


def _some(element: Element, names: Iterable[str]) -> bool:
    """Whether it states one of these numbers, and not as 0."""
    return any(float(word) != 0.0 for name in names for word in element.get(name, "").split())
