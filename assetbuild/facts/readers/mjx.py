"""`mjcf/<robot>_mjx.xml`: the robot with what is cheap on a GPU."""

from __future__ import annotations

import re
from dataclasses import replace

from assetbuild.facts.mjcf import MjcfReader
from assetbuild.facts.reference import Reference
from assetbuild.robot.model import Contact

DEFAULTS = {"iterations": 20, "ls_iterations": 50, "cone": "elliptic", "tolerance": 1e-8}
"""Defaults of the recipe's `mjx`, for a bundle that does not state them."""


class MjxFacts(MjcfReader):
    """Every fact of the robot, but for contacts and solver, which the recipe's `mjx` decides."""

    needs = ("mjx",)
    format_id = "mjx"
    display_name = "the mjx model"
    file_globs = ("mjcf/{robot}_mjx.xml", "mjcf/assets/*")
    written = "{robot}_mjx.xml"
    recipe_sections = ("mjx",)
    solver = "mjx"

    def robot_of(self, reference: Reference) -> Reference:
        """Only the links of `touching` collide; without self-collision only with the world."""
        settings = {**DEFAULTS, **(reference.options.get("mjx") or {})}
        options = {**reference.options, "mjx": settings}
        touching, most = settings.get("touching", ".*"), settings.get("condim")
        meets = bool(settings.get("self_collision", False))
        shapes, control = reference.shapes, reference.control
        gone = {s.name for s in shapes.of("collision") if not re.fullmatch(touching, s.link)}
        kept = tuple(shape for shape in shapes.shapes if shape.name not in gone)

        def cheap(contact: Contact) -> Contact:
            changed = {"condim": min(contact.condim, most or contact.condim)}
            return contact.model_copy(update=changed if meets else changed | {"contype": 0})

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
        shapes = replace(shapes, shapes=kept)
        return replace(reference, shapes=shapes, control=control, options=options)
