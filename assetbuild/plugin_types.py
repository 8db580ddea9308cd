"""The kinds of plug-ins and their fixed ports. A plug-in is one file: its name is the file's.

Every target and check finds the robot under the same input names; `RobotFiles` reads them:

    links.json     Tree before merging fixed joints (after the recipe's edits): the source's links
    tree.json      Tree after merging: the bodies that will be simulated
    shapes.json    Shapes; mesh geometry names an asset
    control.json   Control
    ratings.json   Control with nothing but effort, velocity, damping and friction of the joints;
                   so that a new gain leaves its readers alone; only where `reads` names it
    meshes/        the assets, `<name>.obj`
    assets.json    Assets: what these files hold, measured; only where `reads` names it
    triangles.npz  these meshes in one file, quicker to read; only where `reads` names it
    hulls.npz      their convex hulls, likewise

A check finds each target that it `needs` as a folder of that name (`mjcf/`, `usd/`), and the
untouched description (but for comments) as `source.urdf` when `needs` says "source"; an MJCF as
`source.xml` with its meshes below `files/` when it says "source_mjcf".
"""

from __future__ import annotations

import contextlib
import json
import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, get_args

from pydantic import ConfigDict, Field
from pydantic.fields import FieldInfo

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding, rounded
from assetbuild.recipe_types import Pattern
from assetbuild.robot.actuator_table import Key
from assetbuild.robot.codec import encode
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Body, Inertial, Joint, Tree
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.robot.shapes import Box, Capsule, Cylinder, Mesh, SourceShape, SourceShapes, Sphere

if TYPE_CHECKING:
    from assetbuild.engine.world import World

ROBOT_PORTS = ("links.json", "tree.json", "shapes.json", "control.json", "meshes/")


@dataclass(frozen=True)
class Piece:
    """One collision piece. A `Mesh` geometry is a convex hull of `pieces.npz`."""

    geometry: Box | Sphere | Cylinder | Capsule | Mesh
    X_frame_piece: Pose = IDENTITY


@dataclass(frozen=True)
class Pieces:
    """`pieces.json` beside `pieces.npz`: what a collision method writes."""

    pieces: tuple[Piece, ...]


