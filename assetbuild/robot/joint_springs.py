"""Springs of joints, which an MJCF states and no other format of the build holds."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree

from assetbuild.robot.model import MjcfOnly

WORDS = ("stiffness", "springref")


def joint_springs(items: Iterable[MjcfOnly]) -> dict[str, str]:
    """The stiffness of each joint with a spring, as the MJCF states it: N m/rad or N/m; three
    numbers are a polynomial.
    """
    found = {}
    for item in items:
        if item.place == "joint":
            element = ElementTree.fromstring(item.element)  # noqa: S314 # our own reader wrote it
            stiffness = element.get("stiffness", "")
            if any(float(number) for number in stiffness.split()):
                found[item.owner] = stiffness
    return found


def shown(springs: dict[str, str]) -> str:
    """`knee` (30), `ankle` (5), ..."""
    names = [f"`{joint}` ({stiffness})" for joint, stiffness in springs.items()]
    return ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
