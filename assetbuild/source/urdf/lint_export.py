"""Did a CAD program write this URDF, and what does its export leave behind?

SolidWorks (sw2urdf) writes a package: `urdf/<robot>.urdf` with a comment at the top, the table
`urdf/<robot>.csv` that the URDF was made from, `config/joint_names_<robot>.yaml`. Onshape
(onshape-to-robot) leaves a comment. What else they leave (limits of 0, no mass, no collision, a
density of 1000 kg/m3, a flipped axis) the lints of links, joints and densities find in any URDF.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Mapping

from pydantic import Field

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding, Rule
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Body, Inertial, Tree

HEAD = 4096
"""Bytes at the top in which the exporters' comments stand."""
SAME = 1e-3
"""Relative: the table and the URDF round differently."""

_VERSION = re.compile(rb"Commit Version:\s*(\S+)")
_ONSHAPE = re.compile(rb"onshape-to-robot")
_NAMES = re.compile(r"controller_joint_names:\s*\[([^\]]*)\]")
_CENTRE = tuple(f"Center of Mass {axis}" for axis in "XYZ")
_MOMENTS = ("Moment Ixx", "Moment Iyy", "Moment Izz", "Moment Ixy", "Moment Ixz", "Moment Iyz")

SOLIDWORKS = Rule(
    "export.solidworks",
    "info",
    "SolidWorks' exporter wrote the file",
    "look at the findings beside it",
)
ONSHAPE = Rule(
    "export.onshape", "info", "onshape-to-robot wrote the file", "check effort and velocity"
)
TABLE = Rule(
    "export.table",
    ("warning", "info"),
    "mass, centre of mass or inertia differ from the exporter's table (info: the link has no row "
    "there)",
    "`set_inertia`, `set_mass`",
)
JOINT_NAMES = Rule(
    "export.joint_names",
    "warning",
    "the exporter's list names a joint that does not exist",
    "correct the list",
)
LIMITS_ALIKE = Rule(
    "export.limits_alike",
    "warning",
    "an exporter's file gives every joint the same effort and velocity",
    "give the limits of each motor in the actuator table",
)


class LintExport(Step):
    """`robot.urdf`, `links.json` and, where they lie beside, `table.csv` and `joint_names.yaml`.

    Findings only. table, names: paths of the two in the source, for the words of the findings.
    """

    table: str = ""
    names: str = ""
    least_alike: int = Field(3, ge=2)
    """So many moving joints with one effort and velocity: a number that nobody chose."""

    def run(self, files: Files) -> Iterator[Finding]:
        """What wrote it; where its table differs; names that fit no joint; limits all alike."""
        head = (files.inputs / "robot.urdf").read_bytes()[:HEAD]
        tree = RobotFiles(files.inputs).links
        written = _exporter(head, self.table, self.names)
        if written is None:
            return
        yield written
        if self.table:
            yield from self._table((files.inputs / "table.csv").read_bytes(), tree)
        if self.names:
            yield from self._joint_names((files.inputs / "joint_names.yaml").read_bytes(), tree)
        yield from self._alike(tree)

    def _table(self, data: bytes, tree: Tree) -> Iterator[Finding]:
        rows = _rows(data)
        for body in tree.bodies:
            row = rows.get(body.name)
            if row is None:
                message = f"has no row in {self.table}"
                hint = (
                    "was the URDF edited after the export? the table tells what came from the CAD"
                )
                yield TABLE(f"link {body.name}", message, hint, severity="info")
            else:
                yield from _differences(body, row, self.table)

    def _joint_names(self, data: bytes, tree: Tree) -> Iterator[Finding]:
        match = _NAMES.search(data.decode("utf-8", "replace"))
        listed = [name.strip(" '\"\n") for name in match[1].split(",")] if match else []
        for name in filter(None, listed):
            if name not in tree.by_joint:
                yield JOINT_NAMES(
                    "robot",
                    f"{self.names} names a joint `{name}` that the URDF does not have",
                    "export again, or correct the list: controllers look for it",
                    data={"joint": name},
                )

    def _alike(self, tree: Tree) -> Iterator[Finding]:
        joints = [joint for joint in tree.moving_joints if joint.mimic is None]
        stated = {(joint.limits.effort, joint.limits.velocity) for joint in joints}
        if len(joints) < self.least_alike or len(stated) != 1:
            return
        ((effort, velocity),) = stated
        if effort and velocity:
            yield LIMITS_ALIKE(
                "robot",
                f"all {len(joints)} joints have effort {effort:g} and velocity {velocity:g}: what "
                "an exporter writes where nobody stated them?",
                "give the motors' own in the recipe's actuator table, or by the edit `set_limits`",
                data={
                    "effort": effort,
                    "velocity": velocity,
                    "joints": len(joints),
                    "joint_names": tuple(joint.name for joint in joints),
                    "missing": ("effort", "velocity"),
                },
            )


def _exporter(head: bytes, table: str, names: str) -> Finding | None:
    signs = [sign for sign in (table, names) if sign]
    solidworks = b"SolidWorks to URDF Exporter" in head
    if solidworks or signs:
        version = _VERSION.search(head) if solidworks else None
        told = f" {version[1].decode('ascii', 'replace')}" if version else ""
        seen = ", ".join((["its comment"] if solidworks else []) + signs)
        return SOLIDWORKS(
            "robot",
            f"written by SolidWorks' URDF exporter{told} (by {seen})",
            "it writes limits of 0, the default density and guessed axes where the CAD says no "
            "more: see the findings beside this one",
            data={"version": told.strip(), "signs": tuple(signs)},
        )
    if _ONSHAPE.search(head):
        return ONSHAPE(
            "robot",
            "written by onshape-to-robot (by its comment)",
            "effort and velocity are its configuration's, not the motors'",
        )
    return None


# --- the table ------------------------------------------------------------------------------


def _rows(data: bytes) -> dict[str, dict[str, str]]:
    """Each link as the CAD weighed it, by its name."""
    rows = csv.DictReader(io.StringIO(data.decode("utf-8-sig", "replace")))
    named = (((row.get("Link Name") or "").strip(), row) for row in rows)
    return {name: row for name, row in named if name}


def _number(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _differences(body: Body, row: Mapping[str, str], table: str) -> Iterator[Finding]:
    """Mass, centre and moments, each against the largest number of its kind."""
    inertial = body.inertial or Inertial(0.0, (0.0, 0.0, 0.0), (0.0,) * 6)
    for what, unit, ours, columns in (
        ("mass", "kg", (inertial.mass_kg,), ("Mass",)),
        ("centre of mass", "m", inertial.com_m, _CENTRE),
        ("inertia", "kg m2", inertial.inertia_com_kg_m2, _MOMENTS),
    ):
        numbers = (_number(row.get(column)) for column in columns)
        stated = tuple(value for value in numbers if value is not None)
        if len(stated) != len(columns):
            continue
        size = max(map(abs, (*ours, *stated)))
        if max(abs(a - b) for a, b in zip(ours, stated, strict=True)) > SAME * size:
            yield TABLE(
                f"link {body.name}",
                f"{what}: {_shown(ours)} {unit} in the URDF, {_shown(stated)} {unit} in {table}",
                "the table is what the CAD weighed: was the URDF edited on purpose? "
                "else take its numbers by `set_inertia` or `set_mass`",
                data={"urdf": ours, "table": stated, "what": what},
            )


def _shown(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.4g}" for value in values)
