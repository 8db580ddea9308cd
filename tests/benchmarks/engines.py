"""Three engines, one robot: a table from the reports of bundles; `docs/reference/measured.md` sums.

    python -m tests.benchmarks.engines BUNDLE... > engines.md

Build each bundle with `validate: {simulators: [mujoco, physx], smoke: [newton, isaaclab, simready,
asset_validator]}`. Of PhysX only the verdict is printed: its licence forbids figures in public.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

Row = Mapping[str, Any]  # Any: JSON of a report

SUMMARY = (
    "robot", "Newton reads USD, MJCF", "PhysX reads USD", "Isaac Lab 3: Newton, PhysX",
    "asset validator", "SimReady", "Newton: rows off", "PhysX: rows off", "past a limit",
)  # fmt: skip


def rows_of(report: Mapping[str, Any], check: str) -> Sequence[Row]:
    """The rows of one check, none where it did not run."""
    figures = report["checks"].get(check, {}).get("figures") or {}
    return tuple(figures.get("rows", ()))


def differing(report: Mapping[str, Any], check: str, *keys: str) -> str:
    """Numbers of differences that a check counted, by engine or file."""
    figures = report["checks"].get(check, {}).get("figures") or {}
    found = (figures.get(key) for key in keys)
    return ", ".join(
        " ".join((str(f["differences"]), *(f"`{rule}`" for rule in f.get("moved", ()))))
        if isinstance(f, dict)
        else "refused"
        for f in found
    )


def off(rows: Sequence[Row]) -> str:
    """How many rows are off, of how many, and which."""
    bad = [row for row in rows if row["verdict"] in ("warning", "error")]
    names = ", ".join(f"`{name}`" for name in sorted({row["row"] for row in bad}))
    return f"{len(bad)} of {len(rows)}" + (f": {names}" if names else "")


def overview(report: Mapping[str, Any]) -> str:
    """One line of the table at the top."""
    checks = report["checks"]
    simready, validator = (checks[name]["figures"] for name in ("simready", "asset_validator"))
    required = [f for f in report["findings"] if f["rule"] == "simready.required"]
    newton = rows_of(report, "newton_alignment")
    past = [row["off"] or 0.0 for row in newton if row["row"].startswith("past_")]
    units = {row["unit"].split()[0] for row in newton if row["row"].startswith("past_")}
    readback = [f for f in report["findings"] if f["rule"].startswith("equal.physx")]
    cells = (
        report["robot"],
        differing(report, "smoke_newton", "usd", "mjcf"),
        str(len(readback)),
        differing(report, "smoke_isaaclab", "newton", "physx"),
        str(validator["failures"]),
        f"{simready['profile']}: {simready['met']} of {simready['of']} features"
        + "".join(f"; lacks {f['message'].split(': ')[1]}" for f in required),
        off(newton),
        off(rows_of(report, "alignment")),
        f"{max(past):.2g} {' or '.join(sorted(units))}" if past else "none",
    )
    return f"| {' | '.join(cells)} |"


def main(bundles: Sequence[str]) -> int:
    """Print the table of the bundles, in the order of the command line."""
    reports = [json.loads((Path(bundle) / "report/report.json").read_text()) for bundle in bundles]
    print(f"| {' | '.join(SUMMARY)} |\n|{'---|' * len(SUMMARY)}")
    print("\n".join(map(overview, reports)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
