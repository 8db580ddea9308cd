"""NVIDIA's asset validator judges a USD: runs in its environment, without assetbuild."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path


def answer(job: dict[str, str]) -> dict[str, object]:
    """The issues of `file`, as the validator reports them."""
    report = Path("report.json")
    # Which words the other variants have is compared by `usd_equal`; all would take five times.
    words = ["--no-variants", "--json-output", str(report), job["file"]]
    program = [sys.executable, "-P", "-c", "from omni.asset_validator import cli_main; cli_main()"]
    done = subprocess.run([*program, *words], capture_output=True, text=True, check=False)
    if not report.exists():
        lines = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
        raise SystemExit(lines[-1] if lines else f"the validator ended with {done.returncode}")
    rules = json.loads(report.read_text(encoding="utf-8"))["rules"]
    return {"issues": [_plain(issue) for rule in rules for issue in rule["issues"]]}


def _plain(issue: dict) -> dict[str, str]:  # type: ignore[type-arg] # JSON of the validator
    return {
        "rule": (issue.get("rule") or {}).get("name", "validator"),
        "severity": issue["severity"],
        "message": issue["message"],
        "path": (issue.get("at") or {}).get("path", ""),
    }
