"""What an MJCF says beyond links and shapes, joined with what the recipe says: the recipe wins."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TypeVar

from assetbuild.control.only_mjcf import commands_of, explain_gears, explain_opaque, wider_excludes
from assetbuild.control.senses import changed
from assetbuild.errors import quoted
from assetbuild.findings import Finding, Rule
from assetbuild.robot.actuator_table import ActuatorRow
from assetbuild.robot.chains import ROWS, angles_of
from assetbuild.robot.contact import Surface
from assetbuild.robot.contact_filter import ContactFilter
from assetbuild.robot.files import SourceControl
from assetbuild.robot.mjcf_only import moved, of_same_effort, parsed, without
from assetbuild.robot.model import (
    Actuator,
    Camera,
    Contact,
    Control,
    Keyframe,
    MjcfOnly,
    Sensor,
    Simulation,
    Tree,
)
from assetbuild.robot.shapes import Shapes
from assetbuild.robot.sides import Side, side_of
from assetbuild.source.mjcf.text import dropped

BODY_NAMES = ("body", "body1", "body2", "target")
"""Attributes that name a body, in the elements that `MjcfOnly` holds."""


T = TypeVar("T", Sensor, Camera)
M = TypeVar("M", Contact, Simulation)

NEW_SURFACE = Rule(
    "mjcf.new_surface",
    "info",
    "collision shapes that the recipe made anew get the surface that most of the source's shapes "
    "have",
    "use `method: keep` to keep the source's shapes with their own surfaces",
)


@dataclass(frozen=True)
class StatedControl:
    """What the recipe says. sides: see `Side`; rows: of the actuator table; surfaces: by pattern
    of links.
    """

    sides: Sequence[Side] = (Side(from_mjcf=True),)
    rows: tuple[ActuatorRow, ...] = ()
    surfaces: Mapping[str, Surface] = field(default_factory=dict)

    @property
    def base(self) -> Side:
        """The robot that carries the others."""
        return self.sides[0]

    def replaces(self, joint: str) -> bool:
        """Whether the recipe says what drives a joint."""
        rows = any(re.fullmatch(row.joints, joint) for row in self.rows)
        return rows or not side_of(self.sides, joint).drives_itself

    def has_table(self, actuator: str) -> bool:
        """Whether the recipe states a whole table of drives where an actuator belongs."""
        return "actuators" in side_of(self.sides, actuator).stated


def join(
    control: Control, source: SourceControl, tree: Tree, shapes: Shapes, stated: StatedControl
) -> tuple[Control, list[Finding]]:
    """The source's words where the recipe has none, and what is said about joining.

    control: as the recipe alone makes it, but with the keyframes of both and no surfaces that
    differ. source: empty where it says nothing.
    """
    source_control, findings = source.control, list[Finding]()
    contact, contacts = _contacts(control.contact, source, shapes, stated, findings)
    actuators = _actuators(control, source_control, stated, tree)
    now = {actuator.joint: actuator for actuator in actuators}
    kept = _kept(source_control, tree, shapes, stated, findings)
    mjcf_only = tuple(of_same_effort(kept, source_control.by_joint, now))
    mjcf_only += tuple(commands_of(source, control.keyframes, stated.replaces, stated.has_table))
    sensors = [s for s in source_control.sensors if not _lost_bodies(s, tree, findings)]
    excludes = _acting(source_control, tree, shapes)
    joined = replace(
        control,
        actuators=actuators,
        excludes=tuple(sorted({*control.excludes, *_carried(excludes, tree)})),
        contact=contact,
        contacts=contacts,
        simulation=_simulation(control.simulation, source_control.simulation, stated.base),
        sensors=_by_name(control.sensors, sensors),
        cameras=_by_name(control.cameras, source_control.cameras),
        mjcf_only=mjcf_only,
    )
    rule = ContactFilter.of(tree, shapes, joined)
    apart = {pair for pair in _carried(source.neighbours, tree) if not rule.passes(*pair)}
    joined = replace(joined, excludes=tuple(sorted({*joined.excludes, *apart})))
    findings += [*explain_gears(actuators), *explain_opaque(mjcf_only)]
    findings += wider_excludes(excludes, tree, shapes)
    return joined, findings


def _by_name(recipe: tuple[T, ...], source: Sequence[T]) -> tuple[T, ...]:
    """The source's, then those of the recipe; one with the same name takes its place."""
    anew: dict[str, T] = {thing.name: thing for thing in recipe}
    kept: list[T] = [anew.pop(thing.name, thing) for thing in source]
    return tuple(kept + list(anew.values()))


# --- drives and poses -----------------------------------------------------------------------


