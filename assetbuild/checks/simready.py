"""Does the USD meet NVIDIA's SimReady profile of robots, or of grippers?"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

from assetbuild.findings import Finding, Rule
from assetbuild.simulators.consumers import Environment
from assetbuild.simulators.foreign import REPORT, Validator

VERSION = "3.0.0"
DRAWN_LATER = ("SR.002",)
"""The thumbnail: it is a picture of the report, which is drawn beside the checks."""
Feature = dict[str, Any]  # Any: foreign JSON

REQUIRED = Rule(
    "simready.required",
    "error",
    "a requirement of the SimReady profile is not met",
    "the message is the validator's; metadata come from the recipe's `about` and `license`",
)
OPTIONAL = Rule(
    "simready.optional",
    "info",
    "optional features of the SimReady profile are not there",
    "docs/reference/simready.md says why, feature by feature",
)
NO_RESULT = Rule(
    "simready.no_result", "error", "SimReady's validator gave no result", "read its own message"
)


class SimReady(Validator):
    """Robot-Gripper for what `usd.robot_type` calls an end effector, else Robot-Body."""

    consumer: ClassVar[str] = "simready"
    home: ClassVar[Environment] = Environment(
        "simready", ("simready-validate==2026.8.0", "simready-foundation-tier-core==2026.8.0")
    )
    told: ClassVar[Mapping[str, str]] = {"robot_type": "usd.robot_type"}
    no_report = NO_RESULT
    # Its command line has no module of its own.
    words = (
        "-c", "from simready.validate._cli import main; main()", "--profile", "{tool.profile}",
        "--version", VERSION, "--output", REPORT, "{tool.robot}.usda",
    )  # fmt: skip

    robot_type: str | None = None

    @property
    def profile(self) -> str:
        """Of SimReady's, the one that the robot must meet."""
        return "Robot-Gripper" if self.robot_type == "End Effector" else "Robot-Body"

    def judge(self, report: str, figures: dict[str, object]) -> Iterator[Finding]:
        """One error for each requirement that is not met, one line for all optional features."""
        (result,) = json.loads(report).values()
        features: dict[str, Feature] = result["features_summary"]
        if not features:
            raise LookupError("no feature")
        missing, met = [], 0
        for name, feature in sorted(features.items()):
            lacking = () if feature["passed"] else _lacking(name, feature)
            met += not lacking
            if lacking and not feature["blocking_failure"]:
                missing.append(f"{name} ({', '.join(lacking)})")
            elif lacking:
                yield from self._required(name, feature, lacking)
        figures |= {"profile": f"{self.profile} {VERSION}", "met": met, "of": len(features)}
        if missing:
            yield OPTIONAL(
                "robot",
                f"{self.profile} {VERSION}: {len(missing)} of {len(features)} features, all "
                f"optional, are not there: {', '.join(missing)}",
                data={"features": len(missing)},
            )

    def _required(self, name: str, feature: Feature, codes: Sequence[str]) -> Iterator[Finding]:
        messages = json.loads(feature.get("requirement_messages") or "{}")
        for code in codes:
            said = " ".join(messages.get(f"com.nvidia.simready.{code}", []))
            yield REQUIRED(
                "robot",
                f"{self.profile} {VERSION}: {code}: {said or f'feature {name} fails'}",
                hint="state what is missing in the recipe's `about`, or `license` under `source`",
                data={"feature": name, "requirement": code},
            )


def _lacking(name: str, feature: Feature) -> tuple[str, ...]:
    """Codes of what a feature lacks, its own name where it does not say what."""
    key = "failing requirements" if feature["blocking_failure"] else "optional requirements"
    codes = _codes(feature.get(key, "")) or (name,)
    return tuple(code for code in codes if code not in DRAWN_LATER)


def _codes(text: str) -> tuple[str, ...]:
    """`['com.nvidia.simready.SR.004']` -> `SR.004`."""
    words = (word.strip(" []'") for word in text.split(","))
    return tuple(word.removeprefix("com.nvidia.simready.") for word in words if word)
