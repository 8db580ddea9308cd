"""What `diff` compares: a bundle, file by file, or one model in any format, as tables of facts."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from assetbuild.engine.digest import digest_file
from assetbuild.engine.scratch import scratch
from assetbuild.errors import AssetBuildError, UsageError
from assetbuild.facts.compare import EXACT, FLOAT32, Precision
from assetbuild.facts.plain_yaml import leaves
from assetbuild.facts.reader import BROKEN, Reader
from assetbuild.facts.readings import readings_table
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key, Table, Value
from assetbuild.plugins import load_plugin, usable_plugins
from assetbuild.report.bundle import files_of, read_json
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.tree import merge_fixed_joints
from assetbuild.simulators.readings import FALL, HEIGHT, fall_m
from assetbuild.source.urdf.read_urdf import without_meshes

ROBOT = "robot"
"""The form of a bundle's own robot: `report/robot.json`."""
DERIVED = ("manifest.json", "provenance.json")
"""They follow from the other files."""


@dataclass(frozen=True)
class Form:
    """One format that says what the robot is. read: its table; holds: whether it can say a key.

    covers: the files of a bundle behind it.
    """

    read: Callable[[], Table]
    precision: Precision = field(default_factory=Precision)
    holds: Callable[[Key], bool] = lambda _: True
    covers: tuple[str, ...] = ()


@dataclass(frozen=True)
class Side:
    """A robot to compare, as one or several files say it.

    forms: by name. findings: (rule, subject) -> severity; figures: of checks, by dotted path;
    digests: of all files of a bundle, by path.
    """

    name: str
    forms: Mapping[str, Form]
    folder: Path | None = None
    digests: Mapping[str, str] = field(default_factory=dict)
    ready: bool | None = None
    findings: Mapping[tuple[str, str], str] = field(default_factory=dict)
    figures: Mapping[str, float] = field(default_factory=dict)


def bundle_side(bundle: Path, name: str = "") -> Side:
    """A folder that `build` wrote, as its files lie there; UsageError when it is none."""
    reference = Reference.of_bundle(bundle)
    report = read_json(bundle, "report/report.json")
    robot = str(read_json(bundle, "manifest.json").get("robot", bundle.name))
    digests = {name: digest_file(p) for name, p in sorted(files_of(bundle)) if p.is_file()}
    whole = functools.partial(_whole_robot, reference, report)
    forms = {ROBOT: Form(whole, covers=("report/robot.json",))}
    for form, reader, file in bundle_readers(bundle, robot, reference):
        read = functools.partial(_read, reader, file, bundle)
        covers = tuple(path for path in digests if reader.covers(path, robot))
        forms[form] = Form(read, Precision(EXACT), reader.holds, covers)
    try:
        severities = {(f["rule"], f["subject"]): f["severity"] for f in report["findings"]}
        ready = bool(report["verdict"]["ready"])
        held = leaves({name: check.get("figures") for name, check in report["checks"].items()})
        figures = {p: v for p, v in held if isinstance(v, float) and math.isfinite(v)}
    except (KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"`{bundle}` has no readable report: {error}") from None
    return Side(name or str(bundle), forms, bundle, digests, ready, severities, figures)


def bundle_readers(
    bundle: Path, robot: str, reference: Reference
) -> Iterator[tuple[str, Reader, Path]]:
    """(form, reader, main file) of every format that lies in a bundle.

    UsageError for a pipe or device in it: what others' libraries include is out of our hands.
    """
    for name, path in files_of(bundle):
        if path.exists() and not (path.is_file() or path.is_dir()):
            message = f"`{bundle / name}` is not a regular file"
            raise UsageError(message, hint="remove it, or build the bundle again")
    for _, kind in usable_plugins(Reader):
        reader = kind(robot=robot, options={k: reference.options[k] for k in kind.recipe_sections
                                            if k in reference.options})  # fmt: skip
        file = reader.file(bundle / kind.folder, robot)
        if file is not None and file.is_file():
            yield kind.format_id, reader, file


def stages_of(folder: Path, path: str) -> tuple[Path, ...]:
    """The stages of USD that the file at `path` in a bundle may be a layer of."""
    return tuple(sorted((folder / path.partition("/")[0]).glob("*.usd*")))


def _whole_robot(reference: Reference, report: Mapping[str, Any]) -> Table:  # Any: JSON
    """Add what the links were before merging, and the sections that say how files are written."""
    merged, links = robot_table(reference), robot_table(reference, merged=False)
    facts: dict[Key, Value] = {
        Key("link" if key.kind == "body" else f"link's {key.kind}", key.name, key.quantity): value
        for key, value in links.facts.items()
        if key.kind in ("body", "joint")
    }
    for path, value in leaves(dict(reference.options)):
        facts[Key("recipe", "", f"recipe:{path}")] = value
    return Table({**merged.facts, **facts, **_motion(report, reference)})


