"""simcheck's opinion of the MJCF (extra `lint`): files, inertias, geometry, joints."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import ClassVar

from assetbuild.engine.step import Limits
from assetbuild.findings import Finding, Rule
from assetbuild.simulators.foreign import ForeignTool, severity_of

BEYOND_IMPORTS = ("simcheck",)

FOUND = Rule(
    "simcheck.*",
    ("info", "warning", "error"),
    "what simcheck reports, with its checks and severities (`validate.linters: [simcheck]`)",
    "`simcheck explain CHECK`",
)
BROKEN = Rule("simcheck.broken", "warning", "simcheck gave no report", "read its own message")


class Simcheck(ForeignTool):
    """Findings `simcheck.<category>.<check>`. Its engines are left off: ours simulate already."""

    usual_s = 30.0
    listed_in = "validate.linters"
    isolated = True
    needs = ("mjcf",)
    requires: ClassVar = {"simcheck": "lint"}
    limits = Limits(wall_s=1200.0, memory_mb=4096)
    no_report = BROKEN

    words = (
        "-m", "simcheck", "check", "{tool.robot}.xml", "--json", "-", "--static-only",
        "--no-config", "--robot", "--quiet", "--fail-on", "never",
    )  # fmt: skip

    def judge(self, report: str, figures: dict[str, object]) -> Iterator[Finding]:
        """Its ids, its severities, its words."""
        results = json.loads(report[report.index("{") :])["results"]
        passed = sum(result["status"] == "pass" for result in results)
        figures |= {"checks": len(results), "passed": passed}
        for result in results:
            for found in result["findings"]:
                yield FOUND.named(result["id"])(
                    "robot",
                    f"simcheck: {found['message']}",
                    severity=severity_of(found["severity"]),
                    data={"target": str(found.get("target", ""))},
                )
