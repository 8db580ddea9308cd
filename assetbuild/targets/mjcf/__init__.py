"""MJCF as a maintainer of MuJoCo Menagerie would write it: `<robot>.xml`, `scene.xml`, assets.

The grammar is MuJoCo 3.11's; every newer version loads it too. Numbers are shortest exact texts.
Mass, centre of mass and inertia stand on every body, so no geom and no mesh adds any.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.errors import quoted
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Target
from assetbuild.robot.chains import Chain
from assetbuild.robot.closure import gaps
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Control, Tree
from assetbuild.simulators.mujoco import body_names
from assetbuild.targets.mjcf.drives import explain_losses
from assetbuild.targets.mjcf.files import (
    explain_textures,
    readable,
    refuse_name,
    robot_element,
    write_robot,
    write_xml,
)
from assetbuild.targets.mjcf.robot_xml import MjcfOptions, RobotXml
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
CHAIN = Rule(
    "mjcf.chain",
    "info",
    "joints with only massless links between them are joints of one body, which is exact",
    "nothing",
)


class Mjcf(Target):
    """Writes `mjcf/<robot>.xml`, `mjcf/scene.xml` and `mjcf/assets/`."""

    shares = True
    outputs = ("mjcf/",)
    reads = ("tree.json", "shapes.json", "control.json", "meshes/")

    sections: ClassVar[Mapping[str, str]] = {"mjcf": "options"}

    options: MjcfOptions = MjcfOptions()
    """cone None: elliptic (feet and fingers slip less);
    impratio None: 50 with an elliptic cone, else MuJoCo's 1."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises StepError for joints and actuators that MJCF cannot say."""
        refuse_name(self.robot)
        robot = RobotFiles(files.inputs)
        tree, shapes, control = robot.tree, robot.shapes, robot.control.in_mjcf

        meshes = files.inputs / "meshes"
        looks = readable(shapes, meshes, control.mjcf_only)
        model = RobotXml(self.robot, self.options, tree, looks, control)
        folder = files.outputs / "mjcf"
        root = robot_element(model, control.mjcf_only)
        write_robot(folder / f"{self.robot}.xml", root, looks, meshes)
        write_xml(folder / "scene.xml", scene(model, self.robot))
        yield from _explain_names(tree)
        yield from _explain_planar(tree)
        yield from _explain_chains(model.rows.values())
        yield from explain_textures(shapes, meshes)
        yield from explain_losses(tree, control)
        yield from explain_loops(tree, control)


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


def _explain_chains(rows: Iterable[Chain]) -> Iterator[Finding]:
    """One finding for each body with several joints."""
    for chain in rows:
        if chain.between:
            joints = ", ".join(joint.name for joint in chain.joints)
            links = ", ".join(chain.between)
            yield CHAIN(
                f"link {chain.body}",
                f"carries {len(chain.joints)} joints ({joints}): the massless links between them "
                f"({links}) are no bodies in the MJCF",
                hint="the motion is exactly the same",
                data={"links": chain.between},
            )


# --- loops ---------------------------------------------------------------------------------------


NEAR_M = 1e-6

OPEN_AT_ZERO = Rule(
    "mjcf.loop_at_zero",
    "warning",
    "a loop does not close where all joints are 0; of an MJCF's loop Newton 1.8 reads one end "
    "alone and takes the other to be there",
    "give Newton the USD, whose loops it reads with both ends",
)


def explain_loops(tree: Tree, control: Control) -> Iterator[Finding]:
    """One finding for all loops that are open in MuJoCo's `qpos0`."""
    at_zero = gaps(tree, control.loops, {joint.name: 0.0 for joint in tree.moving_joints})
    open_loops = {name: gap for name, gap in at_zero.items() if gap > NEAR_M}
    if open_loops:
        gaps_m = {name: f"{gap:.3g} m" for name, gap in open_loops.items()}
        shown = quoted(gaps_m, 4, notes=gaps_m)
        yield OPEN_AT_ZERO(
            "robot",
            f"{len(open_loops)} loops are open where all joints are 0: {shown}; MuJoCo, MJX and "
            "mjlab hold both ends, but Newton 1.8 holds other points of this MJCF",
            "give Newton the USD",
            data=open_loops,
        )
