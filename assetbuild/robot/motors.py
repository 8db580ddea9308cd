"""Motors of the recipe, and how a table says that it does not fit the robot."""

from __future__ import annotations

from collections.abc import Mapping

from assetbuild.errors import RecipeError, did_you_mean
from assetbuild.robot.actuator_table import Motor

Key = tuple[str | int, ...]


class RowError(RecipeError):
    """A table of the recipe does not fit the robot.

    key: the place in the recipe, as a path; steps know no lines.
    """

    def __init__(self, message: str, *, key: Key, hint: str = "") -> None:
        super().__init__(message, hint=hint)
        self.key = key

    @property
    def index(self) -> int | None:
        """The row of the actuator table; None when the error is about the table as a whole."""
        numbers = [part for part in self.key[1:2] if isinstance(part, int)]
        return numbers[0] if numbers else None

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (self.message, self.key, self.hint)


def _rebuild(message: str, key: Key, hint: str) -> RowError:
    return RowError(message, key=key, hint=hint)


def extended(name: str, motors: Mapping[str, Motor]) -> Motor:
    """A motor with what it does not say taken from the one it extends, and so on.

    Raises RowError for a parent that is not there, or a circle.
    """
    chain = [name]
    motor = motors[name]
    while motor.extends is not None:
        parent, key = motor.extends, ("motors", chain[-1], "extends")
        if parent not in motors:
            message = f"motors.{chain[-1]}: no motor named `{parent}`"
            raise RowError(message, key=key, hint=did_you_mean(parent, motors))
        if parent in chain:
            circle = " -> ".join((*chain, parent))
            raise RowError(f"motors extend each other in a circle: {circle}", key=key)
        chain.append(parent)
        above = motors[parent]
        own = {k: v for k, v in motor if v not in (None, "") and k != "extends"}
        motor = above.model_copy(update=own)
    return motor
