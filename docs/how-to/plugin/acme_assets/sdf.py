"""SDF: the bodies of the robot, for Gazebo."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar
from xml.etree import ElementTree

from pydantic import Field

from assetbuild.engine.step import Files
from assetbuild.findings import Finding
from assetbuild.plugin_types import Target
from assetbuild.recipe_types import Model
from assetbuild.robot.files import RobotFiles


class SdfOptions(Model):
    """What only Gazebo knows of: `sdf` in a recipe."""

    static: bool = Field(False, description="the model never moves")


class Sdf(Target):
    """Writes `sdf/<robot>.sdf`."""

    outputs = ("sdf/",)
    reads = ("tree.json",)
    sections: ClassVar = {"sdf": "options"}

    options: SdfOptions = SdfOptions()

    def run(self, files: Files) -> Iterator[Finding]:
        """One `<link>` with its mass for every body."""
        root = ElementTree.Element("sdf", version="1.10")
        model = ElementTree.SubElement(root, "model", name=self.robot)
        ElementTree.SubElement(model, "static").text = str(self.options.static).lower()
        for body in RobotFiles(files.inputs).tree.bodies:
            inertial = ElementTree.SubElement(
                ElementTree.SubElement(model, "link", name=body.name), "inertial"
            )
            mass = body.inertial.mass_kg if body.inertial else 0.0
            ElementTree.SubElement(inertial, "mass").text = repr(mass)
        folder = files.outputs / "sdf"
        folder.mkdir()
        ElementTree.ElementTree(root).write(folder / f"{self.robot}.sdf", encoding="unicode")
        yield from ()
