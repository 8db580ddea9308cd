"""Three engines, one robot: a table from the reports of bundles; `docs/reference/measured.md` sums.

    python -m tests.benchmarks.engines BUNDLE... > engines.md

Build each bundle with `validate: {simulators: [mujoco, physx], smoke: [newton, isaaclab, simready,
asset_validator]}`. Of PhysX only the verdict is printed: its licence forbids figures in public.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

Row = Mapping[str, Any]  # Any: JSON of a report
ORDER = ("ok", "told", "warning", "error")
STATIC = "of it"
"""Unit of a row that compares one number of the robot, and no motion."""

HEAD = """# Three engines, one robot

MuJoCo runs the MJCF of a bundle, Newton and PhysX run its USD, Isaac Lab 3 its module on both.
`python -m tests.benchmarks.engines BUNDLE...` prints this page. The
bundles are built with `validate: {simulators: [mujoco, physx], smoke: [newton, isaaclab, simready,
asset_validator]}`; `docs/reference/simready.md` says why a feature is not there.

A cell with a number counts what differs: facts that an engine reads back otherwise, or failures
of the validator. *Rows off*: rows of the checks `newton_alignment` and `alignment` with a warning
or an error. *Past a limit*: how much further than in MuJoCo a joint runs past its limit in Newton,
at most. Of PhysX the page states verdicts alone, because its licence forbids figures in public.

"""
SUMMARY = (
    "robot", "Newton reads USD, MJCF", "PhysX reads USD", "Isaac Lab 3: Newton, PhysX",
    "asset validator", "SimReady", "Newton: rows off", "PhysX: rows off", "past a limit",
)  # fmt: skip
BELOW = """
Below, each line is one row about motion, or one that is off; of the bodies or joints that share a
row, it shows the one that is furthest apart in Newton. `told` is a figure without a limit.
"""


def rows_of(report: Mapping[str, Any], check: str) -> Sequence[Row]:
    """The rows of one check, none where it did not run."""
    figures = report["checks"].get(check, {}).get("figures") or {}
    return tuple(figures.get("rows", ()))


def worst(rows: Sequence[Row]) -> Row:
    """The row with the hardest verdict; among equals, the one furthest apart."""
    return max(rows, key=lambda row: (ORDER.index(row["verdict"]), row["off"] or 0.0))


def shown(value: float | str | None) -> str:
    """Four significant digits; no value is a dash."""
    if value is None:
        return "-"
    return value.replace("|", "/") if isinstance(value, str) else f"{value:.4g}"


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


def table(report: Mapping[str, Any]) -> Iterator[str]:
    """The lines of one robot: a heading, and each row in the order of the report."""
    newton = rows_of(report, "newton_alignment")
    physx = rows_of(report, "alignment")
    yield f"\n## {report['robot']}\n"
    yield "| row | of | MuJoCo | Newton | apart | unit | Newton | PhysX |"
    yield "|---|---|---|---|---|---|---|---|"
    for name in sorted({row["row"] for row in newton}):
        row = worst([each for each in newton if each["row"] == name])
        if row["unit"] == STATIC and row["verdict"] == "ok":
            continue
        theirs = [each for each in physx if each["row"] == name]
        verdict = worst(theirs)["verdict"] if theirs else "-"
        unit = "; ".join(part for part in (row["unit"], row.get("because", "")) if part)
        cells = (row["of"], *(shown(row[key]) for key in ("mujoco", "newton", "off")), unit)
        yield f"| `{name}` | {' | '.join(cells)} | {row['verdict']} | {verdict} |"


def main(bundles: Sequence[str]) -> int:
    """Print the page of the bundles, in the order of the command line."""
    reports = [json.loads((Path(bundle) / "report/report.json").read_text()) for bundle in bundles]
    print(HEAD, end="")
    print(f"| {' | '.join(SUMMARY)} |\n|{'---|' * len(SUMMARY)}")
    print("\n".join(map(overview, reports)))
    print(BELOW, end="")
    for report in reports:
        print("\n".join(table(report)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
