"""Do limits, mimic joints and loops hold what drives can bring, in the full model and in mjx?"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule, Severity, known
from assetbuild.plugin_types import write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.pose import Array
from assetbuild.robot.softness import Allowed, CouplingError, LimitError, effort_at
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import Data, Model, mj
from assetbuild.simulators.mujoco.drives import aim

MOST = 2.0
"""Times the wish; the load grows in a fifth of a second, which swings a little."""

LIMITS_SOFT = Rule(
    "limits.soft",
    ("info", "warning"),
    "full effort pushes joints further past their limits in MuJoCo than twice what `limits` allows "
    "(information where an MJCF source says how soft they are)",
    "state the rotor's inertia (`motors` or `armature`), or a shorter timestep; of an MJCF, state "
    "`limits`",
)
COUPLINGS_SOFT = Rule(
    "couplings.soft",
    ("info", "warning"),
    "full effort parts joints from those that they follow, or the ends of loops, in MuJoCo by more "
    "than twice what `couplings` allows (information where an MJCF source says how soft they are)",
    "state the rotor's inertia (`motors` or `armature`), or a shorter timestep; of an MJCF, state "
    "`couplings`",
)


class FullEffort(mujoco.InMujoco):
    """Pushes joints against their limits, followers from their leaders, and loops apart.

    Findings `limits.soft` and `couplings.soft`; figures by file: the largest error of turning and
    of sliding joints, rad and m.
    """

    also: ClassVar[tuple[str, ...]] = ("mjx",)
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")

    recipe_fields: ClassVar[Mapping[str, str]] = {
        "limits_wish": "limits",
        "couplings_wish": "couplings",
        "source": "source.mjcf",
    }

    robot: str
    limits_wish: LimitError = LimitError.model_validate({})
    couplings_wish: CouplingError = CouplingError.model_validate({})
    source: str | None = None
    """An MJCF that says itself how soft its constraints are."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot, `mjcf/<robot>.xml` and, where it is built, `mjx/<robot>_mjx.xml`."""
        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        efforts = {joint.name: effort_at(tree, control, joint) for joint in tree.moving_joints}
        pushing = {row.joint for row in control.actuators if row.model != "passive"}
        driven = {joint: effort for joint, effort in efforts.items() if joint in pushing}
        figures: dict[str, object] = {}
        for folder, path, model in mujoco.full_and_mjx_models(files.inputs, self.robot, figures):
            limits = tuple(past_limits(model, efforts))
            coupled = (*off_couplings(model, efforts), *open_loops(model, driven))
            figures[folder] = {"limits": _worst(limits), "couplings": _worst(coupled)}
            for rule, pushed, wish, ours in (
                (LIMITS_SOFT, limits, self.limits_wish, control.soft_limits),
                (COUPLINGS_SOFT, coupled, self.couplings_wish, control.soft_couplings),
            ):
                # Where none is ours, an MJCF source has decided how soft they are.
                severity: Severity = "warning" if ours or not self.source else "info"
                yield from _judge(rule, pushed, wish, path.name, severity)
        write_figures(files, figures)


def _judge(
    rule: Rule, pushed: Sequence[Pushed], wish: Allowed, file: str, severity: Severity
) -> Iterator[Finding]:
    """One finding for all joints, the furthest first; an unstable simulation before all."""
    shares = [_error(one) / (MOST * (wish.slide if one.slides else wish.turn)) for one in pushed]
    order = sorted(range(len(pushed)), key=lambda index: -shares[index])
    far = [pushed[index] for index in order if shares[index] > 1.0]
    if not far:
        return
    shown = ", ".join(f"`{one.joint}` by {_length(one)}" for one in far[:4])
    verb = "past their limits" if rule is LIMITS_SOFT else "from where they are held"
    yield rule(
        "robot",
        f"{file}: full effort pushes {len(far)} of {len(pushed)} joints {verb}: {shown}"
        f"{', ...' if len(far) > 4 else ''} (limit {MOST * wish.turn:.3g} rad, "
        f"{1e3 * MOST * wish.slide:.3g} mm)",
        hint="state the rotor's inertia (`motors` or `armature`), or a shorter timestep"
        + (f"; or state `{rule.id.partition('.')[0]}` in the recipe" if severity == "info" else ""),
        severity=severity,
        data={"joints": len(far), "of": len(pushed), "first": far[0].joint},
    )


