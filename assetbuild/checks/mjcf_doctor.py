"""mjcf-doctor's opinion of the scene (extra `lint`): short simulations, soft contacts, masks."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from typing import ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule, Severity
from assetbuild.kinds import Check, write_figures

BEYOND_IMPORTS = ("mjcf_doctor",)
LEVELS: dict[str, Severity] = {"ERROR": "error", "WARN": "warning", "INFO": "info"}

FOUND = Rule(
    "doctor.*",
    ("info", "warning", "error"),
    "what mjcf-doctor reports, with its codes and severities (`validate.linters: [mjcf_doctor]`)",
    "`mjcf-doctor check -v mjcf/scene.xml` explains it",
)
BROKEN = Rule("doctor.broken", "warning", "mjcf-doctor gave no report", "read its own message")


class MjcfDoctor(Check):
    """Findings `doctor.<code>`: its codes, its words."""

    listed_in = "validate.linters"
    isolated = True
    needs = ("mjcf",)
    reads = ()
    requires: ClassVar = {"mjcf_doctor": "lint"}

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads `mjcf/scene.xml`; a doctor that breaks is a finding, not a failed build."""
        command = [sys.executable, "-m", "mjcf_doctor", "check", "scene.xml", "--json", "-q"]
        done = subprocess.run(
            command, cwd=files.inputs / "mjcf", capture_output=True, text=True, check=False
        )
        findings = _findings(done.stdout)
        write_figures(files, {"findings": len(findings or ())})
        if findings is None:
            yield BROKEN(
                "robot",
                f"mjcf-doctor gave no report (exit {done.returncode})",
                hint=done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "",
            )
            return
        for found in findings:
            yield FOUND.named(found["code"])(
                "robot",
                f"mjcf-doctor: {found['subject']}: {found['message']}",
                severity=LEVELS.get(found["level"], "info"),
            )


def _findings(text: str) -> list[dict[str, str]] | None:
    """The JSON that follows its page for people; None when there is none."""
    start = 0 if text.startswith("[\n") else text.find("\n[\n")
    try:
        return [dict(f) for f in json.loads(text[start:])[0]["findings"]] if start >= 0 else None
    except (ValueError, LookupError, TypeError):
        return None
