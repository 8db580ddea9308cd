"""`python/<robot>_mjlab.py`: what it gives to mjlab 1.6, recorded by stand-ins for mjlab's classes.

mjlab counts in SI, rad, quaternions wxyz, and delays in simulation steps. Passive damping, friction
and armature of driven joints stand here and not in the bare MJCF.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from assetbuild.facts.derived import per_axis
from assetbuild.facts.reader import Reader
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.standins import (
    ARGUMENTS,
    LINE,
    Record,
    class_of,
    recorded,
    table_of,
    words_of,
)
from assetbuild.facts.table import Key, Table, Value, Writer
from assetbuild.facts.trainers import (
    Names,
    Ranges,
    delay_s,
    factors,
    left_to_the_asset,
    massive_bodies,
    matching,
    own_names,
    put_by_joint,
    put_drawn,
    put_expected_start,
    put_start,
    put_terms,
    varied,
)
from assetbuild.robot.pose import Pose

FORM = "mjlab"
CALLS = ("spec", "robot_cfg", "randomize_events", "velocity_flat_cfg")
MODELS = {
    "BuiltinPositionActuatorCfg": "pd",
    "IdealPdActuatorCfg": "ideal_pd",
    "DcMotorActuatorCfg": "dc_motor",
    "BuiltinVelocityActuatorCfg": "velocity",
    "BuiltinMotorActuatorCfg": "motor",
}
"""mjlab's actuators -> models of the table."""
DRIVE = {
    "stiffness": "kp",
    "damping": "kd",
    "effort_limit": "effort",
    "velocity_limit": "velocity",
    "saturation_effort": "stall",
    "armature": "armature",
    "frictionloss": "friction",
    "viscous_damping": "damping",
}
"""mjlab's fields -> the vocabulary's quantities."""
ALWAYS = frozenset({"model", "effort", "armature", "friction", "damping"})
STATED = {
    "pd": ALWAYS | {"kp", "kd"},
    "ideal_pd": ALWAYS | {"kp", "kd"},
    "dc_motor": ALWAYS | {"kp", "kd", "velocity", "stall"},
    "velocity": ALWAYS | {"kd"},
    "motor": ALWAYS,
}
"""Model -> quantities that the module states of a joint; other drives mjlab does not have."""
LOOPS = ("pd", "ideal_pd", "dc_motor")
"""Drives that hold a position, which mjlab's terms for gains and effort know."""
COLLISION = (r".*_collision\d*",)
UNLIMITED = 1e9
"""N m or N: a motor of mjlab needs a limit, so this one says that there is none."""


class MjlabReader(Reader):
    """Executes the module for mjlab with stand-ins and compares what it says with the robot."""

    form: ClassVar[str] = FORM
    called: ClassVar[str] = "mjlab's module"
    needs: ClassVar[tuple[str, ...]] = ("mjlab",)
    behind: ClassVar[tuple[str, ...]] = ("python/*_mjlab.py",)
    asks: ClassVar[tuple[str, ...]] = ("randomize", "feet", "mjlab")
    lacks: ClassVar[Mapping[str, str]] = left_to_the_asset("simulation cone", "simulation impratio")

    def file(self, root: Path, robot: str) -> Path | None:
        """The one module below `python/`."""
        found = sorted((root / "python").glob("*_mjlab.py"))
        return found[0] if found else root / "python" / f"{robot}_mjlab.py"

    def read(self, path: Path) -> Table:
        """The facts of a module, by the names that it writes out."""
        record = recorded(path, CALLS)
        start = table_of(table_of(record.get("robot_cfg()")).get("init_state"))
        return _table(record, {}, own_names(start.get("joint_pos")), path.name)

    def found(self, path: Path, reference: Reference) -> Table:
        """Patterns are those of the robot's bodies and joints."""
        tree = reference.tree
        joints = {joint.name: joint.name for joint in tree.moving_joints}
        bodies = {name: name for name in tree.by_body}
        return _table(recorded(path, CALLS), bodies, joints, path.name)

    def expected(self, reference: Reference) -> Table:
        """The joints that mjlab can drive; what it has besides drives."""
        models = {row.joint: row.model for row in reference.control.actuators}

        def is_stated(key: Key) -> bool:
            stated = STATED.get(models.get(key.name, ""), frozenset())
            return self.holds(key) and (key.kind != "joint" or key.quantity in stated)

        return robot_table(reference).only(is_stated) | _besides(reference, self.robot)