class Edit(Step):
    """A named change of the robot between reading and merging: its fields are the recipe's keys.

    `links.json`, `shapes.json` -> the same two. A field called `link` or `joint` is a pattern
    that must match whole names, of at least one link or joint as the edits before left them.
    Each change leaves a finding `edit.<name>` with before and after.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)
    group: ClassVar[str] = "edits"
    outputs = ("links.json", "shapes.json")
    follows_names: ClassVar[bool] = True
    """Whether what an MJCF says of its joints and links by name still holds afterwards."""

    def edit(self, tree: Tree, shapes: SourceShapes, files: Files) -> Edited:
        """The changed robot and what to say about it; RecipeError for what cannot be done."""
        raise NotImplementedError

    def meshes(self, shapes: SourceShapes) -> tuple[SourceShape, ...]:
        """Shapes whose meshes it reads; the first is `mesh/0/parts/` and `mesh/0/mesh.json`."""
        return ()

    def patterns(self) -> tuple[tuple[tuple[str, ...], str, str], ...]:
        """(key below the edit, "link" or "joint", pattern) of all that must match something."""
        return tuple(
            ((kind,), kind, str(getattr(self, kind)))
            for kind in ("link", "joint")
            if kind in type(self).model_fields
        )

    def run(self, files: Files) -> Iterable[Finding]:
        """Reads and writes `links.json` and `shapes.json`."""
        robot = RobotFiles(files.inputs)
        done = self.edit(robot.links, robot.source_shapes, files)
        (files.outputs / "links.json").write_bytes(encode(done.tree))
        (files.outputs / "shapes.json").write_bytes(encode(done.shapes))
        return done.findings


class LinkEdit(Edit):
    """An edit of the mass properties of links, one by one."""

    link: Pattern = Field(description="links, by whole name")

    def change(self, body: Body) -> tuple[Inertial, Finding] | None:
        """The new mass properties of a link that matches, and what to say; None = it stays."""
        raise NotImplementedError

    def edit(self, tree: Tree, shapes: SourceShapes, files: Files) -> Edited:
        """See `Edit`."""
        tree, findings = edit_inertials(tree, self.link, self.change)
        return Edited(tree, shapes, findings)


class MassEdit(LinkEdit):
    """An edit that can give links a mass."""

    guessed: bool = Field(
        False,
        description="true: nobody measured the mass; a robot all of whose masses are guesses is "
        "not ready",
    )


class JointEdit(Edit):
    """An edit of joints, one by one."""

    joint: Pattern = Field(description="joints, by whole name")

    def change(self, joint: Joint) -> tuple[Joint, Finding]:
        """What becomes of a joint that matches, and what to say."""
        raise NotImplementedError

    def edit(self, tree: Tree, shapes: SourceShapes, files: Files) -> Edited:
        """See `Edit`."""
        joints, findings = [], []
        for joint in tree.joints:
            if re.fullmatch(self.joint, joint.name):
                joint, finding = self.change(joint)
                findings.append(finding)
            joints.append(joint)
        return Edited(replace(tree, joints=tuple(joints)), shapes, tuple(findings))


@dataclass(frozen=True)
class Edited:
    """What an edit made."""

    tree: Tree
    shapes: SourceShapes
    findings: tuple[Finding, ...]


def edit_inertials(
    tree: Tree, pattern: str, change: Callable[[Body], tuple[Inertial, Finding] | None]
) -> tuple[Tree, tuple[Finding, ...]]:
    """The tree with new mass properties of the links that match; None = this one stays."""
    matched = {b.name: change(b) for b in tree.bodies if re.fullmatch(pattern, b.name)}
    changed = {name: change for name, change in matched.items() if change is not None}
    inertials = {name: inertial for name, (inertial, _) in changed.items()}
    return tree.with_inertials(inertials), tuple(finding for _, finding in changed.values())


class RecipeView(Protocol):
    """What a plug-in may ask a recipe; paths are as people write them: `validate.free_fall`."""

    def value(self, path: str) -> Any:  # Any: of the key's own type
        """The value at a path, None below a section that is null. KeyError: no such key."""
        ...

    def states(self, key: str) -> bool:
        """Whether the recipe itself states a key at its top, rather than leaving its default."""
        ...

    def stated(self, path: str) -> frozenset[str]:
        """The keys of a section that the recipe itself states."""
        ...


OLD_NAMES: Mapping[str, str] = {
    "wanted": "enabled_by_default",
    "told": "recipe_fields",
    "behind": "file_globs",
    "called": "display_name",
    "form": "format_id",
    "asks": "recipe_sections",
}
"""Class constants of plug-ins as version 0.1 called them."""


class Plugin(Step):
    """A target or check: what its fields say, a recipe may say.

    Fields with a description are the keys of the map at `section`; `sections` are maps that one
    field holds as a whole; `recipe_fields` fields come from keys that others declare.
    """

    section: ClassVar[str] = ""
    """Where the keys stand that its described fields are, such as `validate.stand`."""
    about: ClassVar[str] = ""
    """What that section asks for, for the reference of recipe keys."""
    enabled_by_default: ClassVar[bool] = True
    """Whether the section is on where a recipe does not state it."""
    sections: ClassVar[Mapping[str, str]] = {}
    """Path of a section -> the field whose type is the model of its keys."""
    recipe_fields: ClassVar[Mapping[str, str]] = {}
    """Field -> path of the key that it comes from."""
    derived: ClassVar[Mapping[str, Callable[[RecipeView], object]]] = {}
    """Field -> what follows for it from several keys."""

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """What a plug-in of others states by an old name counts for one version."""
        super().__pydantic_init_subclass__()
        for old, new in OLD_NAMES.items():
            if old in vars(cls):
                message = f"{cls.__name__}.{old} is called `{new}` now"
                warnings.warn(message, FutureWarning, stacklevel=4)
                setattr(cls, new, vars(cls)[old])

    @classmethod
    def keys(cls) -> dict[str, FieldInfo]:
        """The fields that are keys of `section`, by name."""
        return {name: info for name, info in cls.model_fields.items() if info.description}

    @classmethod
    def values(cls, recipe: RecipeView) -> dict[str, Any] | None:  # Any: values of its fields
        """What the recipe says of its fields; None where a section of its own is null.

        A recipe that does not name the plug-in may lack its section: then the defaults hold.
        """
        values: dict[str, Any] = {}  # Any: as above
        robot = {"robot": "robot"} if "robot" in cls.model_fields else {}
        wholes = {field: path for path, field in cls.sections.items()}
        for field, path in {**robot, **cls.recipe_fields, **wholes}.items():
            with contextlib.suppress(KeyError):
                values[field] = recipe.value(path)
        for field in wholes:
            optional = type(None) in get_args(cls.model_fields[field].annotation)
            if values.get(field, 0) is None and not optional:
                return None
        if cls.keys():
            with contextlib.suppress(KeyError):
                section = recipe.value(cls.section)
                if section is None:
                    return None
                values |= {name: getattr(section, name) for name in cls.keys()}  # noqa: SIM118
        return values | {field: follows(recipe) for field, follows in cls.derived.items()}


class Preparation(Step):
    """What a target makes of the robot's ports beforehand: a port of its own, `outputs`.

    It has no fields, and is apart so that what it does not read leaves it alone, as a new gain.
    """

    reads: ClassVar[tuple[str, ...]] = ()
    """The robot ports that it reads."""


class Target(Plugin):
    """Reads the Robot, writes one format below `<name>/`. It may refuse; it may not repair.

    Subclasses set `outputs = ("<name>/",)`; what they write there appears in the bundle as is,
    below `folder`. Two targets may write one file of the bundle when its bytes are the same.
    """

    group: ClassVar[str] = "targets"
    robot: str
    """Name of the robot: the stem of the main file."""
    folder: ClassVar[str | None] = None
    """Folder of the bundle for what it writes; None: its own name, "": the bundle itself."""
    reads: ClassVar[tuple[str, ...]] = ROBOT_PORTS
    """The robot ports that this target really reads; the rest is not linked to it."""
    preparation: ClassVar[type[Preparation] | None] = None
    """What makes further files that it reads."""

    @classmethod
    def configure(cls, recipe: RecipeView) -> Self:
        """The step that a recipe asks for."""
        return cls.model_validate(cls.values(recipe))

    @classmethod
    def place(cls, name: str, path: str) -> str:
        """Path in the bundle of a file that it writes at `path`. name: the plug-in's."""
        folder = name if cls.folder is None else cls.folder
        return f"{folder}/{path}" if folder else path