def _actuators(
    control: Control, source_control: Control, stated: StatedControl, tree: Tree
) -> tuple[Actuator, ...]:
    """One for each moving joint in tree order; a row without armature leaves the source's.

    A joint's effort limit is that of its drive as it was read; it differs where an edit sets it.
    """
    stating = [r.joints for r in stated.rows if r.armature is not None or r.motor is not None]

    def chosen(actuator: Actuator) -> Actuator:
        name = actuator.joint
        before = source_control.by_joint.get(name)
        if not stated.replaces(name):
            kept = before or Actuator(name, "passive")
            effort = tree.by_joint[name].limits.effort
            return replace(kept, effort=effort) if effort else kept
        if before is None or any(re.fullmatch(pattern, name) for pattern in stating):
            return actuator
        return replace(actuator, armature=before.armature)

    return tuple(chosen(actuator) for actuator in control.actuators)


def source_keyframes(
    source: Sequence[Keyframe],
    tree: Tree,
    poses: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
) -> Iterator[Keyframe]:
    """The source's keyframes on this tree. poses: of a composite's parts, by keyframe and joint."""
    order = [joint.name for joint in tree.moving_joints]
    for key in source:
        values = _split_balls(key, tree) | dict(key.joints) | dict(poses.get(key.name, {}))
        joints = tuple((name, values.get(name, 0.0)) for name in order)
        base = key.base if tree.base == "floating" else None
        turns = tuple(row for row in key.turns if row[0] in tree.by_joint)
        yield Keyframe(key.name, joints, base, turns)


def _split_balls(key: Keyframe, tree: Tree) -> dict[str, float]:
    """Positions of the hinges that an edit made of the source's ball joints, rad."""
    return {
        f"{name}_{suffix}": angle
        for name, turn in key.turns
        if name not in tree.by_joint
        for (suffix, _), angle in zip(ROWS["ball"], angles_of(turn), strict=True)
    }


def _simulation(recipe: Simulation, source: Simulation, base: Side) -> Simulation:
    """Return a composite's options as the base states them; only an MJCF states any itself."""
    if not base.from_mjcf:
        return recipe
    source = source.model_copy(update={"decimation": recipe.decimation})  # no MJCF states one
    return _recipe_wins("simulation", recipe, source, base)


def _recipe_wins(section: str, recipe: M, source: M, base: Side) -> M:
    """What the source says, but for the keys of the section that the recipe states."""
    keys = [key for key in type(source).model_fields if f"{section}.{key}" in base.stated]
    return source.model_copy(update={key: getattr(recipe, key) for key in keys})


# --- surfaces -------------------------------------------------------------------------------


def _contacts(
    recipe: Contact,
    source: SourceControl,
    shapes: Shapes,
    stated: StatedControl,
    findings: list[Finding],
) -> tuple[Contact, tuple[tuple[str, Contact], ...]]:
    """The common surface and those that differ; what the recipe says holds for all of them."""
    source_control, by_prefix = source.control, dict(source.surfaces)

    def with_recipe(contact: Contact) -> Contact:
        return _recipe_wins("contact", recipe, contact, stated.base)

    common, by_shape = recipe, dict(source_control.contacts)
    if stated.base.from_mjcf:
        common = with_recipe(source_control.contact)
    contacts, anew = [], dict[str, list[str]]()
    for shape in shapes.of("collision"):
        side, now = side_of(stated.sides, shape.link), recipe
        if side.from_mjcf:
            before = by_shape.get(shape.name) or by_shape.get(re.sub(r"_\d+$", "", shape.name))
            if before is None:
                anew.setdefault(side.prefix, []).append(shape.name)
            now = before or by_prefix.get(side.prefix, source_control.contact)
            now = with_recipe(now) if side == stated.base else now
        now = changed(now, stated.surfaces, shape.link)
        if now != common:
            contacts.append((shape.name, now))
    for prefix, names in anew.items():
        of_side = {c for n, c in by_shape.items() if side_of(stated.sides, n).prefix == prefix}
        if len(of_side) > 1:
            finding = NEW_SURFACE(
                "recipe collision",
                f"{len(names)} collision shapes are not the source's: {quoted(names, 6)}; they "
                "have the surface that most shapes of the source have",
                data={"shapes": len(names)},
            )
            findings.append(finding)
    return common, tuple(contacts)


# --- what only MJCF says --------------------------------------------------------------------