def _error(one: Pushed) -> float:
    """Infinite where the simulation became unstable."""
    return one.error if math.isfinite(one.error) else math.inf


def _length(one: Pushed) -> str:
    if not math.isfinite(one.error):
        return "more than can be simulated"
    return f"{1e3 * one.error:.3g} mm" if one.slides else f"{one.error:.3g} rad"


def _worst(pushed: Sequence[Pushed]) -> dict[str, object]:
    """The largest error and its joint, for joints that turn and that slide; None if unstable."""
    worst: dict[str, object] = {"joints": len(pushed)}
    for kind, slides in (("turn", False), ("slide", True)):
        one = max((one for one in pushed if one.slides == slides), key=_error, default=None)
        if one is not None:
            worst[kind] = {"error": known(one.error), "joint": one.joint}
    return worst


# --- full effort against what holds a joint ------------------------------------------------------


RISE_S, HOLD_S = 0.2, 0.3
"""The load grows to the full effort, then stays."""
JOINT, LOOP = ("JOINT",), ("CONNECT", "WELD")
"""Kinds of equalities: couplings of joints, and closed loops."""


@dataclass(frozen=True)
class Pushed:
    """How far full effort moved a joint from where it is held, rad or m; nan: unstable."""

    joint: str
    slides: bool
    error: float


def past_limits(model: Model, efforts: Mapping[str, float]) -> Iterator[Pushed]:
    """Each joint with limits and an effort, at both of them, the drives holding it there.

    efforts: by joint, N m or N. All joints are pushed at once: the limit of each feels its own
    load alone.
    """
    model = _alone(model, "CONTACT")
    model.eq_active0[_active(model, LOOP)] = 0  # not all of a loop's joints can be at their limits
    pushed = {j: effort for j, effort in _loaded(model, efforts).items() if model.jnt_limited[j]}
    joints, worst = list(pushed), np.zeros(len(pushed))
    at, limits = model.jnt_qposadr[joints], model.jnt_range[joints]
    for side, sign in ((0, -1.0), (1, 1.0)) if joints else ():
        data, load = mujoco.at_key(model), np.zeros(model.nv)
        data.qpos[at] = limits[:, side]
        load[model.jnt_dofadr[joints]] = sign * np.array([*pushed.values()])
        for index in _active(model, JOINT):  # followers are where their leaders are, who bear it
            follower, leader, offset, gear = _coupling(model, index)
            led = data.qpos[model.jnt_qposadr[leader]] if leader >= 0 else 0.0
            data.qpos[model.jnt_qposadr[follower]] = offset + gear * led
            load[model.jnt_dofadr[follower]] = 0.0
        aim(model, data)
        for position in _under(model, data, load):
            worst = np.maximum(worst, sign * (position[at] - limits[:, side]))
    for joint, error in zip(joints, worst, strict=True):
        yield _pushed(model, joint, float(error))


def off_couplings(model: Model, efforts: Mapping[str, float]) -> Iterator[Pushed]:
    """Each joint that follows another or is locked; the leader's effort works against it.

    efforts: by joint; of a follower, what its leader brings there.
    """
    model = _alone(model, "CONTACT", "LIMIT", "ACTUATION")
    pushed = _loaded(model, efforts)
    for index in _active(model, JOINT):
        follower, leader, offset, gear = _coupling(model, index)
        if follower not in pushed:
            continue
        data, load, worst = mujoco.at_key(model), np.zeros(model.nv), 0.0
        load[model.jnt_dofadr[follower]] = pushed[follower]
        if leader >= 0:
            load[model.jnt_dofadr[leader]] = -gear * pushed[follower]
        for position in _under(model, data, load):
            led = position[model.jnt_qposadr[leader]] if leader >= 0 else 0.0
            off = position[model.jnt_qposadr[follower]] - offset - gear * led
            worst = float(np.maximum(worst, abs(off)))
        yield _pushed(model, follower, worst)


