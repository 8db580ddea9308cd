"""Numbers in a USD that OpenUSD's validators take and engines repair in silence or refuse."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from assetbuild.body.inertia_rules import MASS, mass_findings
from assetbuild.body.lint import crossed_limits
from assetbuild.facts.table import Table
from assetbuild.findings import Finding
from assetbuild.robot.inertia import InertiaBounds
from assetbuild.robot.model import Inertial, Joint, JointKind, Limits


def lint_numbers(table: Table) -> Iterator[Finding]:
    """Tensors that no matter has, and limits the wrong way round, by the rules of a URDF's links.

    A mass or tensor of 0 is not stated: engines compute it from the shapes.
    """
    for name in table.names("body"):
        facts: Any = table.of("body", name)  # Any: a number and a tensor, as the reader has them
        mass, tensor = facts["mass"], facts.get("inertia", (0.0,) * 6)
        if not all(map(math.isfinite, (mass, *tensor))):
            yield MASS(f"link {name}", "its mass or its inertia is not a finite number")
        elif mass and any(tensor):
            inertial = Inertial(mass, (0.0, 0.0, 0.0), tensor)
            judged = mass_findings(f"link {name}", inertial, InertiaBounds(), "error")
            yield from (finding for finding in judged if finding.severity == "error")
    for name in table.names("joint"):
        facts = table.of("joint", name)
        limits = Limits(facts.get("lower"), facts.get("upper"))
        kind: JointKind = "prismatic" if facts.get("type") == "linear" else "revolute"
        yield from crossed_limits(Joint(name, kind, "", "", limits=limits), "error")
