"""mjcf-doctor's opinion of the scene (extra `lint`): short simulations, soft contacts, masks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import ClassVar

from assetbuild.findings import Finding, Rule
from assetbuild.simulators.foreign import ForeignTool, severity_of

BEYOND_IMPORTS = ("mjcf_doctor",)

FOUND = Rule(
    "doctor.*",
    ("info", "warning", "error"),
    "what mjcf-doctor reports, with its codes and severities (`validate.linters: [mjcf_doctor]`)",
    "`mjcf-doctor check -v mjcf/scene.xml` explains it",
)
BROKEN = Rule("doctor.broken", "warning", "mjcf-doctor gave no report", "read its own message")


class MjcfDoctor(ForeignTool):
    """Findings `doctor.<code>`: its codes, its words."""

    listed_in = "validate.linters"
    isolated = True
    needs = ("mjcf",)
    requires: ClassVar = {"mjcf_doctor": "lint"}
    no_report = BROKEN

    words = ("-m", "mjcf_doctor", "check", "scene.xml", "--json", "-q")

    def judge(self, report: str, figures: dict[str, object]) -> Iterator[Finding]:
        """The report stands after a page for people."""
        (file,) = json.loads(report[f"\n{report}".index("\n[\n") :])
        figures["findings"] = len(file["findings"])
        for found in file["findings"]:
            yield FOUND.named(found["code"])(
                "robot",
                f"mjcf-doctor: {found['subject']}: {found['message']}",
                severity=severity_of(found["level"]),
            )