def open_loops(model: Model, efforts: Mapping[str, float]) -> Iterator[Pushed]:
    """Each closed loop while drives push with their effort, one way and the other.

    All other joints are blocked, so that the loops carry it. efforts: of drives, by joint. The
    error is how far the two points of a loop part, m.
    """
    model = _alone(model, "CONTACT", "ACTUATION", "LIMIT")
    pushed, loops = _loaded(model, efforts), _active(model, LOOP)
    mujoco.held_but(model, pushed)
    worst, load = np.zeros(len(loops)), np.zeros(model.nv)
    load[model.jnt_dofadr[[*pushed]]] = [*pushed.values()]
    for sign in (-1.0, 1.0) if loops and pushed else ():
        data = mujoco.at_key(model)
        mj.mj_forward(model, data)
        at_home = _gaps(data, loops)
        for position in _under(model, data, sign * load):
            opened = _gaps(data, loops) - at_home if np.isfinite(position).all() else math.nan
            worst = np.maximum(worst, opened)
    for index, error in zip(loops, worst, strict=True):
        yield Pushed(f"loop {mujoco.name_of(model, 'equality', index)}", True, float(error))


def _gaps(data: Data, loops: list[int]) -> Array:
    """Distance of the two points of each `connect` or `weld`, m."""
    rows = data.efc_type == int(mj.mjtConstraint.mjCNSTR_EQUALITY)
    places = [np.flatnonzero(rows & (data.efc_id == index))[:3] for index in loops]
    return np.array([np.linalg.norm(data.efc_pos[place]) for place in places])


def _alone(model: Model, *flags: str) -> Model:
    """A copy without gravity and some of MuJoCo's features, the base held."""
    model = mujoco.without(model, *flags)
    mujoco.hold_base(model)
    model.opt.gravity[:] = 0.0
    return model


def _loaded(model: Model, efforts: Mapping[str, float]) -> dict[int, float]:
    """Effort by number of the hinges and slides that have one."""
    joints = mujoco.joints(model)
    return {joint: efforts[name] for name, joint in joints.items() if efforts.get(name, 0.0) > 0.0}


def _active(model: Model, kinds: tuple[str, ...]) -> list[int]:
    numbers = [int(getattr(mj.mjtEq, f"mjEQ_{kind}")) for kind in kinds]
    return np.flatnonzero(np.isin(model.eq_type, numbers) & (model.eq_active0 != 0)).tolist()


def _coupling(model: Model, equality: int) -> tuple[int, int, float, float]:
    """(follower, leader or -1, offset, multiplier)."""
    offset, gear = (float(value) for value in model.eq_data[equality, :2])
    return int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality]), offset, gear


def _under(model: Model, data: Data, load: Array) -> Iterator[Array]:
    """qpos after each step while the load grows, slowly so that nothing is thrown, and stays."""
    step = float(model.opt.timestep)
    with mujoco.caught_warnings():
        for index in range(round((RISE_S + HOLD_S) / step)):
            data.qfrc_applied[:] = load * min(1.0, (index + 1) * step / RISE_S)
            mj.mj_step(model, data)
            if not mujoco.is_finite(data):  # MuJoCo starts again from its default pose
                yield np.full(model.nq, np.nan)
                return
            yield data.qpos


def _pushed(model: Model, joint: int, error: float) -> Pushed:
    return Pushed(mujoco.name_of(model, "joint", joint), int(model.jnt_type[joint]) == 2, error)
