"""PhysX as checks use it: `ovphysx` on the CPU, in a child process of its own.

The extra `physx` brings it. Its licence forbids to publish its figures: they may stand in the
user's own bundle, never in the repository or on a public page.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Limits
from assetbuild.findings import Rule
from assetbuild.simulators.children import ask
from assetbuild.simulators.stages import StageCheck

BEYOND_IMPORTS = ("assetbuild.simulators.physx._child", "physx_usd_schemas")
ITERATIONS: Mapping[str, str] = {"iterations": "usd.articulation.solver_position_iterations"}
"""For `Check.recipe_fields` of checks that know how often the solver applies gravity in a step."""
_PROGRAM = Path(__file__).with_name("_child.py")

LOAD = Rule(
    "physx.load", "error", "PhysX refuses the asset, or crashes on it", "read the `usd.*` findings"
)
NOT_FINITE = Rule(
    "physx.finite",
    "error",
    "the simulation crashed, hung or went to infinity within 5 s",
    "look for bodies inside one another (`trials.overlap`), tiny inertias, starts outside the "
    "limits, and speed limits of joints that mimic others (`velocity: unlimited`)",
)
ARTICULATION = Rule(
    "physx.articulation",
    ("error", "warning"),
    "there is not exactly one articulation (a warning for a foreign USD)",
    "check that a variant is selected, and that there is one articulation root",
)
LOOSE_BODY = Rule(
    "physx.loose_body",
    ("error", "warning"),
    "a body is outside the articulation (a warning for a foreign USD)",
    "attach it to the robot by a joint",
)
FREE_FALL = Rule(
    "physx.free_fall",
    ("warning", "error"),
    "the robot does not fall by g/2 t (t + dt/N) (an error above 5 %)",
    "check whether a body is damped or welded",
)


class PhysxCheck(StageCheck):
    """Base of the checks that ask PhysX."""

    usual_s = 30.0
    requires: ClassVar[Mapping[str, str]] = {"ovphysx": "physx", "physx_usd_schemas": "physx"}
    isolated: ClassVar[bool] = True
    preload = ("pxr.Usd", "pxr.UsdGeom", "pxr.UsdPhysics", "pxr.UsdShade")
    limits: ClassVar[Limits] = Limits(wall_s=900.0, memory_mb=16384)
    engines: ClassVar[tuple[str, ...]] = ("physx",)
    engine: ClassVar[str] = "PhysX"

    @staticmethod
    def start(job: dict[str, object], folder: Path, seconds: float) -> str:
        """Do a job by our own Python, with all of its packages."""
        path = os.pathsep.join(os.path.abspath(p) for p in sys.path if p)  # noqa: PTH100
        return ask(Path(sys.executable), _PROGRAM, job, folder, seconds, {"PYTHONPATH": path})[1]
