"""What mjlab 1.6 trains with: a bare MJCF and a module that puts the actuator table on it.

mjlab's contract: no actuators, options or keyframes in the MJCF (its configs bring them), collision
geoms named `*_collision\\d*`, a site at the IMU and at each foot, the sensors of its velocity task,
and a root that rests above the ground.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import ClassVar
from xml.etree.ElementTree import Element

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.grouping import grouped
from assetbuild.plugin_types import Target
from assetbuild.robot.actuator_table import without_stall
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.initial import initial_pose
from assetbuild.robot.model import Actuator, Control, Place, Sensor, Tree
from assetbuild.robot.ranges import Randomize
from assetbuild.robot.sections import IMU_NAMES, ImuKind
from assetbuild.robot.shapes import Shape, Shapes
from assetbuild.robot.tree import forward_kinematics
from assetbuild.targets.mjcf.files import readable, refuse_name, robot_element, write_robot
from assetbuild.targets.mjcf.robot_xml import RobotXml
from assetbuild.targets.mjlab.events import lost
from assetbuild.targets.mjlab.module import Foot, MjlabOptions, ModuleFacts, module_text
from assetbuild.xml_text import free_name

TASK_SENSORS: tuple[ImuKind, ...] = ("gyro", "velocimeter", "accelerometer", "framezaxis")
"""Sensors that mjlab's tasks look for, at the IMU."""
NOT_BARE = ("actuator", "option", "size", "keyframe")
"""Sections of the source's own MJCF that mjlab's configs bring."""

NO_IMU = Rule(
    "mjlab.imu",
    "info",
    "the recipe names no IMU, so mjlab's sensors are at the root",
    "`imu: {link: ...}`",
)
NO_FEET = Rule(
    "mjlab.feet",
    "info",
    "the recipe names no feet, so there is no velocity task",
    "`feet: {links: ...}`",
)
UNSUPPORTED_DRIVES = Rule(
    "mjlab.actuator", "warning", "drives that mjlab has no form of", "another model"
)
SATURATION = Rule(
    "mjlab.saturation",
    "info",
    "a `dc_motor` has no stall torque; its effort limit is used instead",
    "`stall` in the row or the motor",
)
RENAMED = Rule(
    "mjlab.renamed",
    "info",
    "collision geoms of the bare MJCF are called `*_collision`, whatever the source calls them",
    "use the new names in your own configs of mjlab",
)
SENSORS_LEFT_OUT = Rule(
    "mjlab.sensors",
    "info",
    "contact and drive sensors are not in the bare MJCF",
    "read them from the sensors that mjlab makes from its own configuration",
)


class Mjlab(Target):
    """Writes `mjcf/<robot>_bare.xml` with its assets, and `python/<robot>_mjlab.py`."""

    outputs = ("mjlab/",)
    folder = ""
    reads = ("tree.json", "shapes.json", "control.json", "meshes/")

    sections: ClassVar[Mapping[str, str]] = {"mjlab": "options"}
    recipe_fields: ClassVar[Mapping[str, str]] = {
        "feet": "feet.links",
        "imu": "imu.link",
        "randomize": "randomize",
    }
    derived: ClassVar = {
        "rows": lambda recipe: tuple(
            row.joints for row in recipe.value("actuators") if not recipe.value("compose")
        )
    }

    options: MjlabOptions = MjlabOptions()
    """The recipe's `mjlab`."""
    feet: str | None = None
    """Pattern of the source links that the robot stands on."""
    imu: str | None = None
    """The IMU's link; None: the root's own frame."""
    rows: tuple[str, ...] = ()
    """Patterns of the actuator table, to name joints by; none of a composite, which has names."""
    randomize: Randomize | None = None
    """The recipe's ranges, for the module's events."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises StepError for joints that MJCF cannot say."""
        refuse_name(self.robot)
        robot = RobotFiles(files.inputs)
        tree, shapes, control = robot.tree, robot.shapes, robot.control
        meshes = robot.mesh_dir
        shapes = readable(shapes, meshes, control.mjcf_only)

        imu_site, soles = self.imu or tree.root, self._soles(shapes)
        looked_at = (*(sole.link for sole in soles), imu_site)
        sites = [link for link in looked_at if link in tree.by_body]
        bare = self._bare(tree, control, imu_site)
        model = RobotXml(self.robot, None, tree, shapes, bare, sites=sites)
        folder = files.outputs / "mjlab"
        opaque = tuple(o for o in control.mjcf_only if o.place not in NOT_BARE)
        path = folder / "mjcf" / f"{self.robot}_bare.xml"
        root = robot_element(model, opaque, bare=True)
        renamed = name_collisions(root, {shape.name for shape in shapes.of("visual")})
        write_robot(path, root, shapes, meshes)
        feet = sorted(
            _feet(tree, soles, control, renamed), key=lambda foot: model.order.index(foot.body)
        )
        facts = ModuleFacts(
            robot=self.robot,
            tree=tree,
            control=control,
            rows=self.rows,
            feet=tuple(feet),
            imu_site=imu_site,
            options=self.options,
            randomize=self.randomize,
        )
        module = folder / "python" / f"{self.robot.replace('-', '_').replace('.', '_')}_mjlab.py"
        module.parent.mkdir(parents=True)
        module.write_text(module_text(facts), encoding="utf-8")
        yield from self._explain(tree, control, facts)
        yield from _renamed(renamed)

    def _soles(self, shapes: Shapes) -> list[Shape]:
        """Collision shapes of the links that the robot stands on."""
        solid = shapes.of("collision")
        return [s for s in solid if self.feet and re.fullmatch(self.feet, s.link)]

    def _bare(self, tree: Tree, control: Control, imu_site: str) -> Control:
        """Leave out drives; what the module states for driven joints is not in the XML too."""
        drives = tuple(
            a if a.model == "passive" else Actuator(a.joint, "passive") for a in control.actuators
        )
        # Sensors of the robot win over those of their names that mjlab's velocity task wants.
        at = Place("frame", imu_site)
        wanted = [Sensor(IMU_NAMES[kind], kind, at) for kind in TASK_SENSORS]
        wanted.append(Sensor("root_angmom", "subtreeangmom", Place("body", tree.root)))
        sensors = {sensor.name: sensor for sensor in control.sensors if not _of_mjlab(sensor)}
        for sensor in wanted if tree.base == "floating" else ():
            sensors.setdefault(sensor.name, sensor)
        return replace(control, actuators=drives, sensors=tuple(sensors.values()))

    def _explain(self, tree: Tree, control: Control, facts: ModuleFacts) -> Iterator[Finding]:
        if tree.base == "floating" and self.imu is None:
            yield NO_IMU(
                "robot",
                f"the recipe names no IMU: its sensors sit in the frame of `{tree.root}`",
                hint="add `imu: {link: ...}`",
            )
        if tree.base == "floating" and not facts.feet:
            yield NO_FEET(
                "robot",
                "the recipe names no feet: the module has no velocity task",
                hint="add `feet: {links: ...}`",
            )
        undriven = [a.joint for a in control.actuators if a.model == "general"]
        if undriven:
            yield UNSUPPORTED_DRIVES(
                "robot",
                "mjlab has no form of the model `general`: "
                f"{len(undriven)} joints have no drive there",
                hint="use pd, ideal_pd, dc_motor, velocity or motor",
                data={"joints": tuple(undriven)},
            )
        yield from without_stall(SATURATION, control.actuators)
        if self.randomize is not None:
            yield from lost(self.randomize, tree, facts.groups)
        gone = [s.name for s in control.sensors if _of_mjlab(s)]
        if gone:
            yield SENSORS_LEFT_OUT(
                "robot",
                f"{len(gone)} contact and drive sensors are not in the bare MJCF: mjlab makes its "
                "own",
                data={"sensors": tuple(gone)},
            )


