"""What a policy's action asks of a position drive."""

from __future__ import annotations

from pydantic import Field

from assetbuild.quantities import Model, Positive


class Action(Model):
    """How far one unit of a policy's action moves a joint's target."""

    effort_share: Positive = Field(
        0.25, description="share of the error in position that asks for the whole effort"
    )
    rad: Positive = Field(
        0.5,
        description="rad; most for a joint that turns: an `effort` that is a placeholder would "
        "else ask for whole turns",
    )
    m: Positive = Field(0.05, description="m; most for a joint that slides")

    def scale(self, effort: float | None, kp: float, *, slides: bool) -> float:
        """rad or m of a joint's target for one unit of action. effort: N m or N; kp: per rad or m.

        A quarter of the error that asks for the whole effort is what mjlab's own robots have.
        """
        most = self.m if slides else self.rad
        if effort is None or kp <= 0.0:
            return most
        return min(self.effort_share * effort / kp, most)
