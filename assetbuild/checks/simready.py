"""Does the USD meet NVIDIA's SimReady profile of robots, or of grippers?

The validator is NVIDIA's own, in an environment of its own, for its OpenUSD clashes with ours.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from assetbuild.engine.step import Files, Limits
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import write_figures
from assetbuild.simulators.consumers import ConsumerCheck
from assetbuild.simulators.environments import Environment

BEYOND_IMPORTS = ("assetbuild.simulators._simready_child",)
VERSION = "3.0.0"
DRAWN_LATER = ("SR.002",)
"""The thumbnail: it is a picture of the report, which is drawn beside the checks."""

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


class SimReady(ConsumerCheck):
    """Robot-Gripper for what `usd.robot_type` calls an end effector, else Robot-Body."""

    needs: ClassVar[tuple[str, ...]] = ("usd",)
    reads: ClassVar[tuple[str, ...]] = ()
    consumer: ClassVar[str] = "simready"
    limits: ClassVar[Limits] = Limits(wall_s=600.0)
    home: ClassVar[Environment] = Environment(
        "simready",
        ("simready-validate==2026.8.0", "simready-foundation-tier-core==2026.8.0"),
    )
    told: ClassVar[Mapping[str, str]] = {"robot_type": "usd.robot_type"}

    robot_type: str | None = None

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: the profile, and its features met, of how many."""
        profile = "Robot-Gripper" if self.robot_type == "End Effector" else "Robot-Body"
        file = (files.inputs / f"usd/{self.robot}.usda").absolute()
        job: dict[str, object] = {"file": str(file), "profile": profile, "version": VERSION}
        answer, failure = self.answer("_simready_child.py", job)
        found = (answer or {}).get("features")
        features = found if isinstance(found, dict) else {}
        yield from judged(features, profile, failure)
        met = sum(_is_met(feature) for feature in features.values())
        write_figures(files, {"profile": f"{profile} {VERSION}", "met": met, "of": len(features)})


def _is_met(feature: Mapping[str, Any]) -> bool:
    failing = _codes(feature.get("failing requirements", ""))
    return bool(feature["passed"]) or (bool(failing) and set(failing) <= set(DRAWN_LATER))


def judged(
    features: Mapping[str, Mapping[str, Any]], profile: str, failure: str = ""
) -> Iterator[Finding]:
    """One error for each requirement that is not met, one line for all optional features.

    features: none where the validator gave no result; failure: how it failed, where it did.
    """
    if not features:
        yield NO_RESULT("robot", f"no result for {profile} {VERSION}: {failure or 'no feature'}")
    missing = {}
    for name, feature in sorted(features.items()):
        if feature["passed"]:
            continue
        if not feature["blocking_failure"]:
            missing[name] = _codes(feature.get("optional requirements", ""))
            continue
        messages = json.loads(feature.get("requirement_messages") or "{}")
        for code in _codes(feature.get("failing requirements", "")) or (name,):
            if code in DRAWN_LATER:
                continue
            said: list[str] = messages.get(f"com.nvidia.simready.{code}", [])
            told = " ".join(said) or f"feature {name} fails"
            yield REQUIRED(
                "robot",
                f"{profile} {VERSION}: {code}: {told}",
                hint="state what is missing in the recipe's `about`, or `license` under `source`",
                data={"feature": name, "requirement": code},
            )
    if missing:
        listed = ", ".join(f"{name} ({', '.join(codes)})" for name, codes in missing.items())
        yield OPTIONAL(
            "robot",
            f"{profile} {VERSION}: {len(missing)} of {len(features)} features, all optional, are "
            f"not there: {listed}",
            data={"features": len(missing)},
        )


def _codes(text: str) -> tuple[str, ...]:
    """`['com.nvidia.simready.SR.004']` -> `SR.004`."""
    words = (word.strip(" []'") for word in text.split(","))
    return tuple(word.removeprefix("com.nvidia.simready.") for word in words if word)
