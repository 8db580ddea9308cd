"""simcheck's opinion of the MJCF (extra `lint`): files, inertias, geometry, joints."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from typing import Any, ClassVar

from assetbuild.engine.step import Files, Limits
from assetbuild.findings import Finding, Rule, Severity
from assetbuild.kinds import Check, write_figures

BEYOND_IMPORTS = ("simcheck",)
LEVELS: dict[str, Severity] = {"error": "error", "warning": "warning", "info": "info"}

FOUND = Rule(
    "simcheck.*",
    ("info", "warning", "error"),
    "what simcheck reports, with its checks and severities (`validate.linters: [simcheck]`)",
    "`simcheck explain CHECK`",
)
BROKEN = Rule("simcheck.broken", "warning", "simcheck gave no report", "read its own message")


class Simcheck(Check):
    """Findings `simcheck.<category>.<check>`. Its engines are left off: ours simulate already."""

    usual_s = 30.0
    listed_in = "validate.linters"
    isolated = True
    needs = ("mjcf",)
    reads = ()
    requires: ClassVar = {"simcheck": "lint"}
    limits = Limits(wall_s=1200.0, memory_mb=4096)

    robot: str

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `mjcf/<robot>.xml`; a linter that breaks is a finding, not a failed build."""
        command = [
            sys.executable, "-m", "simcheck", "check", f"{self.robot}.xml", "--json", "-",
            "--static-only", "--no-config", "--robot", "--quiet", "--fail-on", "never",
        ]  # fmt: skip
        done = subprocess.run(
            command, cwd=files.inputs / "mjcf", capture_output=True, text=True, check=False
        )
        results = _results(done.stdout)
        passed = sum(result["status"] == "pass" for result in results)
        write_figures(files, {"checks": len(results), "passed": passed})
        if not results:
            yield BROKEN(
                "robot",
                f"simcheck gave no report (exit {done.returncode})",
                hint=done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "",
            )
        for result in results:
            for found in result["findings"]:
                yield FOUND.named(result["id"])(
                    "robot",
                    f"simcheck: {found['message']}",
                    severity=LEVELS.get(found["severity"], "info"),
                    data={"target": str(found.get("target", ""))},
                )


def _results(text: str) -> list[dict[str, Any]]:  # Any: foreign JSON
    try:
        return list(json.loads(text[text.index("{") :])["results"])
    except (ValueError, KeyError, TypeError):
        return []
