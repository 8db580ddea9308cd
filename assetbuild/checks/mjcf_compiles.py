"""Does MuJoCo compile every MJCF file, without a word, and does the file make sense?

The lints need the compiled model too, so they run here: compiling is what costs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterator
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING, Any

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.facts.mjcf_grammar import OLDEST, newer_words
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import load
from assetbuild.simulators.mujoco.drives import read_drives

if TYPE_CHECKING:
    from lxml.etree import _Element

LOAD = Rule(
    "mjcf.load", "error", "MuJoCo refuses the file", "its message names the element or the file"
)
WARNING = Rule(
    "mjcf.warning", "warning", "MuJoCo warned while it compiled the file", "read the warning"
)


SIZES = {"bodies": "nbody", "nq": "nq", "nv": "nv", "nu": "nu", "keyframes": "nkey",
         "geoms": "ngeom", "sites": "nsite", "excludes": "nexclude"}  # fmt: skip
"""Figure -> its name in MuJoCo's model."""


class MjcfCompiles(mujoco.WithMujoco):
    """Loads each file at the top of `mjcf/`; figures: the sizes of the compiled models."""

    usual_s = 0.6
    needs = ("mjcf",)
    reads = ()

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `mjcf/*.xml` with their assets."""
        figures: dict[str, dict[str, int]] = {}
        for path in sorted((files.inputs / "mjcf").glob("*.xml")):
            # The reader of facts compiles the robot's meshes; the floor and sky nobody else.
            is_scene = path.name == "scene.xml"
            hint = "an error in the source often shows here first: see the lints"
            model = yield from _loaded(path, hint, is_scene, without_visual_meshes)
            if model is None:
                continue
            figures[path.name] = {word: int(getattr(model, n)) for word, n in SIZES.items()}
            figures[path.name]["bodies"] -= 1  # the world
            if not is_scene:  # it includes the robot: nothing twice
                yield from lint_text(path)
                yield from lint_model(model)
        write_figures(files, figures)


def without_visual_meshes(spec: Any) -> None:  # Any: MuJoCo's MjSpec
    """Leave out the meshes of visual shapes. The file must state every mass."""
    mujoco.leave_out_meshes(spec, lambda geom: not geom.contype and not geom.conaffinity)


def lint_file(path: Path) -> Iterator[Finding]:
    """Everything that can be said about one MJCF file, foreign or our own."""
    text = path.read_text(encoding="utf-8", errors="replace")
    folders = {"", *re.findall(r'(?:mesh|texture|asset)dir="([^"]+)"', text)}
    for name in dict.fromkeys(re.findall(r'file\w*="([^"]+)"', text)):
        for place in (path.parent / folder / name for folder in folders):
            # A pipe or a device, whose content may never end.
            if place.exists() and not place.is_file() and not place.is_dir():
                yield LOAD(
                    "robot", f"`{name}`, which {path.name} names, is no file that can be read"
                )
                return
    model = yield from _loaded(path)
    if model is not None:
        yield from lint_text(path)
        yield from lint_model(model)


def _loaded(
    path: Path, hint: str = "", visuals: bool = True, change: Callable[[Any], None] | None = None
) -> Generator[Finding, None, mujoco.Model | None]:  # Any: as above
    """The model, None where MuJoCo refuses it; one finding for each warning of the compiler."""
    try:
        loaded = load(path, visuals=visuals, change=change)
    except StepError as error:
        yield LOAD("robot", f"MuJoCo refuses {path.name}: {error.message}", hint)
        return None
    for warning in dict.fromkeys(loaded.warnings):
        yield WARNING("robot", f"MuJoCo on {path.name}: {warning}")
    return loaded.model


# --- what the text says that no compiled model shows any more ------------------------------------


PATHS = frozenset({"file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback",
                   "meshdir", "texturedir", "assetdir"})  # fmt: skip
RANGES = frozenset({"ctrlrange", "forcerange", "actrange", "range", "actuatorfrcrange"})

GRAMMAR = Rule(
    "lint.grammar",
    "warning",
    "a word that MuJoCo 3.11 (mjlab) does not know",
    "use the older spelling",
)
MALFORMED = Rule(
    "lint.malformed",
    "warning",
    "no well-formed XML: MuJoCo reads it, and other readers refuse it",
    "remove what follows the last element, and characters that are none",
)
ABSOLUTE_PATH = Rule(
    "lint.absolute_path",
    "warning",
    "a path that exists on one machine only",
    "give the path from the file's own folder",
)
RANGE = Rule(
    "lint.range", "error", "the lower end of a range is not below the upper one", "swap them"
)
FOREIGN_CLASS = Rule(
    "lint.class",
    "warning",
    "a drive has the class of another joint, whose range differs",
    "use the joint's own class",
)


def lint_text(path: Path) -> Iterator[Finding]:
    """All that the text alone can show. path: of a file that MuJoCo compiles."""
    from lxml import etree

    try:
        roots = list(_with_includes(path))
    except etree.XMLSyntaxError as error:
        yield MALFORMED("robot", f"MuJoCo reads it, but it is not well-formed XML: {error}")
        return
    for root in roots:
        for element in root.iter("*"):
            yield from _element(element)
    yield from _classes(roots, mujoco.mj.MjSpec.from_file(str(path)))


def _with_includes(path: Path) -> Iterator[_Element]:
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
    root = etree.fromstring(path.read_bytes(), parser)
    yield root
    for include in root.iter("include"):
        inner = path.parent / str(include.get("file"))
        if inner.is_file():
            yield from _with_includes(inner)


def _element(element: _Element) -> Iterator[Finding]:
    attributes = {str(name): str(value) for name, value in element.attrib.items()}
    where = f"line {element.sourceline}: <{element.tag}>"
    for word in newer_words(str(element.tag), attributes):
        yield GRAMMAR(
            where,
            f"MuJoCo {OLDEST} does not know `{word}`, so the file does not load there",
            hint=f"mjlab pins {OLDEST}: say it in older words, or leave it out",
        )
    for name, value in attributes.items():
        if name in PATHS and (PurePosixPath(value).is_absolute() or PureWindowsPath(value).drive):
            yield ABSOLUTE_PATH(
                where,
                f"`{value}` exists on one machine only",
            )
        numbers = [float(word) for word in value.split()] if name in RANGES else []
        if len(numbers) == 2 and numbers[0] >= numbers[1] and any(numbers):
            low, high = numbers
            yield RANGE(
                where,
                f"{name} {low:g} to {high:g}: the low end is not below the high",
                data={"low": low, "high": high},
            )


def _classes(roots: list[_Element], spec: Any) -> Iterator[Finding]:  # Any: MjSpec
    """A drive whose class is meant for another joint: the class gives joints another range."""
    nested = (child for root in roots for child in root.iterfind(".//default/default"))
    inside = {d.get("class"): [above.get("class") for above in d.iterancestors()] for d in nested}
    joints = {joint.name: joint for joint in spec.joints}
    for drive in spec.actuators:
        joint = joints.get(drive.target)
        if joint is None or not joint.classname or not drive.classname:
            continue
        mine, theirs = drive.classname.name, joint.classname.name
        of_drive, of_joint = (tuple(x.classname.joint.range) for x in (drive, joint))
        related = theirs in inside.get(mine, ()) or mine in inside.get(theirs, ())
        stated = tuple(joint.range) != of_joint
        if not (related or stated or of_drive == of_joint) and any(of_drive) and any(of_joint):
            yield FOREIGN_CLASS(
                f"actuator {drive.name or drive.target}",
                f"class `{mine}` is for joints of range {_ends_text(of_drive)}, but joint "
                f"`{joint.name}` has class `{theirs}` with {_ends_text(of_joint)}",
                hint=f'class="{theirs}" is probably meant',
            )


def _ends_text(ends: tuple[float, ...]) -> str:
    return " ".join(f"{end:g}" for end in ends)


# --- what a compiled model shows -----------------------------------------------------------------


RANGE_TOLERANCE = 1e-6
"""rad or m; a number that was rounded from the limit itself is inside."""
TARGET_TOLERANCE = 1e-3

KEY_POSITION = Rule(
    "lint.key_position",
    "warning",
    "a keyframe puts a joint outside its range",
    "choose a value inside",
)
KEY_CTRL = Rule(
    "lint.key_ctrl",
    "warning",
    "a keyframe's command is outside the drive's range",
    "choose a value inside",
)
KEY_TARGET = Rule(
    "lint.key_target",
    "warning",
    "a position drive pulls away from the pose of the keyframe",
    "give the keyframe a `ctrl` that equals its positions",
)


def lint_model(model: mujoco.Model) -> Iterator[Finding]:
    """All that the compiled model shows without a step of simulation."""
    servos = [drive for drive in read_drives(model) if drive.kind == "servo"]
    for key in range(model.nkey):
        name = mujoco.name_of(model, "key", key)
        qpos, ctrl = model.key_qpos[key], model.key_ctrl[key]
        for joint in range(model.njnt):
            if model.jnt_limited[joint] and model.jnt_type[joint] >= 2:
                subject = f"joint {mujoco.name_of(model, 'joint', joint)}"
                value, ends = qpos[model.jnt_qposadr[joint]], model.jnt_range[joint]
                yield from _outside(KEY_POSITION, subject, name, value, ends)
        for drive in mujoco.actuators(model):
            if model.actuator_ctrllimited[drive]:
                value = ctrl[mujoco.first_command(model, drive)]
                subject = f"actuator {mujoco.name_of(model, 'actuator', drive)}"
                yield from _outside(KEY_CTRL, subject, name, value, model.actuator_ctrlrange[drive])
        for servo in servos:
            at = float(qpos[model.jnt_qposadr[servo.joint]])
            target = servo.target(float(ctrl[servo.ctrl_index]))
            if abs(at - target) > TARGET_TOLERANCE:
                yield KEY_TARGET(
                    f"actuator {mujoco.name_of(model, 'actuator', servo.index)}",
                    f"keyframe `{name}`: its target is {target:g}, the joint stands at {at:g}",
                    data={"keyframe": name, "target": target, "position": at},
                )


def _outside(rule: Rule, subject: str, key: str, value: float, ends: Array) -> Iterator[Finding]:
    low, high = map(float, ends)
    if not low - RANGE_TOLERANCE <= value <= high + RANGE_TOLERANCE:
        yield rule(
            subject,
            f"keyframe `{key}`: {value:g} is outside {low:g}..{high:g}",
            data={"keyframe": key, "value": float(value), "lower": low, "upper": high},
        )
