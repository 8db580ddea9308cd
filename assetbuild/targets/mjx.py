"""The MJCF for MJX and mujoco_warp: the same robot, with what is cheap on a GPU.

Bodies, joints, coordinates, drives, sensors and keyframes are those of `<robot>.xml`. The recipe
states under `mjx` what differs: solver options, which links touch anything, whether parts of the
robot touch one another (else masks let only the world meet it), how many dimensions a contact and
how many corners a hull has.
`mjx_pairs` proves that both engines know every pair that is left.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import ClassVar, Literal

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import Target
from assetbuild.recipe_types import Model, Pattern, Positive
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Contact, Control
from assetbuild.robot.shapes import Mesh, Shapes
from assetbuild.targets.mjcf.files import (
    readable,
    refuse_name,
    robot_element,
    write_robot,
    write_xml,
)
from assetbuild.targets.mjcf.robot_xml import Cone, MjcfOptions, RobotXml
from assetbuild.targets.mjcf.scene import scene

UNTOUCHABLE = Rule(
    "mjx.collision_disabled",
    "info",
    "links have no collision in the mjx model, as `mjx.touching` asks",
    "nothing",
)
CONDIM = Rule(
    "mjx.condim",
    "info",
    "contacts of the mjx model have fewer dimensions, as `mjx.condim` asks",
    "nothing",
)
HULL = Rule(
    "mjx.hull",
    "info",
    "collision meshes of the mjx model are hulls with few vertices",
    "`method: primitive` is faster and exact",
)


class MjxOptions(Model):
    """Solver options of the model for MJX and mujoco_warp: `<robot>_mjx.xml`."""

    integrator: Literal["Euler", "RK4", "implicitfast"] = Field(
        "implicitfast", description="`implicit` does not run on MJX"
    )
    cone: Cone = Field(
        "elliptic", description="of friction; pyramidal with 4 iterations is faster, and feet slide"
    )
    impratio: Positive | None = Field(
        None, description="frictional to normal impedance; without it 50 with an elliptic cone"
    )
    solver: Literal["Newton", "CG"] = Field("Newton", description="of the constraints")
    iterations: int = Field(20, ge=1, le=10_000, description="of the solver, at most")
    ls_iterations: int = Field(50, ge=1, le=10_000, description="of its line search")
    tolerance: Positive = Field(
        1e-8, description="improvement at which the solver stops; float32 does not reach less"
    )
    self_collision: bool = Field(
        False, description="parts of the robot touch one another; else only the world (masks)"
    )
    condim: Literal[1, 3, 4, 6] | None = Field(
        None,
        description="most dimensions of a contact, 3 = without twisting and rolling friction: on a "
        "pyramidal cone a contact has 10 rows with 6, 4 with 3; without it as in `contact`",
    )
    max_vertices: int = Field(
        64, ge=4, le=1000, description="most vertices of a convex collision mesh; more is an error"
    )
    touching: Pattern = Field(
        ".*", description="links that touch anything; the collision of all others is left out"
    )


class Mjx(Target):
    """Writes `<robot>_mjx.xml`, `scene_mjx.xml` and their assets beside the full MJCF."""

    shares = True
    outputs = ("mjx/",)
    folder = "mjcf"
    reads = ("tree.json", "shapes.json", "control.json", "meshes/")

    sections: ClassVar[Mapping[str, str]] = {"mjx": "options"}

    options: MjxOptions = MjxOptions()

    def run(self, files: Files) -> Iterator[Finding]:
        """Raises StepError for joints and actuators that MJCF cannot say."""
        refuse_name(self.robot)
        robot = RobotFiles(files.inputs)
        tree, shapes, control = robot.tree, robot.shapes, robot.control.in_mjcf
        meshes = robot.mesh_dir
        left_out, shapes = self._touching(readable(shapes, meshes, control.mjcf_only))
        most_dimensions = max(
            c.condim for c in (control.contact, *(contact for _, contact in control.contacts))
        )
        control = self._masked(control, shapes)
        stem = f"{self.robot}_mjx"
        stated = {key: value for key, value in self.options if key in MjcfOptions.model_fields}
        solver, most = MjcfOptions(**stated), self.options.max_vertices
        model = RobotXml(self.robot, solver, tree, shapes, control, max_vertices=most)
        folder = files.outputs / "mjx"
        there = {shape.name for shape in shapes.shapes}
        opaque = tuple(
            o
            for o in control.mjcf_only
            if o.place != "option" and (o.place != "shape" or o.owner in there)
        )
        write_robot(folder / f"{stem}.xml", robot_element(model, opaque), shapes, meshes)
        write_xml(folder / "scene_mjx.xml", scene(model, stem))
        yield from self._explain(left_out, most_dimensions, model.capped)

    def _touching(self, shapes: Shapes) -> tuple[tuple[str, ...], Shapes]:
        """(links whose collision is left out, the rest)."""
        out = {
            s.name: s.link
            for s in shapes.of("collision")
            if not re.fullmatch(self.options.touching, s.link)
        }
        if out and len(out) == len(shapes.of("collision")):
            raise StepError(
                f"mjx.touching: pattern `{self.options.touching}` leaves no collision shape",
                hint="name the links that stand or grasp, such as `.*_foot`",
            )
        kept = tuple(shape for shape in shapes.shapes if shape.name not in out)
        used = {s.geometry.mesh for s in kept if isinstance(s.geometry, Mesh)}
        meshes = tuple(mesh for mesh in shapes.meshes if mesh.name in used)
        return tuple(dict.fromkeys(out.values())), replace(shapes, shapes=kept, meshes=meshes)

    def _masked(self, control: Control, shapes: Shapes) -> Control:
        """Set contype 0 without self-collision: no shape of the robot looks for another."""
        names = {shape.name for shape in shapes.of("collision")}
        contacts = tuple((n, self._cheap(c)) for n, c in control.contacts if n in names)
        sensors = tuple(s for s in control.sensors if s.at.kind != "shape" or s.at.name in names)
        return replace(
            control,
            contact=self._cheap(control.contact),
            contacts=contacts,
            sensors=sensors,
            excludes=control.excludes if self.options.self_collision else (),
        )

    def _cheap(self, contact: Contact) -> Contact:
        least = min(contact.condim, self.options.condim or contact.condim)
        contype = contact.contype if self.options.self_collision else 0
        return contact.model_copy(update={"condim": least, "contype": contype})

    def _explain(
        self, left_out: tuple[str, ...], most: int, capped: tuple[str, ...]
    ) -> Iterator[Finding]:
        """most: dimensions of a contact in the full model."""
        if self.options.condim is not None and most > self.options.condim:
            yield CONDIM(
                "recipe mjx.condim",
                f"contacts of condim {most} have {self.options.condim} in the mjx model: less "
                "friction against twisting and rolling, fewer rows to solve",
                data={"condim": self.options.condim, "was": most},
            )
        if left_out:
            yield UNTOUCHABLE(
                "recipe mjx.touching",
                f"{len(left_out)} links have no collision in the mjx model",
                data={"links": len(left_out)},
            )
        if capped:
            yield HULL(
                "recipe mjx.max_vertices",
                f"{len(capped)} collision meshes have more corners: MuJoCo takes a hull of "
                f"{self.options.max_vertices} inside each",
                hint="`method: primitive` is faster on a GPU and knows no such loss",
                data={"meshes": capped, "max_vertices": self.options.max_vertices},
            )
