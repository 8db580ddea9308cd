"""`dr.yaml`: the recipe's `randomize` in this robot's numbers, for any trainer."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule, steady
from assetbuild.plugin_types import Target
from assetbuild.robot.actuator_table import must_match
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control, Inertial, Tree
from assetbuild.robot.ranges import (
    JOINT_FACTORS,
    Randomize,
    RandomMatter,
    first_match,
    first_match_groups,
    per_axis,
)
from assetbuild.robot.tree import link_placement

UNSTATED = "not stated"
DRIVE = ("kp", "kd", "effort")
"""What only a drive has; damping, friction and armature are the joint's."""
HEAD = """\
# How far the real {robot} may be from its description, by assetbuild from the recipe's `randomize`.
# Ranges are [least, most]; draws are uniform unless a key says otherwise. SI units, radians.
# links: `density` is a factor of mass and inertia, `com` the largest shift along each body axis;
# `log_cholesky` says the same as U = exp(alpha) [[A, t], [0, 1]] (Rucker and Wensing, 2022).
# joints: the numbers of the actuator table with their ranges; delay in simulation steps.
"""

IDLE = Rule(
    "randomize.idle",
    ("info", "warning"),
    "a range of `kp`, `kd` or `effort` names joints without such a number in the actuator table, "
    "so nothing is drawn (a warning where only MJCF holds their drives)",
    "give these joints a row in `actuators`, or take them out of the pattern",
)
UNSOURCED = Rule(
    "randomize.source",
    "info",
    "ranges of `randomize` do not say where they come from",
    'add `source: "CAD tolerance"`, a datasheet or a measurement',
)


