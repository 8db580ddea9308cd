"""Held by its drives at a keyframe on the floor, does the robot stand?"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import ClassVar

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.recipe_types import Pattern, Positive
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.robot.shapes import Shapes
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.drives import servoed
from assetbuild.simulators.mujoco.stand import Stand as Stood
from assetbuild.simulators.mujoco.stand import outcome, outcome_figures, stand

FAR = 10.0
"""Times `sole`: feet so far from the floor at the start are an error; a reset drops the robot."""

LOAD = Rule("stand.load", "error", "there is no scene, keyframe or floor", "correct the recipe")
NOT_FINITE = Rule(
    "stand.finite",
    "error",
    "the simulation became unstable",
    "lower kd or the timestep; look for tiny inertias and overlapping shapes",
)
FALL = Rule(
    "stand.fall",
    "error",
    "the robot fell over, or a drive of a fixed robot did not hold its joint",
    "raise kp, check the effort limits",
)
SAG = Rule("stand.sag", "warning", "the base sinks more than allowed", "raise kp")
TILT = Rule(
    "stand.tilt",
    "warning",
    "the base tilts more than allowed",
    "move the feet under the centre of mass",
)
DRIFT = Rule(
    "stand.drift",
    "warning",
    "the base drifts more than allowed",
    "move the feet under the centre of mass",
)
START = Rule(
    "stand.sole_gap",
    ("warning", "error"),
    "the soles are not on the floor at the start (an error above 10 mm)",
    "`base: on_ground` puts the lowest part on the floor: choose joint values with which all "
    "soles are as low",
)
CONTACT = Rule(
    "stand.contact",
    ("warning", "error"),
    "something other than a foot touches the floor (an error if it still does at the end), or "
    "nothing does",
    "raise the pose, or name the link in `feet`",
)
NO_FEET = Rule(
    "stand.feet", "error", "`feet` matches no collision shape", "give the feet collision geometry"
)
TORQUE = Rule(
    "stand.torque",
    "warning",
    "standing needs nearly all of the effort limit",
    "check effort and pose",
)


class Stand(mujoco.InMujoco):
    """Simulates `mjcf/scene.xml` in MuJoCo; a fixed base only has its joints judged."""

    reads = ("tree.json", "shapes.json", "control.json")
    section = "validate.stand"
    about = "stand still under the drives; {} = defaults"
    enabled_by_default = False
    derived: ClassVar = {
        "feet": lambda recipe: recipe.value("validate.stand.feet") or recipe.value("feet.links")
    }

    keyframe: str = Field("home", description="the pose to hold")
    seconds: Positive = Field(2.0, description="s")
    max_sag: Positive = Field(0.03, description="m of base height, warning")
    max_tilt: Positive = Field(0.1, description="rad of the base, warning")
    max_drift: Positive = Field(0.02, description="m sideways, warning")
    sole: Positive = Field(
        0.001,
        description="m between a sole and the floor at the start, warning; ten times as much is an "
        "error",
    )
    fall: Positive = Field(
        0.5,
        description="share of the height lost, rad of tilt, or rad (m) that a driven joint of a "
        "fixed robot leaves its pose, that is a fall, error",
    )
    saturated: Positive = Field(
        0.98, description="share of an effort limit that standing may need, warning"
    )
    feet: Pattern | None = Field(
        None, description="source links that may touch the floor; without it `feet.links`"
    )

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the robot and `mjcf/scene.xml`."""
        robot = RobotFiles(files.inputs)
        try:
            model = mujoco.load(files.inputs / "mjcf" / "scene.xml", visuals=False).model
            stood = stand(servoed(model, robot.control), self.keyframe, self.seconds)
        except StepError as error:
            write_figures(files, {"skipped": error.message})
            yield LOAD("robot", f"cannot stand: {error.message}")
            return
        figures = _figures(stood) | {"stood": outcome_figures(stood, self.fall)}
        heights = ("height_m", "height_change_m", "height_before_m", "height_after_m")
        limits = {
            **dict.fromkeys(heights, self.max_sag),
            "gap_at_start_m": self.sole,
            **dict.fromkeys(("joint_sag", "max_joint_sag"), self.fall),
            **dict.fromkeys(("load", "max_load"), self.saturated),
            "tilt_rad": self.max_tilt,
            "drift_m": self.max_drift,
        }
        write_figures(files, figures, limits)
        if stood.finite:
            yield from self.evaluate(stood, robot.tree, robot.shapes)
        else:
            yield NOT_FINITE(
                "robot",
                f"the simulation became unstable while standing at `{self.keyframe}`",
                data={"warnings": len(stood.warnings)},
            )

    def evaluate(self, stood: Stood, tree: Tree, shapes: Shapes) -> Iterator[Finding]:
        """Yield what speaks against the way in which a robot stood that stayed finite."""
        link_of = {shape.name: shape.link for shape in shapes.of("collision")}
        if outcome(stood, self.fall) == "falls":
            yield self._fell(stood)
        if tree.base == "floating":
            yield from self._judge_soles(self._soles(stood, link_of, tree))
            for rule, value, limit, unit, what in (
                (SAG, abs(stood.sag_m), self.max_sag, "m", "base height changed"),
                (TILT, stood.tilt_rad, self.max_tilt, "rad", "base tilted"),
                (DRIFT, stood.drift_m, self.max_drift, "m", "base moved sideways"),
            ):
                if value > limit:
                    message = (
                        f"{what} by {value:.3g} {unit} in {self.seconds:g} s, more than {limit:g}"
                    )
                    yield rule(
                        "robot", message, data={f"value_{unit}": value, f"limit_{unit}": limit}
                    )
            yield from self._judge_contacts(stood, link_of)
        for joint, load in stood.load.items():
            if load >= self.saturated:
                message = f"needs all of its effort limit to stand ({load:.0%})"
                yield TORQUE(f"actuator {joint}", message, data={"load": load})

    def _fell(self, stood: Stood) -> Finding:
        if not stood.floats:
            joint, off, unit = stood.worst_held
            return FALL(
                f"actuator {joint}",
                f"does not hold the pose: after {self.seconds:g} s its joint is {off:.3g} {unit} "
                f"off `{self.keyframe}`, above the limit of {self.fall:g}",
                data={"off": off, "limit": self.fall},
            )
        return FALL(
            "robot",
            f"fell within {self.seconds:g} s: its base went from {stood.height_m:.3g} m to "
            f"{stood.height_m - stood.sag_m:.3g} m above the floor and tilted by "
            f"{stood.tilt_rad:.3g} rad",
            hint="raise kp, check the effort limits, look for a pose off balance",
            data={"sag_m": stood.sag_m, "tilt_rad": stood.tilt_rad},
        )

    def _is_foot(self, link: str) -> bool:
        return self.feet is None or re.fullmatch(self.feet, link) is not None

    def _soles(self, stood: Stood, link_of: Mapping[str, str], tree: Tree) -> dict[str, float]:
        """Gap (m) of every foot by the pattern; without one, of the lowest point of the robot.

        Links that fixed joints hold together are one foot, which stands on the lowest of them.
        """
        soles: dict[str, tuple[float, str]] = {}
        for geom, gap in stood.gap_m.items():
            link = link_of.get(geom, geom)
            if self._is_foot(link):
                # The uppermost body that fixed joints alone connect with the link.
                foot = next((frame.body for frame in tree.frames if frame.name == link), link)
                while (joint := tree.joint_above.get(foot)) is not None and joint.kind == "fixed":
                    foot = joint.parent
                soles[foot] = min((gap, link), soles.get(foot, (gap, link)))
        lowest = sorted(soles.values())
        return {link: gap for gap, link in (lowest if self.feet else lowest[:1])}

    def _judge_soles(self, soles: Mapping[str, float]) -> Iterator[Finding]:
        if self.feet and not soles:
            yield NO_FEET("robot", f"no link that matches `{self.feet}` has a shape to stand on")
        for link, gap in sorted(soles.items()):
            if abs(gap) > self.sole:
                side = "above" if gap > 0 else "inside"
                yield START(
                    f"link {link}",
                    f"at `{self.keyframe}` its sole is {abs(gap) * 1e3:.3g} mm {side} the floor",
                    severity="error" if abs(gap) > FAR * self.sole else "warning",
                    data={"gap_m": gap, "tolerance_m": self.sole},
                )

    def _judge_contacts(self, stood: Stood, link_of: Mapping[str, str]) -> Iterator[Finding]:
        at_end = {link_of.get(geom, geom) for geom in stood.touching}
        for link in sorted({link_of.get(geom, geom) for geom in stood.touched}):
            if not self._is_foot(link):
                when = "at the end" if link in at_end else "for a moment"
                yield CONTACT(
                    f"link {link}",
                    f"touched the floor {when}, and is no foot",
                    severity="error" if link in at_end else "warning",
                )
        if not at_end:
            yield CONTACT("robot", "nothing touches the floor at the end", severity="error")


def _figures(stood: Stood) -> dict[str, object]:
    """Numbers that JSON can hold; of an unstable run only that it was."""
    if not stood.finite:
        return {"finite": False, "mujoco_warnings": list(stood.warnings[:10])}
    plain = ("finite", "seconds", "height_m", "tilt_rad", "drift_m", "touching", "touched")
    return {
        **{name: getattr(stood, name) for name in (*plain, "joint_sag", "load")},
        "height_change_m": -stood.sag_m,
        "gap_at_start_m": {
            name: stood.gap_m[name] for name in stood.touched if name in stood.gap_m
        },
        "max_joint_sag": max(map(abs, stood.joint_sag.values()), default=0.0),
        "max_load": max(stood.load.values(), default=0.0),
    }