# --- what the module says ---------------------------------------------------------------------


def _table(record: Record, bodies: Names, joints: Names, file: str) -> Table:
    """Of the velocity task where there is one, else of the robot alone."""
    book, task = Writer(), record.get("velocity_flat_cfg()")
    robot, terms = record["robot_cfg()"], record.get("randomize_events()")
    simulation = {name: record[name.upper()] for name in ("timestep", "decimation", "gravity")}
    scale = record["ACTION_SCALE"]
    if task is not None:
        simulation = task["sim"]["mujoco"] | {"decimation": task.get("decimation")}
        scale, terms = task["actions"]["joint_pos"].get("scale"), task["events"]
        robot = task["scene"]["entities"]["robot"]
        gone = tuple(sorted(name for name, term in terms.items() if term is None))
        book.put("robot", "", {f"{FORM}:without": gone})
    stated = ("timestep", "decimation", "gravity", "cone", "impratio")
    book.put("simulation", "", {n: simulation[n] for n in stated if simulation.get(n) is not None})
    model = words_of(record[f"{class_of(robot.get('spec_fn'))}()"].get(ARGUMENTS))
    book.put("robot", "", {f"{FORM}:model": model, f"{FORM}:root": record["ROOT_BODY"]})
    start, body = robot["init_state"], robot["articulation"]
    put_start(start, start.get("rot", (1.0, 0.0, 0.0, 0.0)), FORM, joints, book)
    book.put("robot", "", {"soft limits": body.get("soft_joint_pos_limit_factor")})
    groups = []
    for drive in body["actuators"]:
        groups.append(matching(words_of(drive.get("target_names_expr")), joints))
        for joint in groups[-1]:
            book.put("joint", joint, _drive(drive, record["TIMESTEP"]))
            book.place("joint", joint, f"{file}:{drive[LINE]}")
    put_by_joint(scale, joints, f"{FORM}:action scale", book)
    put_terms(terms, FORM, bodies, joints, book, groups)
    return book.plain_table()


def _drive(drive: Record, timestep_s: float) -> dict[str, Value]:
    """Quantities of each joint of one group."""
    facts: dict[str, Value] = {"model": MODELS.get(class_of(drive), class_of(drive))}
    facts |= {quantity: drive[field] for field, quantity in DRIVE.items() if field in drive}
    if facts["model"] == "motor" and facts.get("effort") == UNLIMITED:
        facts["effort"] = None
    steps = (drive.get("delay_min_lag", 0), drive.get("delay_max_lag", 0))
    return facts | {"delay": delay_s(steps, timestep_s)}


# --- what the robot says ----------------------------------------------------------------------


def _besides(reference: Reference, robot: str) -> Table:
    """The start, delays, actions, what is drawn, and the options of the velocity task."""
    book, asked = Writer(), reference.options.get("mjlab") or {}
    model = (f"/bundle/mjcf/{robot}_bare.xml",)
    book.put("robot", "", {f"{FORM}:model": model, f"{FORM}:root": reference.tree.root})
    put_expected_start(reference, FORM, asked.get("soft_joint_pos_limit_factor", 0.9), 0.0, book)
    action = {"effort_share": 0.25, "rad": 0.5, "m": 0.05} | (asked.get("action") or {})
    for row in reference.control.actuators:
        if row.model not in STATED:
            continue
        steps = (varied(reference, "joints", row.joint) or {}).get("delay", (0, 0))
        delay = delay_s(steps, reference.control.simulation.timestep)
        book.put("joint", row.joint, {"delay": delay})
        if row.kp and row.effort:
            slides = reference.tree.by_joint[row.joint].kind == "prismatic"
            scale = min(
                action["effort_share"] * row.effort / row.kp, action["m" if slides else "rad"]
            )
            book.put("joint", row.joint, {f"{FORM}:action scale": scale})
    if reference.options.get("randomize"):
        _put_matter(reference, book)
        _put_joints(reference, book)
    if _walks(reference):
        book.put("robot", "", {f"{FORM}:without": tuple(_replaced(reference))})
        solver = {"cone": asked.get("cone", "elliptic"), "impratio": asked.get("impratio", 10.0)}
        book.put("simulation", "", solver)
    return book.table()


