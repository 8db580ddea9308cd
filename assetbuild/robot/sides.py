"""Who decides what in a robot: its source or its recipe, for each of the robots of a composite."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from pydantic import BaseModel, ConfigDict


class Side(BaseModel):
    """One robot of a composite; a robot without parts has one side, itself.

    prefix: of all its names, "" of the base. from_mjcf: its source says what drives it, how it
    stands and what its surfaces are, where its recipe is silent. stated: keys that the recipe
    states against that, such as `simulation.timestep`. adjacent: bodies on the two sides of a
    joint never touch. keeps: the bodies of the source stay as they are.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    prefix: str = ""
    from_mjcf: bool = False
    stated: tuple[str, ...] = ()
    adjacent: bool = True
    keeps: bool = False

    @property
    def drives_itself(self) -> bool:
        """Whether its source says what drives its joints."""
        return self.from_mjcf and "actuators" not in self.stated


def side_of(sides: Sequence[Side], name: str) -> Side:
    """The robot that a name belongs to; the base is the first."""
    return next((s for s in sides[1:] if name.startswith(s.prefix)), sides[0])


def moving_by_source(sides: Sequence[Side], joints: Iterable[str]) -> frozenset[str]:
    """Joints that no row of an actuator table has to match."""
    return frozenset(joint for joint in joints if side_of(sides, joint).drives_itself)
