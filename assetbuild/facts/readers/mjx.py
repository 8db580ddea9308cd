"""`mjcf/<robot>_mjx.xml`: the robot with what is cheap on a GPU."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from assetbuild.facts.mjcf import LACKS, MjcfReader
from assetbuild.facts.mjcf_expected import mjcf_table, solver_facts
from assetbuild.facts.reference import Reference
from assetbuild.facts.table import Table
from assetbuild.robot.model import Contact
from assetbuild.robot.shapes import Mesh

DEFAULTS = {"iterations": 20, "ls_iterations": 50, "cone": "elliptic"}
"""Defaults of the recipe's `mjx`, for a bundle that does not state them."""


class MjxFacts(MjcfReader):
    """Every fact of the robot, but for contacts and solver, which the recipe's `mjx` decides."""

    needs = ("mjx",)
    form = "mjx"
    called = "the mjx model"
    folder = "mjcf"
    behind = ("mjcf/{robot}_mjx.xml", "mjcf/assets/*")
    asks = ("mjx",)
    lacks = LACKS

    def file(self, root: Path, robot: str) -> Path | None:
        """Where the target is built."""
        path = root / f"{robot}_mjx.xml"
        return path if path.is_file() else None

    def expected(self, reference: Reference) -> Table:
        """The robot that `mjx` leaves: what touches, and how."""
        cheap = _cheap(reference)
        options = {**reference.options, "mjx": {**DEFAULTS, **(reference.options.get("mjx") or {})}}
        cheap = replace(cheap, options=options)
        table = Table({**mjcf_table(cheap).facts, **solver_facts(cheap, "mjx")})
        return self.complete(table, cheap)

    def found(self, path: Path, reference: Reference) -> Table:
        """As of that robot."""
        return super().found(path, _cheap(reference))


def _cheap(reference: Reference) -> Reference:
    """Only the links of `touching` collide; without self-collision only with the world."""
    said = reference.options.get("mjx") or {}
    touching, most = said.get("touching", ".*"), said.get("condim")
    meets = bool(said.get("self_collision", False))
    shapes, control = reference.shapes, reference.control
    gone = {s.name for s in shapes.of("collision") if not re.fullmatch(touching, s.link)}
    kept = tuple(shape for shape in shapes.shapes if shape.name not in gone)
    used = {s.geometry.mesh for s in kept if isinstance(s.geometry, Mesh)}

    def cheap(contact: Contact) -> Contact:
        changed = {"condim": min(contact.condim, most or contact.condim)}
        return contact.model_copy(update=changed if meets else changed | {"mask": 0})

    sensors = tuple(s for s in control.sensors if s.at.kind != "shape" or s.at.name not in gone)
    only = tuple(
        item for item in control.mjcf_only
        if item.place != "option" and not (item.place == "shape" and item.owner in gone)
    )  # fmt: skip
    control = replace(
        control,
        contact=cheap(control.contact),
        contacts=tuple((n, cheap(c)) for n, c in control.contacts if n not in gone),
        excludes=control.excludes if meets else (),
        sensors=sensors,
        mjcf_only=only,
    )
    meshes = tuple(mesh for mesh in shapes.meshes if mesh.name in used)
    return replace(reference, shapes=replace(shapes, shapes=kept, meshes=meshes), control=control)
