"""Does urdfdom, the reader of ROS and pinocchio, take the written URDF?"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Check, write_figures

REFUSED = Rule(
    "urdf.refused",
    "error",
    "urdfdom refuses the written URDF, and with it ROS, MoveIt and pinocchio",
    "this is a fault of assetbuild: please report it with the recipe",
)


class UrdfLoads(Check):
    """pinocchio reads the file through urdfdom, which is stricter than yourdfpy.

    Figure: the joints that pinocchio finds.
    """

    isolated: ClassVar = True
    # With the other checks of MuJoCo in one process; pinocchio alone is not worth a second one.
    preload: ClassVar = ("mujoco",)
    imports: ClassVar = ("pinocchio",)
    needs: ClassVar = ("urdf",)
    reads: ClassVar = ()
    requires: ClassVar = {"pinocchio": "oracle"}

    robot: str

    def run(self, files: Files) -> Iterator[Finding]:
        """One finding with urdfdom's own words."""
        joints, message = loaded(files.inputs / "urdf" / f"{self.robot}.urdf")
        write_figures(files, {"joints": joints})
        if joints is None:
            yield REFUSED("robot", f"urdfdom does not read the URDF: {message}")


def loaded(path: Path) -> tuple[int | None, str]:
    """The joints that move, or None and what urdfdom says, which it writes to stderr."""
    import pinocchio

    with tempfile.TemporaryFile() as log:
        stderr = os.dup(2)
        os.dup2(log.fileno(), 2)
        try:
            return int(pinocchio.buildModelFromUrdf(str(path)).njoints) - 1, ""
        except (ValueError, RuntimeError) as error:
            log.seek(0)
            lines = log.read().decode("utf-8", "replace").splitlines()
            words = [line.removeprefix("Error:").strip() for line in lines if "Error:" in line]
            return None, "; ".join(words) or str(error)
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