def _read(reader: Reader, file: Path, bundle: Path) -> Table:
    try:
        return reader.read(file)
    except (AssetBuildError, *BROKEN) as error:  # a file may hold anything
        why, hint = f"{type(error).__name__}: {error}", ""
        if isinstance(error, AssetBuildError):
            why, hint = error.message, error.hint
        raise UsageError(f"{file.relative_to(bundle)}: {why}", hint=hint) from None


# --- models that nobody here wrote ----------------------------------------------------------


def foreign_side(path: Path) -> Side:
    """One model by the ending of its file; AssetBuildError for what cannot be read."""
    suffix = path.suffix.lower()
    try:
        text = path.read_bytes() if suffix in (".json", ".xml", ".urdf", ".mjcf") else b""
    except OSError as error:
        raise UsageError(f"cannot read `{path}`: {error.strerror}") from None
    if suffix == ".json":
        try:  # what Isaac Lab measured by a bundle's `<robot>_isaaclab_measure.py`
            measured, simulator = readings_table(json.loads(text))
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            raise UsageError(f"`{path}` holds no readings: {error}") from None
        facts = {(key.kind, key.quantity) for key in measured.facts}  # it measures some facts only
        return _model(
            f"{path} ({simulator})",
            "readings",
            measured,
            precision=Precision(FLOAT32),
            holds=lambda key: (key.kind, key.quantity) in facts,
        )
    if b"<robot" in text:
        return _model(str(path), "merged urdf", _merged_urdf(path), holds=_in_urdf)
    for _, kind in usable_plugins(Reader):
        if suffix in kind.suffixes and suffix != ".urdf" and (not text or b"<mujoco" in text):
            table = kind(robot=path.stem).read(path)
            # What others write is rounded to float32 at some place.
            how = {"precision": kind.precision.at_least(1e-6), "holds": _says(kind, table)}
            return _model(str(path), kind.format_id, table, **how)
    raise UsageError(
        f"`{path}` is no model that can be compared",
        hint="give a bundle, a recipe, an MJCF, URDF or USD file, or an Isaac Lab configuration",
    )


def _says(kind: type[Reader], table: Table) -> Callable[[Key], bool]:
    """What other formats may be compared with: a group of MuJoCo is a role to Menagerie alone."""

    def says(key: Key) -> bool:
        is_group = key.quantity == "role" and str(table.facts.get(key)).startswith("group ")
        return kind.holds(key) and not is_group

    return says


def _model(name: str, form: str, table: Table, **how: Any) -> Side:  # Any: of Form
    return Side(name, {form: Form(lambda: table, **how)})


def _in_urdf(key: Key) -> bool:
    """What a URDF says and shows alone: its meshes are files of their own."""
    return key.kind != "shape" and load_plugin(Reader, "urdf").holds(key)


def _merged_urdf(path: Path) -> Table:
    """Read it as a build would: fixed joints merged, no recipe, so no drives."""
    with scratch() as ports:
        ports.put("robot.urdf", data := path.read_bytes())
        ports.run(without_meshes(path, data, "floating"))
        links = RobotFiles(ports.folder).links
    if links.root == "world":  # what is fixed to the world is merged into it
        links = replace(links, base="fixed")
    tree = merge_fixed_joints(links, True, ())[0]
    return robot_table(Reference(links, tree))


def config_side(path: Path, name: str, known: Side | None) -> Side:
    """An Isaac Lab configuration in a Python file; its patterns mean the joints of `known`."""
    from assetbuild.facts.readers.isaaclab import read_config

    tables = (form.read() for form in (known.forms.values() if known else ()))
    joints = next((table.names("joint") for table in tables), ())
    table = read_config(path, name, joints)
    return _model(str(path), "configuration", table, precision=Precision(FLOAT32))


def _motion(report: Mapping[str, Any], reference: Reference) -> dict[Key, Value]:  # Any: JSON
    """What is asked of a simulator too: a fall by formula, the height of the check `stand`."""
    if reference.tree.base != "floating":
        return {}
    simulation = reference.control.simulation
    pull = math.dist(simulation.gravity, (0.0, 0.0, 0.0))
    facts: dict[Key, Value] = {Key("robot", "", FALL): fall_m(pull, simulation.timestep)}
    height = report.get("checks", {}).get("stand", {}).get("figures", {}).get("height_m")
    if isinstance(height, float):
        facts[Key("robot", "", HEIGHT)] = height
    return facts