def _walks(reference: Reference) -> bool:
    """Whether the module has mjlab's velocity task: a floating robot that stands on something."""
    pattern = (reference.options.get("feet") or {}).get("links")
    links = [shape.link for shape in reference.shapes.of("collision")]
    stands = any(re.fullmatch(pattern, link) for link in links) if pattern else False
    driven = any(row.model in STATED for row in reference.control.actuators)
    return reference.tree.base == "floating" and stands and driven


# --- what is drawn


def _replaced(reference: Reference) -> Iterator[str]:
    """Events of mjlab's velocity task that would draw the same once more."""
    recipe, root = reference.options.get("randomize") or {}, reference.tree.root
    if root in massive_bodies(reference) and varied(reference, "links", root) is not None:
        yield "base_com"
    if any(joint.get("encoder_bias") for joint in recipe.get("joints", {}).values()):
        yield "encoder_bias"
    if recipe.get("friction") is not None:
        yield "foot_friction"


def _put_matter(reference: Reference, book: Writer) -> None:
    """A body's J becomes U J Uᵀ with U = exp(alpha) [[A, t], [0, 1]] about the body's origin."""
    recipe, massive = reference.options["randomize"], massive_bodies(reference)
    for body in massive:
        if (matter := varied(reference, "links", body)) is not None:
            put_drawn(FORM, "pseudo_inertia", "body", body, book, **dict(_log_cholesky(matter)))
    for payload in recipe.get("payloads", ()):
        body, X_body_link = reference.tree.placement(payload["link"])
        if body in massive:
            box, mass = _box(payload, X_body_link), payload["mass"]
            put_drawn(FORM, "carry_payload", "body", body, book, mass_range=mass, box=box)
    if recipe.get("friction") is not None:
        same = {"geom_names": COLLISION, "axes": (0,), "shared_random": True, "operation": "abs"}
        put_drawn(FORM, "geom_friction", "robot", "", book, ranges=recipe["friction"], **same)


def _log_cholesky(matter: Ranges) -> Iterator[tuple[str, tuple[float, float]]]:
    """The mass grows by exp(2 alpha)."""
    low, high = matter["density"]
    yield "alpha_range", (math.log(low) / 2, math.log(high) / 2)
    for axis, most in enumerate(per_axis(matter["com"]), start=1):
        yield f"t{axis}_range", (-most, most)
    if matter["stretch"]:
        yield "d_range", (-matter["stretch"], matter["stretch"])
    for pair in ("12", "13", "23") if matter["shear"] else ():
        yield f"s{pair}_range", (-matter["shear"], matter["shear"])


def _box(payload: Mapping[str, Any], X_body_link: Pose) -> tuple[float, ...]:  # Any: JSON
    """(16,) [[S, h], [h, 1]] of one kilogram: second moments e²/12 along its edges, m²."""
    turn = X_body_link.rotation
    centre = turn @ np.array(payload["at"]) + np.array(X_body_link.xyz)
    second = turn @ np.diag(np.square(payload["size"]) / 12.0) @ turn.T
    matter = np.eye(4)
    matter[:3, :3] = second + np.outer(centre, centre)
    matter[:3, 3] = matter[3, :3] = centre
    return tuple(map(float, matter.ravel()))


def _put_joints(reference: Reference, book: Writer) -> None:
    """Gains and effort of drives that hold a position; losses and encoders of all joints."""
    for joint in (each.name for each in reference.tree.moving_joints):
        ranges, row = (
            varied(reference, "joints", joint) or {},
            reference.control.by_joint.get(joint),
        )
        gains = factors(ranges, "kp", "kd")
        if row and row.model in LOOPS and gains:
            said = {f"{key}_range": ranges[key] for key in ("kp", "kd")}
            put_drawn(FORM, "pd_gains", "joint", joint, book, **said)
        if row and row.model in LOOPS and row.effort is not None and factors(ranges, "effort"):
            said = {"effort_limit_range": ranges["effort"]}
            put_drawn(FORM, "effort_limits", "joint", joint, book, **said)
        for key, pair in factors(ranges, "damping", "friction", "armature").items():
            said = {"ranges": pair, "operation": "scale"}
            put_drawn(FORM, f"joint_{key}", "joint", joint, book, **said)
        if most := ranges.get("encoder_bias"):
            put_drawn(FORM, "encoder_bias", "joint", joint, book, bias_range=(-most, most))
