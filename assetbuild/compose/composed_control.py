"""What the MJCFs of a composite say beyond links and shapes, as one: names, poses, commands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar
from xml.etree import ElementTree

from pydantic import BaseModel, ConfigDict

from assetbuild.errors import RecipeError
from assetbuild.robot.files import SourceControl
from assetbuild.robot.mjcf_only import move, parsed, root_pose
from assetbuild.robot.model import Camera, Loop, MjcfOnly, Place, Sensor, Tree
from assetbuild.robot.pose import Pose
from assetbuild.robot.sections import At, Mount
from assetbuild.source.mjcf.scenery import NAMES

Named = TypeVar("Named", bound=Any)  # Any: a frozen dataclass or model
WORLD = "world"
REFERENCES = NAMES.keys() | {"name", "material", "objname", "refname"}
"""Attributes that name something of the robot, in the elements that `MjcfOnly` holds."""
OF_THE_BASE = ("option", "size", "root", "freejoint")
"""What a part says for itself alone: how it is simulated, and where it stands in its own world."""
JOINED = ("actuators", "excludes", "contacts", "sensors", "cameras", "mjcf_only", "loops")
"""What the whole has of all sides, one after another."""
TIMESTEP_S = 0.002
"""MuJoCo's own, where nothing is stated."""
_LIKE_MUJOCO = {
    "integrator": "Euler",
    "cone": "pyramidal",
    "impratio": "1",
    "tolerance": "1e-08",
}


@dataclass(frozen=True)
class KeyOf:
    """The pose of a part in a keyframe of the whole is that of its source's keyframe `source`.

    moved: joints of the part, by their own names, that the recipe puts elsewhere.
    """

    name: str
    source: str
    moved: tuple[str, ...] = ()


class MountedPart(BaseModel):
    """A part and its place. prefix: of all its names, and the folder of its inputs."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    prefix: str
    at: At
    mount: Mount | None = None
    left_out: tuple[str, ...] = ()
    """Keys of the part's recipe that the whole does not follow."""
    keeps: bool = False
    """Whether the bodies of its MJCF stay as they are."""
    keys: tuple[KeyOf, ...] = ()
    """Keyframes of the whole in which its source says how it stands."""


@dataclass(frozen=True)
class PartControl:
    """What the MJCF of a part says, in the part's own names, as its tree has them."""

    part: MountedPart
    tree: Tree
    source_control: SourceControl

    @property
    def prefix(self) -> str:
        """Prefix of all its names in the whole."""
        return self.part.prefix

    def prefixed(self) -> SourceControl:
        """All of it about the names in the whole; what is the base's alone is left out."""
        control, prefix = self.source_control.control, self.prefix
        return SourceControl(
            replace(
                control,
                actuators=tuple(under(prefix, a, "joint", "name") for a in control.actuators),
                keyframes=(),
                excludes=tuple((prefix + a, prefix + b) for a, b in control.excludes),
                contacts=tuple((prefix + name, contact) for name, contact in control.contacts),
                sensors=tuple(self._sensor(sensor) for sensor in control.sensors),
                cameras=tuple(self._camera(camera) for camera in control.cameras),
                mjcf_only=tuple(self._items()),
                loops=tuple(self._loop(loop) for loop in control.loops),
            ),
            bodies=tuple(prefix + name for name in self.source_control.bodies * self.part.keeps),
            ctrl=tuple(self._commands()),
            neighbours=tuple((prefix + a, prefix + b) for a, b in self.source_control.neighbours),
        )

    # --- names --------------------------------------------------------------------------------

    def _name(self, name: str) -> str:
        """The world is the world, unless the part itself calls its root so."""
        return name if name == WORLD and self.tree.root != WORLD else self.prefix + name

    def _place(self, place: Place) -> Place:
        if place.kind == "world":
            return Place("frame", self.prefix + WORLD) if self.tree.root == WORLD else place
        return replace(place, name=self._name(place.name))

    def _sensor(self, sensor: Sensor) -> Sensor:
        relative = self._place(sensor.relative_to) if sensor.relative_to else None
        named = under(self.prefix, sensor, "name")
        return replace(named, at=self._place(sensor.at), relative_to=relative)

    def _loop(self, loop: Loop) -> Loop:
        a, b = (under(self.prefix, end, "body") for end in loop.ends)
        return replace(under(self.prefix, loop, "name"), a=a, b=b)

    def _items(self) -> Iterator[MjcfOnly]:
        for item in self.source_control.control.mjcf_only:
            if item.place in OF_THE_BASE:
                continue
            element = parsed(item)
            owner = self.prefix + item.owner if item.owner else ""
            if item.place == "body" and not item.owner:
                owner = self.prefix + self.tree.root
                move(element, self.pose_in_root)  # a light of the part's world
            if element.tag in ("weld", "connect"):
                self._hold(element)
            for inner in element.iter():
                for key in REFERENCES & inner.attrib.keys():
                    if inner.get(key):
                        inner.set(key, self._name(inner.get(key, "")))
            yield MjcfOnly(item.place, ElementTree.tostring(element, "unicode"), owner)

    def _hold(self, element: ElementTree.Element) -> None:
        """A loop closed through the world: through the part's root, or not at all."""
        bodies = [element.get(key) for key in ("body1", "body2") if element.get(key)]
        if element.get("site1") or (len(bodies) == 2 and WORLD not in bodies):
            return
        if self.tree.root != WORLD:
            raise RecipeError(
                f"<{element.tag}> `{element.get('name')}` of the part `{self.prefix}` holds "
                f"`{bodies[0]}` to the world: on another robot it would nail that to the ground",
                hint="hold it to a body or a site of the part in its MJCF",
            )
        element.attrib.setdefault("body2", WORLD)

    # --- what stands in the part's own world --------------------------------------------------

    @property
    def pose_in_root(self) -> Pose:
        """The pose of the part's own world in its root, which may stand anywhere in it."""
        return root_pose(self.source_control.control.mjcf_only, self.tree.X_world_root).inverse()

    def _camera(self, camera: Camera) -> Camera:
        """One in the part's world stands on its root now, as where it is attached in MuJoCo."""
        if camera.link is None:
            pose = self.pose_in_root @ camera.X_link_camera
            camera = replace(camera, link=self.tree.root, X_link_camera=pose)
        return under(self.prefix, camera, "name", "link")

    def scenery(self) -> list[str]:
        """Names of cameras and lights in the part's own world."""
        control = self.source_control.control
        names = [camera.name for camera in control.cameras if camera.link is None]
        lights = (i for i in control.mjcf_only if i.place == "body" and not i.owner)
        return names + [parsed(light).get("name", "") for light in lights]

    # --- poses --------------------------------------------------------------------------------

    def _commands(self) -> Iterator[tuple[str, tuple[tuple[str, float], ...]]]:
        """Yield each keyframe's commands in the whole, without joints that the recipe moves."""
        joint_of = {a.name: a.joint for a in self.source_control.control.actuators if a.name}
        commands = dict(self.source_control.ctrl)
        for key in self.part.keys:
            stated = commands.get(key.source, ())
            kept = [(self.prefix + d, v) for d, v in stated if joint_of.get(d) not in key.moved]
            yield key.name, tuple(kept)

    def left_out(self, base: SourceControl | None) -> tuple[str, ...]:
        """Return the part's options that are neither the base's nor MuJoCo's defaults."""
        timestep = base.control.simulation.timestep if base else TIMESTEP_S
        options, bases = _options(self.source_control), _options(base)
        names = []
        if self.source_control.control.simulation.timestep not in (timestep, TIMESTEP_S):
            names.append("option timestep")
        for key, value in options.items():
            if value not in (bases.get(key), _LIKE_MUJOCO.get(key)):
                names.append(f"option {key}")
        return tuple(names)


