"""`usd/<robot>.usda` as it composes with its default variants."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from assetbuild.facts.compare import FLOAT32, Precision
from assetbuild.facts.reader import Lost, Reader
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Table
from assetbuild.findings import Finding, Rule

_OUTSIDE = (
    "the controller that computes it runs outside of the simulator: see the trainers' modules"
)
_BITS = "USD has no masks: `collides` and filtered pairs say what they mean"
_SPRING = "a spring is the drive of its joint (kp, drive target), or `usd.spring` is reported"


IGNORED = Rule(
    "usd.ignored",
    "info",
    "a USD tells an engine something that assetbuild does not read",
    "if it moves or weighs the robot, give it in a way that is read: a mass for a density",
)


ENGINES = ("physics:", "physx", "newton:", "mjc:", "drive:")
OURS = re.compile(
    r"usd:((physx(Articulation|RigidBody|ConvexHullCollision)|newton|mjc|drive):.*"
    r"|physics:approximation)"
)
"""Words of engines that our own files state, too."""


def ignored_words(table: Table) -> Iterator[Finding]:
    """One finding for all of a file."""
    words = {key.quantity for key in table.facts if not OURS.fullmatch(key.quantity)}
    stated = {word.removeprefix("usd:") for word in words if word.startswith("usd:")}
    names = tuple(sorted(word for word in stated if word.startswith(ENGINES)))
    if names:
        listed = ", ".join(f"`{name}`" for name in names)
        yield IGNORED("robot", f"not read: {listed}", data={"attributes": names})


class UsdReader(Reader):
    """What the composed stage says to the engines that simulate it."""

    needs: ClassVar[tuple[str, ...]] = ("usd",)
    preload = ("pxr.Usd", "pxr.UsdGeom", "pxr.UsdPhysics", "pxr.UsdShade")
    format_id: ClassVar[str] = "usd"
    display_name: ClassVar[str] = "the USD"
    folder: ClassVar[str] = "usd"
    file_globs: ClassVar[tuple[str, ...]] = ("usd/{robot}.usda", "usd/payloads/*")
    suffixes: ClassVar[tuple[str, ...]] = (".usd", ".usda", ".usdc", ".usdz")
    recipe_sections: ClassVar[tuple[str, ...]] = ("usd",)
    # Transforms and sizes are double precision.
    precision: ClassVar[Precision] = Precision(
        FLOAT32,
        {
            ("body", "pose"): 1e-9,
            ("frame", "pose"): 1e-9,
            ("camera", "pose"): 1e-9,
            ("shape", "pose"): 1e-9,
            ("shape", "size"): 1e-9,
            ("robot", "base pose"): 1e-9,
        },
        # USD turns by the arc cosine of w, which loses up to 3e-8 rad of a small turn.
        turn=1e-7,
    )
    lacks: ClassVar[Mapping[str, str]] = {
        "joint model": _OUTSIDE,
        "joint gear": _OUTSIDE,
        "joint stall": _OUTSIDE,
        "joint command range": _OUTSIDE,
        "joint drive parameters": _OUTSIDE,
        "joint delay": _OUTSIDE,
        "joint drive name": "a drive is part of its joint and has no name",
        "joint stiffness": _SPRING,
        "joint spring reference": _SPRING,
        "shape contype": _BITS,
        "shape conaffinity": _BITS,
        "sensor": Lost("UsdPhysics has none; simulators add their own"),
        "camera resolution": "what renders decides it; the shape of the picture is compared",
        "camera tracking": Lost("a camera of USD is fixed to what carries it"),
        "keyframe base pose": "a pose of Isaac Sim's schema has none",
        "keyframe target": "a pose of Isaac Sim's schema has positions alone",
        "robot start pose": "`scene.usda` has it",
        "simulation": "`scene.usda` says it",
        "floor": "`scene.usda` has it",
    }

    def read(self, path: Path) -> Table:
        """Read any USD; UsageError where it does not open, or names no default prim."""
        from assetbuild.facts.usd_robot import read_robot

        return read_robot(path)

    def expected(self, reference: Reference) -> Table:
        """The robot as USD can hold it, with the words of the format."""
        from assetbuild.facts.usd_expected import usd_table

        reference = replace(reference, shapes=reference.shapes.all_coloured)
        return usd_table(robot_table(reference).only(self.holds), reference)
