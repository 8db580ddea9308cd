"""`python/<robot>_isaaclab_2.py`, `_3.py` and `_measure.py`, read by their syntax trees.

Isaac Lab counts in SI and rad; delays are in simulation steps, `max_angular_velocity` is in deg/s.
Quaternions are wxyz in 2.x and xyzw in 3.x, and each generation has its own fields for limits; see
docs/reference/isaaclab.md. What the module for 3.x says again are words `isaaclab 3:...`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from assetbuild.facts.reader import Reader
from assetbuild.facts.readers.isaaclab.config import read_config as read_config
from assetbuild.facts.readers.isaaclab.config import read_module
from assetbuild.facts.readers.isaaclab.expected import expected_module, expected_script
from assetbuild.facts.readers.isaaclab.said import FORM, GENERATIONS, said_by
from assetbuild.facts.reference import Reference
from assetbuild.facts.statements import put_words
from assetbuild.facts.syntax import Module
from assetbuild.facts.table import Table, Writer
from assetbuild.facts.trainers import Names
from assetbuild.simulators.usd_names import body_identifiers, joint_identifiers

IN_USD = "stands in the USD"


class IsaacLabReader(Reader):
    """Reads the modules for Isaac Lab back and compares them with the robot."""

    form: ClassVar[str] = FORM
    called: ClassVar[str] = "Isaac Lab's modules"
    needs: ClassVar[tuple[str, ...]] = ("isaaclab",)
    folder: ClassVar[str] = "python"
    behind: ClassVar[tuple[str, ...]] = ("python/*_isaaclab_?.py", "python/*_isaaclab_measure.py")
    asks: ClassVar[tuple[str, ...]] = ("isaaclab", "usd", "randomize")
    lacks: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("body", "frame", "loop", "shape", "pair", "sensor", "camera"), IN_USD),
        "keyframe": "Isaac Lab starts in one pose: quantity `start`",
        "floor": "the environment brings its own",
        "robot base": IN_USD,
        "robot base pose": "quantity `start pose`: Isaac Lab puts a fixed root there too",
        "robot articulation root": IN_USD,
        "robot up axis": IN_USD,
        "robot metres per unit": IN_USD,
        "robot kilograms per unit": IN_USD,
        **dict.fromkeys(
            (
                "joint type", "joint body", "joint parent", "joint anchor", "joint axis",
                "joint lower", "joint upper", "joint stiffness", "joint spring reference",
                "joint mimics", "joint mimic multiplier", "joint mimic offset",
            ),
            IN_USD,
        ),
        "joint gear": "Isaac Lab's drives act on the joint itself",
        "joint command range": "Isaac Lab has none",
        "joint drive parameters": "Isaac Lab has no form of a general drive",
        "joint drive name": "Isaac Lab names drives by their joints",
        "joint drive target": "Isaac Lab aims at the start",
        "simulation integrator": "MuJoCo's alone",
        "simulation cone": "MuJoCo's alone",
        "simulation solver": "MuJoCo's alone",
        "simulation iterations": "MuJoCo's alone",
        "simulation line search iterations": "MuJoCo's alone",
        "simulation impratio": "MuJoCo's alone",
    }  # fmt: skip

    def file(self, root: Path, robot: str) -> Path | None:
        """The module for 2.x; the others lie beside it."""
        found = sorted(root.glob("*_isaaclab_2.py"))
        return found[0] if found else root / f"{robot}_isaaclab_2.py"

    def found(self, path: Path, reference: Reference) -> Table:
        """Patterns are those of the robot's bodies and joints as the USD names them."""
        tree = reference.tree
        joints = joint_identifiers(tree)
        moving = {joints[joint.name]: joint.name for joint in tree.moving_joints}
        bodies = {there: own for own, there in body_identifiers(tree).items()}
        return _table(path, Names(bodies, moving)).only(self.holds)

    def expected(self, reference: Reference) -> Table:
        """What Isaac Lab must be told of this robot."""
        book = Writer()
        for generation in GENERATIONS:
            said_by(generation, expected_module(reference, self.robot, generation), book)
        put_words(expected_script(reference, self.robot), FORM, book, part="measure")
        return book.table()

    def read(self, path: Path) -> Table:
        """The facts of all modules, by the names that they write out.

        UsageError where one is missing or no Python.
        """
        return _table(path, Names())


def _table(path: Path, names: Names) -> Table:
    book = Writer()
    for generation in GENERATIONS:
        module = Module.of_file(_beside(path, str(generation)))
        said_by(generation, read_module(module, generation, names), book)
    put_words(Module.of_file(_beside(path, "measure")), FORM, book, part="measure")
    return book.table()


def _beside(path: Path, kind: str) -> Path:
    return path.with_name(path.name.replace("_isaaclab_2", f"_isaaclab_{kind}"))