def under(prefix: str, thing: Named, *keys: str) -> Named:
    """The same thing with a prefix on the names at some of its keys, where it has them."""
    names = {key: prefix + name for key in keys if (name := getattr(thing, key))}
    if isinstance(thing, BaseModel):
        return thing.model_copy(update=names)
    return replace(thing, **names)


def joined(base: SourceControl | None, parts: Mapping[str, SourceControl]) -> SourceControl:
    """One for the whole: the base's, then each part's, prefixed already; parts: by prefix."""
    first = base or SourceControl()
    controls = [first.control, *(part.control for part in parts.values())]
    ctrl = dict(first.ctrl)
    for part in parts.values():
        for key, values in part.ctrl:
            ctrl[key] = (*ctrl.get(key, ()), *values)
    whole: dict[str, Any] = {  # Any: tuples of what each key holds
        key: tuple(each for control in controls for each in getattr(control, key)) for key in JOINED
    }
    return SourceControl(
        replace(first.control, **whole),
        bodies=(*first.bodies, *(body for part in parts.values() for body in part.bodies)),
        ctrl=tuple((key, values) for key, values in ctrl.items() if values),
        surfaces=tuple((prefix, part.control.contact) for prefix, part in parts.items()),
        neighbours=(*first.neighbours, *(n for part in parts.values() for n in part.neighbours)),
    )


def names_of(source_control: SourceControl) -> Iterator[tuple[str, str]]:
    """(kind, name) of all that has a name of its own beside links, joints and shapes."""
    for actuator in source_control.control.actuators:
        if actuator.model != "passive" and actuator.name:
            yield "actuator", actuator.name
    yield from (("sensor", sensor.name) for sensor in source_control.control.sensors)
    yield from (("camera", camera.name) for camera in source_control.control.cameras)
    yield from (("equality", loop.name) for loop in source_control.control.loops)
    for item in source_control.control.mjcf_only:
        element = parsed(item)
        named = item.place in ("actuator", "sensor", "tendon", "equality") and element.get("name")
        if named and not item.owner:  # else it is the drive of its joint
            yield item.place, element.get("name", "")


def _options(source_control: SourceControl | None) -> Mapping[str, str]:
    """Attributes of `<option>` and its flags."""
    options: dict[str, str] = {}
    for item in source_control.control.mjcf_only if source_control else ():
        if item.place == "option":
            element = parsed(item)
            options |= element.attrib
            for flag in element:
                options |= {f"flag {key}": value for key, value in flag.attrib.items()}
    return options
