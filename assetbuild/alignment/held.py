"""Rows of what both engines hold: the difference of two tables of facts.

A quantity that one of both cannot hold has no row; what a table lacks that it could hold is one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from assetbuild.alignment.row import NUMBER, Limits, Row
from assetbuild.errors import AssetBuildError
from assetbuild.facts.compare import shown, slug
from assetbuild.facts.mjcf import LACKS
from assetbuild.facts.mjcf_model import read_model
from assetbuild.facts.mjcf_senses import simulation_facts
from assetbuild.facts.reader import Reader
from assetbuild.facts.table import Key, Table, Value, Writer
from assetbuild.facts.vocabulary import VOCABULARY, Comparison
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Pose, normalised_quat, vec3
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.levers import joints_over

PLACE: Limits = (1e-5, 1e-3, "m or 1")
SAME: Limits = (0.0, 0.5, "yes/no")
GAINS = frozenset({"kp", "kd", "effort"})
SCENE = frozenset({"simulation", "floor"})


def held_rows(model: Any, ours: Table, theirs: Table) -> Iterator[Row]:  # Any: mujoco.MjModel
    """Rows of what both hold of the robot.

    ours: MuJoCo's, in what the other engine can hold.
    """
    pulled = _pulled(model)

    def is_alike(key: Key) -> bool:
        if f"{key.kind} {key.quantity}" in LACKS or key.quantity == "physx:drive":
            return False
        return key.name not in pulled or key.quantity not in GAINS

    yield from fact_rows(ours.only(is_alike), theirs)


def _pulled(model: Any) -> set[str]:  # Any: mujoco.MjModel
    """Joints that an actuator drives by a tendon, whose gains are no gains of a joint."""
    import mujoco as engine

    by_tendon = np.asarray(model.actuator_trntype) == int(engine.mjtTrn.mjTRN_TENDON)
    tendons = np.asarray(model.actuator_trnid)[by_tendon, 0]
    joints = {joint for tendon in tendons for joint in joints_over(model, int(tendon))}
    return {mujoco.name_of(model, "joint", joint) for joint in joints}


def mujoco_table(model: Any, tree: Tree) -> Table:  # Any: as above
    """What MuJoCo holds, but for places in the frame of another body than PhysX's.

    MuJoCo has no bodies for massless links between joints.
    """
    book, names = Writer(), {name: body for body, name in mujoco.body_names(tree).items()}
    read_model(model, book)
    table = Table({
        key._replace(name=names.get(key.name, key.name)) if key.kind == "body" else key: value
        for key, value in book.facts.items()
    })  # fmt: skip
    parents = {joint.child: joint.parent for joint in tree.joints}
    carried = {joint.name: joint.child for joint in tree.joints}

    def is_alike(key: Key) -> bool:
        said = table.of(key.kind, key.name)
        if key.kind == "body" and key.quantity == "pose":
            parent = str(said["parent"])
            return names.get(parent, parent) == parents.get(key.name)
        if key.kind == "joint" and key.quantity in ("axis", "anchor"):
            body = str(said["body"])
            return names.get(body, body) == carried.get(key.name)
        return True

    return table.only(is_alike)


def scene_rows(inputs: Path, robot: str, model: Any) -> Iterator[Row]:  # Any: as above
    """Time, gravity and floor of both scenes. model: of `scene.xml`."""
    from assetbuild.facts.readers.scene import SceneFacts
    from assetbuild.facts.readers.usd_scene import UsdSceneReader

    ours = _read(SceneFacts(robot=robot), inputs / "mjcf") | Table(
        {Key("simulation", "", name): value for name, value in simulation_facts(model.opt).items()}
    )
    yield from fact_rows(ours, _read(UsdSceneReader(robot=robot), inputs / "usd"))


def _read(reader: Reader, folder: Path) -> Table:
    """Simulation and floor; empty where the reader refuses the file, which its own check tells."""
    path = reader.file(folder, reader.robot)
    try:
        table = reader.read(path) if path else Table({})
    except AssetBuildError:
        return Table({})
    return table.only(lambda key: key.kind in SCENE and not key.is_foreign)


def fact_rows(ours: Table, theirs: Table) -> Iterator[Row]:
    """A row for each fact that both tables state, and for each subject that one alone has."""
    for key in ours.facts:
        if key in theirs.facts:
            yield _row(key, ours.facts[key], theirs.facts[key])
    for kind, stated in (("body", "mass"), ("joint", "type")):
        here, there = (
            {key.name for key in table.facts if (key.kind, key.quantity) == (kind, stated)}
            for table in (ours, theirs)
        )
        for name in sorted(here ^ there):
            one, two = ("held" if name in some else "missing" for some in (here, there))
            yield Row("missing", "CRITICAL", f"{kind} {name}", one, two, 1.0, *SAME)


def _row(key: Key, ours: Value, theirs: Value) -> Row:
    quantity = VOCABULARY.get((key.kind, key.quantity))
    comparison: Comparison = quantity.comparison if quantity else "vector"
    off, limits = _apart(comparison, ours, theirs)
    unit = quantity.unit if quantity else ""
    one, two = (_cell(value, unit) for value in (ours, theirs))
    name = slug(key.quantity.rpartition(":")[2])
    rank = quantity.rank if quantity else "MEDIUM"
    of = "robot" if key.kind in SCENE else key.subject
    return Row(f"floor_{name}" if key.kind == "floor" else name, rank, of, one, two, off, *limits)


def _cell(value: Value, unit: str) -> float | str:
    if value is None:
        return math.inf  # nothing limits it
    return float(value) if isinstance(value, float) else shown(value, unit)


def _apart(comparison: Comparison, ours: Value, theirs: Value) -> tuple[float, Limits]:
    """How far two values are apart, and what that is judged by."""
    number: Limits = (*NUMBER, "of it")
    if ours == theirs:
        return 0.0, number
    if ours is None or theirs is None:
        return (1.0, number)
    if isinstance(ours, str | bool) or isinstance(theirs, str | bool):
        return 1.0, SAME
    one, two = np.atleast_1d(ours).astype(float), np.atleast_1d(theirs).astype(float)
    if one.shape != two.shape:
        return 1.0, SAME
    if comparison == "pose":
        a, b = (Pose(vec3(v[:3]), normalised_quat(tuple(map(float, v[3:])))) for v in (one, two))  # type: ignore[arg-type] # four numbers
        moved = np.abs(np.subtract(a.xyz, b.xyz)).max()
        return max(float(moved), float(np.abs(a.rotation - b.rotation).max())), PLACE
    apart = float(np.linalg.norm(one - two))
    if comparison == "direction":
        return apart, PLACE
    return apart / max(float(np.linalg.norm(one)), float(np.linalg.norm(two)), 1e-9), number
