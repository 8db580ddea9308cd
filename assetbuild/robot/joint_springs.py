"""Springs of joints (`stiffness`, `springref`), as an MJCF states them.

A joint that nothing else drives holds its spring in USD as a drive: k (rest - q) is the law of
both. Beside a drive of its own there is no room: the sum of kp (target - q) and k (rest - q) is
one drive for one target alone, and the drive's limit of effort would hold back the spring.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

from assetbuild.robot.model import Actuator, Control, MjcfOnly

WORDS = ("stiffness", "springref")


@dataclass(frozen=True)
class Spring:
    """coefficients: stiffness in N m/rad or N/m, then those of a polynomial; rest: rad or m."""

    coefficients: tuple[float, ...]
    rest: float = 0.0

    @property
    def stiffness(self) -> float:
        """N m/rad or N/m, of a linear spring and of a polynomial at its rest."""
        return self.coefficients[0]

    @property
    def is_linear(self) -> bool:
        """Whether its force is k (rest - q)."""
        return not any(self.coefficients[1:])

    @property
    def text(self) -> str:
        """The stiffness as the MJCF states it."""
        return " ".join(f"{number:g}" for number in self.coefficients)


def joint_springs(items: Iterable[MjcfOnly]) -> dict[str, Spring]:
    """The springs by the name of their joint."""
    found = {}
    for item in items:
        if item.place == "joint":
            element = ElementTree.fromstring(item.element)  # noqa: S314 # our own reader wrote it
            stiffness = tuple(float(word) for word in element.get("stiffness", "").split())
            if any(stiffness):
                found[item.owner] = Spring(stiffness, float(element.get("springref", "0")))
    return found


def as_drives(control: Control) -> dict[str, Spring]:
    """The springs that a simulator can hold as the drive of their joint."""
    why = no_drives(control)
    return {name: s for name, s in joint_springs(control.mjcf_only).items() if name not in why}


def no_drives(control: Control) -> dict[str, str]:
    """Why a spring cannot be the drive of its joint, by the joint's name."""
    rows, found = control.by_joint, {}
    for name, spring in joint_springs(control.mjcf_only).items():
        if not spring.is_linear:
            found[name] = f"its stiffness is a polynomial ({spring.text})"
        elif _is_driven(rows.get(name)):
            found[name] = f"its joint has a drive of its own (`{rows[name].model}`)"
    return found


def _is_driven(row: Actuator | None) -> bool:
    return row is not None and row.model != "passive"


def shown(springs: Mapping[str, Spring]) -> str:
    """`knee` (30), `ankle` (5), ..."""
    names = [f"`{joint}` ({spring.text})" for joint, spring in springs.items()]
    return ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
