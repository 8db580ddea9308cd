"""Did a CAD program write this URDF, and did anybody state its motors' limits?

What else exporters leave (limits of 0, no mass, a density of 1000 kg/m3, a flipped axis) the lints
of links, joints and densities find in any URDF.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from assetbuild.findings import Finding, Rule
from assetbuild.robot.model import Tree

HEAD = 4096
"""Bytes at the top in which the exporters' comments stand."""
LEAST_ALIKE = 3
"""So many moving joints with one effort and velocity: a number that nobody chose."""

SOLIDWORKS = Rule(
    "export.solidworks",
    "info",
    "SolidWorks' URDF exporter wrote the file (by its comment)",
    "it writes limits of 0, the default density and guessed axes where the CAD states none: see "
    "the findings beside this one",
)
ONSHAPE = Rule(
    "export.onshape",
    "info",
    "onshape-to-robot wrote the file (by its comment)",
    "effort and velocity are its configuration's, not the motors'",
)
LIMITS_ALIKE = Rule(
    "export.limits_alike",
    "warning",
    "an exporter's file gives every joint the same effort and velocity",
    "give the motors' own in the recipe's actuator table, or by the edit `set_limits`",
)
EXPORTERS = {rb"SolidWorks to URDF Exporter": SOLIDWORKS, rb"onshape-to-robot": ONSHAPE}


def exporter_findings(urdf: bytes, tree: Tree) -> Iterator[Finding]:
    """What wrote the file, and whether its limits are all alike."""
    written = [rule for words, rule in EXPORTERS.items() if re.search(words, urdf[:HEAD])]
    yield from (rule("robot", rule.meaning, rule.remedy) for rule in written[:1])
    joints = [joint for joint in tree.moving_joints if joint.mimic is None]
    stated = {(joint.limits.effort, joint.limits.velocity) for joint in joints}
    if written and len(joints) >= LEAST_ALIKE and len(stated) == 1 and all(*stated):
        ((effort, velocity),) = stated
        yield LIMITS_ALIKE(
            "robot",
            f"all {len(joints)} joints have effort {effort:g} and velocity {velocity:g}: what "
            "an exporter writes where nobody stated them?",
            LIMITS_ALIKE.remedy,
            data={
                "effort": effort,
                "velocity": velocity,
                "joints": len(joints),
                "joint_names": tuple(joint.name for joint in joints),
                "missing": ("effort", "velocity"),
            },
        )
