"""Three engines, one robot: the table `docs/reference/engines.md`, from the reports of bundles.

    python -m tests.benchmarks.engines BUNDLE... > docs/reference/engines.md

Build each bundle with `validate: {simulators: [mujoco, physx], smoke: [newton]}`. Of PhysX only
the verdict is printed: its licence forbids figures in public.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

Row = Mapping[str, Any]  # Any: JSON of a report
ORDER = ("ok", "told", "warning", "error")

HEAD = """# Three engines, one robot

MuJoCo runs the MJCF of a bundle, Newton and PhysX run its USD. Each line is one row of the checks
`newton_alignment` and `alignment`; of the bodies or joints that share a row, it shows the one that
is furthest apart in Newton. `told` is a figure without a limit. Of PhysX the page states the
verdict alone, because its licence forbids figures in public.

`python -m tests.benchmarks.engines BUNDLE... > docs/reference/engines.md` writes this page. The
bundles are built with `validate: {simulators: [mujoco, physx], smoke: [newton]}`.
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


def table(report: Mapping[str, Any]) -> Iterator[str]:
    """The lines of one robot: a heading, and each row in the order of the report."""
    newton = rows_of(report, "newton_alignment")
    physx = rows_of(report, "alignment")
    off = [row for row in newton if row["verdict"] in ("warning", "error")]
    yield f"\n## {report['robot']}\n"
    yield f"Newton: {len(newton)} rows, {len(off)} off.\n"
    yield "| row | of | MuJoCo | Newton | apart | unit | Newton | PhysX |"
    yield "|---|---|---|---|---|---|---|---|"
    for name in sorted({row["row"] for row in newton}):
        row = worst([each for each in newton if each["row"] == name])
        theirs = [each for each in physx if each["row"] == name]
        verdict = worst(theirs)["verdict"] if theirs else "-"
        unit = "; ".join(part for part in (row["unit"], row.get("because", "")) if part)
        cells = (row["of"], *(shown(row[key]) for key in ("mujoco", "newton", "off")), unit)
        yield f"| `{name}` | {' | '.join(cells)} | {row['verdict']} | {verdict} |"


def main(bundles: Sequence[str]) -> int:
    """Print the page of the bundles, in the order of the command line."""
    print(HEAD, end="")
    for bundle in bundles:
        report = json.loads((Path(bundle) / "report/report.json").read_text())
        print("\n".join(table(report)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
