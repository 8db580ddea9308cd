"""Does each gripper close on an object, lift it, and hold it while it is shaken?

MuJoCo's model says where hands are and where objects lie, for every simulator.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from pydantic import Field

from assetbuild.engine.step import Files, Limits
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule, Severity
from assetbuild.plugin_types import RecipeView, write_figures
from assetbuild.recipe_types import Model, Positive
from assetbuild.robot.pose import Array, Pose, quat_of, vec3
from assetbuild.simulators import mujoco
from assetbuild.simulators.experiments import (
    Course,
    Experiment,
    Gripped,
    Outcome,
    Setting,
    SimulatorCheck,
)
from assetbuild.simulators.mujoco import grip
from assetbuild.simulators.mujoco.grip import Grip, Place, Try, hands_of, tries_of, with_object
from assetbuild.simulators.mujoco.hands import Hand, at_pose

LEAST_KG = 0.005
"""Less is not tried for a hand that drops what it should hold."""


class GripWish(Model):
    """Grip, lift, shake and hold objects; {} = defaults, null = do not."""

    masses: tuple[Positive, ...] = Field((0.1, 0.5), description="kg, of the objects")
    slip: Positive = Field(0.002, description="m that an object may move in the hand, warning")
    keyframes: tuple[str, str] | None = Field(
        None,
        description="of the open and of the closed hand; without them, what one drive closes, or "
        "two drives of facing fingers, is found",
    )


class GripCheck(SimulatorCheck):
    """Grips a cube, a cylinder and a sphere of 40 mm, or less where the hand is smaller.

    Friction 1; closed in 1 s on a table, lifted in 1.5 s, shaken for 1 s, held for 5 s. Figures by
    palm: of each object the slip in m.
    """

    reads: ClassVar[tuple[str, ...]] = ()
    sections: ClassVar[Mapping[str, str]] = {"validate.grip": "wish"}
    lost: ClassVar[Rule]
    no_hand: ClassVar[Rule | None] = None
    """Rule for what cannot be tried; None where another check says so."""

    wish: GripWish | None = None

    @classmethod
    def configure(cls, recipe: RecipeView) -> Self | None:
        """Make it only where a recipe asks for it."""
        return super().configure(recipe) if recipe.value("validate.grip") else None

    @property
    def asked(self) -> GripWish:
        """The wish, or its defaults."""
        return self.wish or GripWish()

    def grips(
        self, inputs: Path, model: mujoco.Model, hand: Hand, tries: Sequence[Try]
    ) -> Sequence[Grip]:
        """How the simulator's hand holds each object. model: of `with_object`."""
        raise NotImplementedError

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the MJCF, and the simulator's file."""
        figures: dict[str, object] = {}
        for form, path in mujoco.full_and_mjx(files.inputs, self.robot):
            target, name = self.label(form, path)
            target_figures: dict[str, object] = {}
            try:
                with mujoco.caught_warnings():
                    yield from self._tried(files.inputs, name, path, target_figures)
            except StepError as error:
                target_figures = {"skipped": error.message}
                yield from self._unfit(name, error.message, "warning", error.hint)
            figures[target] = target_figures
        write_figures(files, figures, {"slip_m": self.asked.slip})

    def _tried(
        self, inputs: Path, name: str, path: Path, figures: dict[str, object]
    ) -> Iterator[Finding]:
        """Fill figures by palm. Raises StepError where nothing can be tried."""
        model = with_object(path)
        hands = hands_of(model, self.asked.keyframes)
        if not hands:
            yield from self._unfit(name, "no drive alone closes anything like a gripper", "info")
        for hand in hands:
            palm = mujoco.name_of(model, "body", hand.palm)
            tries = tries_of(model, hand, self.asked.masses)
            done = self.grips(inputs, model, hand, tries) if tries else ()
            figures[palm] = [_row(one) for one in done]
            if not done:
                message = f"no object fits into the hand of `{palm}`"
                yield from self._unfit(name, message, "warning")
            failed = [one for one in done if not self._holds(one)]
            if failed:
                yield self.lost(
                    f"link {palm}",
                    f"{name}: its gripper fails to hold {len(failed)} of {len(done)} objects: "
                    + ", ".join(map(_words, failed))
                    + self._least_held(inputs, model, hand, failed),
                    data={"failed": len(failed), "of": len(done), "limit_m": self.asked.slip},
                )

    def _unfit(
        self, name: str, message: str, severity: Severity, hint: str = ""
    ) -> Iterator[Finding]:
        if self.no_hand is not None:
            yield self.no_hand("robot", f"{name}: {message}", hint=hint, severity=severity)

    def _holds(self, one: Grip) -> bool:
        return one.held and one.slip_m <= self.asked.slip

    def _least_held(
        self, inputs: Path, model: mujoco.Model, hand: Hand, failed: Sequence[Grip]
    ) -> str:
        """What the hand holds of the shape whose lightest it lost; nothing where it held that.

        Another simulator takes too long to try.
        """
        lightest = next((one for one in failed if one.mass == min(self.asked.masses)), None)
        if lightest is None or self.no_hand is None:
            return ""
        mass, shape = lightest.mass, lightest.place.shape
        while mass / 2.0 >= LEAST_KG:
            mass /= 2.0
            if self._holds(self.grips(inputs, model, hand, [(lightest.place, mass)])[0]):
                return f"; it holds a {shape} of {mass:.3g} kg"
        return f"; nor does it hold a {shape} of {mass:.3g} kg, so its weight is not the cause"


