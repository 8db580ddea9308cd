"""`set_limits: {joint, lower, upper, ...}`: limits that the source has wrong."""

from __future__ import annotations

from dataclasses import replace

from pydantic import Field, model_validator

from assetbuild.errors import RecipeError
from assetbuild.findings import Finding, Rule, Scalar
from assetbuild.plugin_types import JointEdit
from assetbuild.recipe_types import Positive, Real
from assetbuild.robot.model import MOVING, Joint

FIELDS = ("lower", "upper", "effort", "velocity")

SET_LIMITS = Rule("edit.set_limits", "info", "a joint has other limits", "nothing")


class SetLimits(JointEdit):
    """What is not given stays. A continuous joint with `lower` and `upper` becomes revolute, a
    revolute one with `unlimited` continuous."""

    lower: Real | None = Field(None, description="rad or m")
    upper: Real | None = Field(None, description="rad or m")
    unlimited: bool = Field(False, description="true: a revolute joint turns without end")
    effort: Positive | None = Field(None, description="N m or N")
    velocity: Positive | None = Field(None, description="rad/s or m/s")

    @model_validator(mode="after")
    def _some(self) -> SetLimits:
        if all(getattr(self, name) is None for name in FIELDS) and not self.unlimited:
            raise ValueError(
                "give at least one of `lower`, `upper`, `unlimited`, `effort`, `velocity`"
            )
        if self.unlimited and (self.lower, self.upper) != (None, None):
            raise ValueError("a joint with `lower` or `upper` is not `unlimited`")
        return self

    def change(self, joint: Joint) -> tuple[Joint, Finding]:
        """See `JointEdit`."""
        if joint.kind not in MOVING:
            raise RecipeError(f"set_limits: joint `{joint.name}` is {joint.kind} and has no limits")
        given = {n: getattr(self, n) for n in FIELDS if getattr(self, n) is not None}
        kind, old, new = joint.kind, joint.limits, replace(joint.limits, **given)
        if self.unlimited:
            if kind == "prismatic":
                raise RecipeError(
                    f"set_limits: joint `{joint.name}` slides: it cannot be unlimited"
                )
            kind, new = "continuous", replace(new, lower=None, upper=None)
        lower, upper = new.lower, new.upper
        stated = bool({"lower", "upper"} & given.keys())
        if stated and lower is not None and upper is not None and lower >= upper:
            raise RecipeError(
                f"set_limits: joint `{joint.name}` would go from {lower:g} to {upper:g}",
                hint="lower must be below upper; what is not given stays",
            )
        if kind == "continuous" and stated:
            if lower is None or upper is None:
                raise RecipeError(
                    f"set_limits: joint `{joint.name}` is continuous: give both `lower` and `upper`"
                )
            kind = "revolute"
        changes = [
            f"{n} {_limit_text(getattr(old, n))} -> {value:.6g}" for n, value in given.items()
        ]
        if kind != joint.kind:
            changes.append(f"{joint.kind} -> {kind}")
        data: dict[str, Scalar | tuple[Scalar, ...]] = {
            "before": tuple(getattr(old, name) for name in FIELDS),
            "after": tuple(getattr(new, name) for name in FIELDS),
            "stated": (*given, *(("lower", "upper") if self.unlimited else ())),
        }
        finding = SET_LIMITS(f"joint {joint.name}", ", ".join(changes), data=data)
        return replace(joint, kind=kind, limits=new), finding


def _limit_text(value: float | None) -> str:
    return "-" if value is None else f"{value:.6g}"
