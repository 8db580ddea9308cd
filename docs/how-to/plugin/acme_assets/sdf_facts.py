"""What an SDF of ours says of the robot."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from defusedxml import ElementTree

from assetbuild.facts.reader import Reader, all_but
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key, Table


class SdfFacts(Reader):
    """The mass of every body, and whether the model moves."""

    needs: ClassVar = ("sdf",)
    format_id: ClassVar = "sdf"
    display_name: ClassVar = "the SDF"
    folder: ClassVar = "sdf"
    file_globs: ClassVar = ("sdf/{robot}.sdf",)
    recipe_sections: ClassVar = ("sdf",)
    lacks: ClassVar = all_but(["body mass"], "our SDF holds masses alone")

    def read(self, path: Path) -> Table:
        """Masses by link; every other element is a word of SDF."""
        facts = Table()
        for element in ElementTree.parse(path).getroot().iter():
            if element.tag == "link":
                mass = float(element.findtext("inertial/mass") or "nan")
                facts.put("body", str(element.get("name")), {"mass": mass})
            elif element.tag not in ("sdf", "model", "inertial", "mass"):
                facts.put("robot", "", {f"sdf:{element.tag}": element.text or "empty"})
        return facts

    def expected(self, reference: Reference) -> Table:
        """The robot's masses, and the recipe's `sdf`."""
        facts = dict(robot_table(reference).only(self.holds).facts)
        static = bool(self.options.get("sdf", {}).get("static", False))
        return Table({**facts, Key("robot", "", "sdf:static"): str(static).lower()})