def _row(one: Grip) -> dict[str, object]:
    known: dict[str, object] = {"slip_m": one.slip_m, "seat_m": one.seat_m}
    if one.forces_n:
        known |= {"forces_n": list(one.forces_n)}
    return {
        "shape": one.place.shape,
        "mass_kg": one.mass,
        "width_m": one.place.width_m,
        "held": one.held,
        **(known if one.held else dict.fromkeys(known)),
    }


def _words(one: Grip) -> str:
    did = f"slips by {1e3 * one.slip_m:.3g} mm" if one.held else "is lost"
    place = one.place
    object_ = f"a {place.shape} of {1e3 * place.width_m:.3g} mm and {one.mass:.3g} kg"
    return f"{object_} {one.failure or did}"


# --- in engines that read USD --------------------------------------------------------------------


SAMPLE_S = 0.1


class StageGripping(GripCheck):
    """Does what `grip` does in MuJoCo, whose model says where objects lie and how the hand closes.

    All but the fingers is locked, and the object alone is shaken.
    """

    usual_s = 60.0
    needs: ClassVar[tuple[str, ...]] = ("mjcf", "usd")
    limits: ClassVar[Limits] = Limits(wall_s=2400.0, memory_mb=16384)

    def grips(
        self, inputs: Path, model: mujoco.Model, hand: Hand, tries: Sequence[Try]
    ) -> Sequence[Grip]:
        """All in one process. Of a side, it is seen from the body against which it moved least."""
        experiments = [
            _experiment(str(index), model, hand, place, mass)
            for index, (place, mass) in enumerate(tries)
        ]
        done = self.perform(inputs, experiments)
        return [
            _grip(done[experiment.name], hand, place, mass)
            for experiment, (place, mass) in zip(experiments, tries, strict=True)
        ]


def _experiment(
    name: str, model: mujoco.Model, hand: Hand, place: Place, mass: float
) -> Experiment:
    pose, step = hand.poses[place.start], float(model.opt.timestep)
    R, at = np.eye(3), np.zeros(3)  # from MuJoCo's world into that of the stage
    if mujoco.floats(model):  # which holds a floating base at its origin
        data = at_pose(model, pose)
        R = data.xmat[1].reshape(3, 3).T
        at = -R @ data.xpos[1]
    times: Array = step * np.arange(round(grip.TOTAL_S / step) + 1.0)

    table = grip.table_at(place, times) @ R.T + at
    quat = quat_of(R @ place.R)
    joints = mujoco.joints(model)
    positions = {name: float(pose[model.jnt_qposadr[joint]]) for name, joint in joints.items()}
    gripped = Gripped(
        place.shape,
        vec3(2.0 * grip.half_size(place.shape, place.width_m)),
        mass,
        vec3(grip.inertia_of(place.shape, place.width_m, mass)),
        grip.FRICTION,
        Pose(vec3(R @ place.xyz + at), quat),
        Pose(vec3(table[0]), quat),
    )
    setting = Setting(
        step,
        vec3(grip.G * R @ place.down),
        "held" if mujoco.floats(model) else "asset",
        locked={name: positions[name] for name in joints if joints[name] not in hand.fingers},
        gripped=gripped,
        solver=mujoco.contact_solver(model),
    )
    targets = grip.closing(hand, place, times)
    course = Course(
        {drive.joint_name: targets[:, i] for i, drive in enumerate(hand.drives)},
        table,
        mass * grip.shaking(place, times) @ R.T,
        tuple(mujoco.name_of(model, "body", body) for side in hand.sides for body in side),
    )
    every = max(1, round(SAMPLE_S / step))
    return Experiment(name, setting, len(times) - 1, every, positions, course=course)


def _grip(outcome: Outcome, hand: Hand, place: Place, mass: float) -> Grip:
    motion = outcome.motion
    if motion is None or motion.seen is None or not outcome.finite:
        return Grip(place, mass, np.inf, np.inf, None, held=False, failure=outcome.failure)
    times = (grip.CLOSE_S, grip.CLOSE_S + grip.LIFT_S, motion.time[-1])
    seen = motion.seen[np.searchsorted(motion.time, np.array(times) - SAMPLE_S / 2.0)]
    moved, one = np.linalg.norm(np.diff(seen, axis=0), axis=2), len(hand.sides[0])
    seat, slip = (float(row[:one].min() + row[one:].min()) / 2.0 for row in moved)
    return Grip(place, mass, slip, seat, None, held=seat + slip < grip.LIFT_M / 2.0)