class Check(Plugin):
    """Reads the Robot and built files, yields findings, writes `figures.json`."""

    group: ClassVar[str] = "checks"
    outputs = ("figures.json",)
    needs: ClassVar[tuple[str, ...]] = ()
    """Names of targets; "source" for the untouched URDF, "source_mjcf" for an MJCF."""
    also: ClassVar[tuple[str, ...]] = ()
    """Targets that it looks at too, where the recipe builds them."""
    reads: ClassVar[tuple[str, ...]] = ROBOT_PORTS
    """The robot ports that this check really reads."""
    drives: ClassVar[bool] = True
    """Whether it asks for what drives the joints; else its MJCF has none, and a new gain leaves it
    alone."""
    requires: ClassVar[Mapping[str, str]] = {}
    """Optional module -> the extra that brings it; without it the check is skipped, and the report
    says so."""
    engines: ClassVar[tuple[str, ...]] = ()
    """Runs only where `validate.simulators` names all of these."""
    listed_in: ClassVar[str] = ""
    """Runs only where this list of the recipe names it: `validate.linters`."""

    @classmethod
    def configure(cls, recipe: RecipeView) -> Self | None:
        """The step that a recipe asks for; None = the recipe does not want this check."""
        if not set(cls.engines) <= set(recipe.value("validate.simulators")):
            return None
        if cls.listed_in and cls.listed_as() not in recipe.value(cls.listed_in):
            return None
        values = cls.values(recipe)
        return None if values is None else cls.model_validate(values)

    @classmethod
    def listed_as(cls) -> str:
        """Its name in `listed_in`."""
        return cls.step_name()

    def own_files(self) -> Mapping[str, tuple[Key, str]]:
        """Files of the user that it reads: input -> (key that names it, path from the recipe)."""
        return {}

    def missing(self, world: World) -> str:
        """What else this machine lacks for it, and how to get it; "" = nothing."""
        return ""


def lacking(requires: Mapping[str, str], world: World) -> str:
    """What is not installed and how to get it; "" = all is there. requires: module -> extra."""
    for module, extra in requires.items():
        if not world.has_module(module):
            return f"needs `{module}`: pip install 'assetbuild[{extra}]'"
    return ""


def write_figures(
    files: Files, figures: Mapping[str, object], limits: Mapping[str, float] | None = None
) -> None:
    """The numbers of one check, for the report, after they were compared; keys sorted.

    limits: name of a figure, at any depth -> what it is compared with: it is rounded to a
    thousandth of that. Others have six digits. So the report is the same on every CPU.
    Raises ValueError for a number that is not finite: what was not measured is None.
    """
    shown = _rounded_figures(figures, limits or {}, None)
    text = json.dumps(shown, sort_keys=True, indent=1, allow_nan=False)
    (files.outputs / "figures.json").write_text(text + "\n", encoding="utf-8")


def _rounded_figures(value: object, limits: Mapping[str, float], limit: float | None) -> object:
    """limit: of the nearest named figure around it; 1e-9 where there is none."""
    if isinstance(value, float):
        return rounded(value, limit) if limit else float(f"{rounded(value, 1e-9):.6g}")
    if isinstance(value, Mapping):
        return {k: _rounded_figures(v, limits, limits.get(k, limit)) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded_figures(each, limits, limit) for each in value]
    return value