def _kept(
    source_control: Control,
    tree: Tree,
    shapes: Shapes,
    stated: StatedControl,
    findings: list[Finding],
) -> Iterator[MjcfOnly]:
    """All but what the recipe replaced, and what names a body that was merged away."""
    shown = [shape.name for shape in shapes.shapes]
    named = {item.owner for item in source_control.mjcf_only if item.place == "shape"} | dict(
        source_control.contacts
    ).keys()
    materials = {material.name for material in shapes.materials}
    replaced, gone = _replaced(source_control, stated), []
    for item in source_control.mjcf_only:
        if item.place == "actuator" and _attribute(item, "name") in replaced:
            continue
        if item.place == "drive" and stated.replaces(item.owner):
            continue
        if item.place == "sensor" and _attribute(item, "actuator") in replaced:
            message = f"a sensor of a drive that the recipe replaced was left out: {item.element}"
            hint = "name a sensor of the joint under `sensors:`"
            findings.append(dropped("sensor", "recipe actuators", message, hint, "warning"))
            continue
        if item.place == "shape":
            piece = re.escape(item.owner) + r"_\d+"  # `trunk_2` of `trunk`
            pieces = [
                name
                for name in shown
                if name == item.owner or (name not in named and re.fullmatch(piece, name))
            ]
            yield from (replace(item, owner=name) for name in pieces)
            gone += [] if pieces else [item.owner]
        elif item.place == "material" and item.owner not in materials:
            continue
        elif item.place == "option":
            yield _without_stated(item, stated.base.stated)
        elif item.place == "joint" and item.owner not in tree.by_joint:
            message = "an edit replaced the joint: what its MJCF says of it was left out: "
            hint = "state damping, friction and armature of the new joints in `actuators`"
            where = f"joint {item.owner}"
            findings.append(dropped("joint", where, message + item.element, hint, "warning"))
        elif (on_body := _on_its_body(item, tree)) is not item:
            yield on_body
        elif not _lost_bodies(item, tree, findings):
            yield item
        elif item.place == "camera":
            yield without(item, ("mode", "target"))
    if gone:
        message = f"{len(gone)} geoms of the source have other shapes now: what only MJCF says of "
        message += f"`{gone[0]}` and the like was left out"
        hint = "use `method: keep` to keep the source's shapes"
        findings.append(dropped("geom", "recipe collision", message, hint, count=len(gone)))


def _replaced(source_control: Control, stated: StatedControl) -> frozenset[str]:
    """Names of the source's drives that the recipe's table takes the place of."""
    replaced = {a.name for a in source_control.actuators if a.name and stated.replaces(a.joint)}
    for item in source_control.mjcf_only:
        if item.place == "actuator":
            name, joint = _attribute(item, "name"), _attribute(item, "joint")
            if stated.has_table(name) or (joint and stated.replaces(joint)):
                replaced.add(name)
    return frozenset(replaced)


def _attribute(item: MjcfOnly, key: str) -> str:
    return parsed(item).get(key, "")


def _without_stated(item: MjcfOnly, stated: Collection[str]) -> MjcfOnly:
    """Options of the source that the recipe does not state itself. stated: of the base.

    MuJoCo's own `impratio` belongs to its pyramid: another cone gets ours.
    """
    keys = [key.removeprefix("mjcf.") for key in stated if key.startswith("mjcf.")]
    if "cone" in keys and _attribute(item, "impratio") == "1":
        keys.append("impratio")
    return without(item, keys)


def _acting(source: Control, tree: Tree, shapes: Shapes) -> list[tuple[str, str]]:
    """The source's excludes but for those of a merged link without a shape, which keep nothing
    apart: its body would pass through the other.
    """
    able = {shape.link for shape in shapes.of("collision")} | tree.by_body.keys()
    able |= {item.owner for item in source.mjcf_only if item.place == "body"}
    return [pair for pair in source.excludes if able.issuperset(pair)]


def _carried(pairs: Iterable[tuple[str, str]], tree: Tree) -> Iterator[tuple[str, str]]:
    """The source's pairs, between the bodies that their links became part of."""
    for pair in pairs:
        a, b = sorted(tree.placement(link)[0] for link in pair)
        if a != b:
            yield a, b


def _on_its_body(item: MjcfOnly, tree: Tree) -> MjcfOnly:
    """A shape or light of a link that was merged, on the body that the link became part of."""
    frame = next((frame for frame in tree.frames if frame.name == item.owner), None)
    if item.place != "body" or not _attribute(item, "pos") or frame is None:
        return item
    return moved(item, frame.body, frame.X_body_frame)


def _lost_bodies(thing: Sensor | MjcfOnly, tree: Tree, findings: list[Finding]) -> list[str]:
    """The bodies that it stands on or names, and that were merged into others; one is reported."""
    what, names = _bodies_of(thing)
    lost = [name for name in names if name != "world" and name not in tree.by_body]
    for name in lost[:1]:
        message = f"{what} was left out: its body `{name}` was merged into another"
        hint = f"name `{name}` in `fixed_joints.keep_bodies`"
        findings.append(dropped(what, f"link {name}", message, hint, "warning"))
    return lost


def _bodies_of(thing: Sensor | MjcfOnly) -> tuple[str, list[str]]:
    """What to call it, and the bodies that it stands on or names."""
    if isinstance(thing, Sensor):
        places = [place for place in (thing.at, thing.relative_to) if place]
        return f"sensor `{thing.name}`", [p.name for p in places if p.kind == "body"]
    element = parsed(thing)
    names = [value for key in BODY_NAMES if (value := element.get(key))]
    names += [
        element.get(f"{side}name", "")
        for side in ("obj", "ref")
        if element.get(f"{side}type") in ("body", "xbody")
    ]
    if thing.place in ("body", "root") and thing.owner:
        names.append(thing.owner)
    name = element.get("name")
    return f"<{element.tag}> `{name}`" if name else thing.element, names