class StateRanges(Target):
    """`dr.yaml`, at the top of the bundle; a recipe asks for it by `randomize`, not by a name."""

    outputs = ("dr.yaml",)
    folder = ""
    reads = ("tree.json", "control.json")

    recipe_fields: ClassVar[Mapping[str, str]] = {"randomize": "randomize"}

    randomize: Randomize

    def check(self, tree: Tree) -> None:
        """Raise RowError, with the key of the recipe, for a pattern that matches nothing."""
        bodies, frames = list(tree.by_body), [frame.name for frame in tree.frames]
        moving = [joint.name for joint in tree.moving_joints]
        for pattern in self.randomize.links:
            merged = next((name for name in frames if re.fullmatch(pattern, name)), None)
            hint = f"`{merged}` was merged into `{tree.placement(merged)[0]}`" if merged else ""
            must_match(("randomize", "links", pattern), pattern, bodies, "body", hint)
        for pattern in self.randomize.joints:
            must_match(("randomize", "joints", pattern), pattern, moving, "moving joint")
        for index, payload in enumerate(self.randomize.payloads):
            key = ("randomize", "payloads", index, "link")
            link_placement(tree, payload.link, f"randomize.payloads[{index}]", key)

    def run(self, files: Files) -> Iterator[Finding]:
        """Every body and joint that a range speaks of, with nominal value, range and source."""
        import yaml

        robot = RobotFiles(files.inputs)
        tree, control = robot.tree, robot.control
        stated = {
            "schema": "assetbuild/dr/v1",
            "robot": self.robot,
            "seed": self.randomize.seed,
            "links": {
                body.name: _matter(body.inertial, matter)
                for body in tree.bodies
                if (matter := first_match(self.randomize.links, body.name)) and body.inertial
            },
            "payloads": self._payloads(tree),
            "joints": self._joints(tree, control),
            "contact": self._contact(control),
        }
        text = yaml.safe_dump(stated, sort_keys=False, default_flow_style=None, width=100)
        head = HEAD.format(robot=self.robot)
        (files.outputs / "dr.yaml").write_text(head + text, encoding="utf-8")
        yield from self._sources(tree)
        yield from self._idle(tree, control)

    def _idle(self, tree: Tree, control: Control) -> Iterator[Finding]:
        """Ranges of a drive on joints that have none in the actuator table."""
        idle: dict[str, list[str]] = {}
        leaders = {joint.name for joint in tree.moving_joints if joint.mimic is None}
        for _, ranges, joints in self.randomize.of_joints(tree):
            for key in DRIVE:
                if getattr(ranges, key) != (1.0, 1.0):
                    for joint in joints:
                        if joint in leaders and not getattr(control.by_joint.get(joint), key, 0.0):
                            idle.setdefault(key, []).append(joint)
        if idle:
            kept = sum(item.place == "actuator" for item in control.mjcf_only)
            shown = "; ".join(
                f"{key} of {len(joints)} joints (`{joints[0]}`)" for key, joints in idle.items()
            )
            why = f": {kept} drives are MJCF's alone, as they were there" if kept else ""
            yield IDLE(
                "recipe randomize",
                f"nothing is drawn for {shown}: the actuator table has none{why}",
                severity="warning" if kept else "info",
                data={key: tuple(joints) for key, joints in idle.items()},
            )

    def _payloads(self, tree: Tree) -> list[dict[str, Any]]:  # Any: YAML, here and below
        return [
            {"link": payload.link, "body": tree.placement(payload.link)[0]}
            | payload.model_dump(mode="json")
            | {"source": payload.source or UNSTATED}
            for payload in self.randomize.payloads
        ]

    def _joints(self, tree: Tree, control: Control) -> dict[str, dict[str, Any]]:
        rows = {}
        for joint in tree.moving_joints:
            ranges = first_match(self.randomize.joints, joint.name)
            if ranges is None:
                continue
            row: dict[str, Any] = {}
            actuator = control.by_joint.get(joint.name)
            for key in JOINT_FACTORS:
                low, high = getattr(ranges, key)
                nominal = getattr(actuator, key, None)
                if nominal and (low, high) != (1.0, 1.0):
                    row[key] = {"nominal": nominal, "range": _scaled(nominal, low, high)}
            row["delay"] = list(ranges.delay)
            row["encoder_bias"] = [steady(-ranges.encoder_bias), ranges.encoder_bias]
            row["source"] = ranges.source or UNSTATED
            rows[joint.name] = row
        return rows

    def _contact(self, control: Control) -> dict[str, Any]:
        contact: dict[str, Any] = {}
        if self.randomize.friction is not None:
            contact["friction"] = {
                "nominal": control.contact.friction[0],
                "range": list(self.randomize.friction),
                "source": self.randomize.friction_source or UNSTATED,
            }
        if self.randomize.restitution is not None:
            contact["restitution"] = {"nominal": 0.0, "range": list(self.randomize.restitution)}
        return contact

    def _sources(self, tree: Tree) -> Iterator[Finding]:
        """One finding for all ranges that nobody gave a reason for."""
        ranges = self.randomize
        bodies = [body.name for body in tree.bodies]
        rows = [(f"links.{p}", r.source) for p, r, _ in first_match_groups(ranges.links, bodies)]
        rows += [(f"payloads.{i}", r.source) for i, r in enumerate(ranges.payloads)]
        rows += [(f"joints.{p}", r.source) for p, r, _ in ranges.of_joints(tree)]
        if ranges.friction is not None:
            rows.append(("friction", ranges.friction_source))
        without = tuple(key for key, source in rows if not source)
        if without:
            yield UNSOURCED(
                "recipe randomize",
                f"{len(without)} of {len(rows)} ranges do not say where they come from: "
                f"{', '.join(without[:4])}",
                data={"without": without},
            )


def _matter(inertial: Inertial, matter: RandomMatter) -> dict[str, Any]:
    """One body. log_cholesky.t is the shift, exact; d and s act about the centre of mass."""
    mass, com = inertial.mass_kg, per_axis(matter.com)
    low, high = matter.density
    return {
        "mass": {"nominal": mass, "range": _scaled(mass, low, high)},
        "density": [low, high],
        "com": {"nominal": list(inertial.com_m), "shift": list(com)},
        "log_cholesky": {
            "alpha": [math.log(low) / 2, math.log(high) / 2],
            "d": [steady(-matter.stretch), matter.stretch],
            "s": [steady(-matter.shear), matter.shear],
            "t": [[steady(-shift), shift] for shift in com],
        },
        "source": matter.source or UNSTATED,
    }


def _scaled(nominal: float, low: float, high: float) -> list[float]:
    return [steady(nominal * low), steady(nominal * high)]
