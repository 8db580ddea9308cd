"""SimReady's validator judges a USD: runs in its environment, without assetbuild."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path


def answer(job: dict[str, str]) -> dict[str, object]:
    """The features of the profile, as the validator reports them."""
    report = Path("report.json")
    # The validator resolves links, and would find the layers outside of the asset's folder.
    copy = Path(shutil.copytree(Path(job["file"]).parent, "usd"))
    words = ["--profile", job["profile"], "--version", job["version"], "--output", str(report)]
    program = [sys.executable, "-P", "-c", "from simready.validate._cli import main; main()"]
    done = subprocess.run(
        [*program, *words, str(copy / Path(job["file"]).name)],
        capture_output=True,
        text=True,
        check=False,
    )
    if not report.exists():
        lines = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
        raise SystemExit(lines[-1] if lines else f"simready-validate ended with {done.returncode}")
    (result,) = json.loads(report.read_text(encoding="utf-8")).values()
    return {"features": result["features_summary"]}
