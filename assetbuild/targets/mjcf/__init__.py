"""MJCF as a maintainer of MuJoCo Menagerie would write it: `<robot>.xml`, `scene.xml`, assets.

The grammar is MuJoCo 3.11's; every newer version loads it too. Numbers are shortest exact texts.
Mass, centre of mass and inertia stand on every body, so no geom and no mesh adds any.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import Target
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.simulators.mujoco import body_names
from assetbuild.targets.mjcf.chains import explain_chains
from assetbuild.targets.mjcf.drives import explain_losses
from assetbuild.targets.mjcf.files import (
    copy_assets,
    explain_looks,
    explain_textures,
    one_per_look,
    refuse_name,
    unreadable_textures,
    without_textures,
    write_xml,
)
from assetbuild.targets.mjcf.opaque import with_opaque
from assetbuild.targets.mjcf.options import MjcfOptions
from assetbuild.targets.mjcf.robot_xml import RobotXml, Solver
from assetbuild.targets.mjcf.scene import scene

RESERVED_NAME = Rule(
    "mjcf.reserved_name", "info", "a body called `world` was renamed", "rename the link"
)
PLANAR_JOINT = Rule(
    "mjcf.planar_joint",
    "info",
    "a planar joint became two slides and a hinge, without limits",
    "nothing",
)


class Mjcf(Target):
    """Writes `mjcf/<robot>.xml`, `mjcf/scene.xml` and `mjcf/assets/`."""

    version = "10"
    outputs = ("mjcf/",)
    reads = ("tree.json", "shapes.json", "control.json", "meshes/")

    sections: ClassVar[Mapping[str, str]] = {"mjcf": "options"}

    options: MjcfOptions = MjcfOptions()
    """cone None: elliptic for a floating base (feet slip less), else MuJoCo's default;
    impratio None: 100 with an elliptic cone, as Menagerie's legged robots have, else MuJoCo's 1."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises StepError for joints and actuators that MJCF cannot say."""
        refuse_name(self.robot)
        robot = RobotFiles(files.inputs)
        tree, shapes, control = robot.tree, robot.shapes, robot.control

        without = unreadable_textures(shapes, robot.mesh_dir)
        plain = without_textures(shapes, without)
        shapes = one_per_look(plain)
        folder = files.outputs / "mjcf"
        model = RobotXml(self.robot, self._solver(tree), tree, shapes, control)
        root = with_opaque(model.element(), control.mjcf_only, model.body_names)
        write_xml(folder / f"{self.robot}.xml", root)
        write_xml(
            folder / "scene.xml", scene(self.robot, self.robot, tree, control, model.free_name)
        )
        copy_assets(robot.mesh_dir, folder / "assets", shapes)
        yield from _explain_names(tree)
        yield from _explain_planar(tree)
        yield from explain_chains(tree, shapes)
        yield from explain_looks(plain, shapes)
        yield from explain_textures(without)
        yield from explain_losses(tree, control)

    def _solver(self, tree: Tree) -> Solver:
        said = self.options
        cone = said.cone or ("elliptic" if tree.base == "floating" else "pyramidal")
        impratio = said.impratio or (100.0 if cone == "elliptic" else 1.0)
        return Solver(
            said.integrator, cone, impratio, said.solver, said.iterations, said.ls_iterations
        )


def _explain_names(tree: Tree) -> Iterator[Finding]:
    for name, written in body_names(tree).items():
        if name != written:
            yield RESERVED_NAME(
                f"link {name}",
                f"MuJoCo keeps the name `{name}` for itself: the body is called `{written}`",
                hint="rename the link in the source if other tools look for it",
            )


def _explain_planar(tree: Tree) -> Iterator[Finding]:
    for joint in tree.joints:
        if joint.kind == "planar":
            yield PLANAR_JOINT(
                f"joint {joint.name}",
                "MJCF has no planar joint: it becomes two slides and a hinge without limits",
            )