def _feet(
    tree: Tree, soles: list[Shape], control: Control, renamed: Mapping[str, str]
) -> Iterator[Foot]:
    """A foot for each body that has soles, however many; its site is at the lowest link of them.

    renamed: geoms of the bare MJCF by the names of their shapes, where they differ.
    """
    start = initial_pose(tree, control)
    X_root_body = forward_kinematics(tree, dict(start.joints))

    def height(sole: Shape) -> float:
        body, X_body_link = tree.placement(sole.link)
        X_world_link = tree.root_pose(start) @ X_root_body[body] @ X_body_link
        return X_world_link.xyz[2]

    for body, foot_soles in grouped(soles, lambda sole: tree.placement(sole.link)[0]).items():
        geoms = tuple(renamed.get(sole.name, sole.name) for sole in foot_soles)
        yield Foot(body, min(foot_soles, key=height).link, geoms)


def _renamed(renamed: Mapping[str, str]) -> Iterator[Finding]:
    if renamed:
        name, new = next(iter(renamed.items()))
        yield RENAMED(
            "robot",
            f"{len(renamed)} collision geoms have other names in the bare MJCF, where mjlab's "
            f"configs look for `*_collision`: `{name}` is `{new}`",
            data={"geoms": tuple(renamed), "names": tuple(renamed.values())},
        )


def _of_mjlab(sensor: Sensor) -> bool:
    """Contacts and drives exist only once mjlab has put the robot together."""
    return sensor.kind == "contact" or sensor.at.kind in ("actuator", "tendon")


# --- names of collision geoms --------------------------------------------------------------------


COLLISION = re.compile(r".*_collision\d*")
REFERENCES = ("geom", "geom1", "geom2")
"""Attributes that name a geom, of pairs, sensors and the wraps of tendons."""
TYPED_REFERENCES = {"objname": "objtype", "refname": "reftype"}
"""Attributes that name whatever another attribute says: sensors, tuples."""


def name_collisions(root: Element, visuals: Collection[str]) -> dict[str, str]:
    """Rename collision geoms of an MJCF that no config would find, wherever they are named.

    visuals: names of the geoms that touch nothing. Returns new names by old ones.
    """
    geoms = [geom for world in root.iter("worldbody") for geom in world.iter("geom")]
    taken = {geom.get("name", "") for geom in geoms}
    renamed: dict[str, str] = {}
    for geom in geoms:
        name = geom.get("name", "")
        if name in visuals or COLLISION.fullmatch(name) or _touches_nothing(geom):
            continue
        new = free_name(f"{name or 'geom'}_collision", taken)
        geom.set("name", new)
        if name:
            renamed[name] = new
    for node, key in _references(root):
        if (old := node.get(key, "")) in renamed:
            node.set(key, renamed[old])
    return renamed


def _touches_nothing(geom: Element) -> bool:
    """Whether a geom's own masks say so; a class of ours says it for visuals alone."""
    masks = [geom.get(key, "1").strip().lstrip("+") for key in ("contype", "conaffinity")]
    return masks == ["0", "0"]


def _references(root: Element) -> Iterator[tuple[Element, str]]:
    """(element, attribute) of all that may name a geom."""
    for node in root.iter():
        for key in REFERENCES:
            if key in node.attrib:
                yield node, key
        for key, kind in TYPED_REFERENCES.items():
            if node.get(kind) == "geom" and key in node.attrib:
                yield node, key
