"""The table of docs/reference/library.md, from bundles that lie there already.

assetbuild build recipes/*.yaml
python -m tests.benchmarks.library build/* > docs/reference/library.md
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

PUBLISHED = Path(__file__).parents[2] / "docs" / "reference" / "published.yaml"
VALUES = ("kp", "kd", "armature", "effort")
HEAD = """\
# The library of robots

![The robots of the library](../images/library.png)

Robots of the public package example-robot-data (the rover is made up), each with its recipe.
Built by `assetbuild build recipes/*.yaml`; this page by
`python -m tests.benchmarks.library build/*`, its picture by
`python -m tests.benchmarks.gallery build/* -o docs/images/library.png`.

Grade: MuJoCo Menagerie's, as the model card derives it. Where the numbers of the actuator table
come from stands in each recipe, motor by motor; "limits": the description's limits, nothing else.

| robot | moving joints | mass, kg | checks | errors, warnings | grade | licence | numbers from |
| --- | --- | --- | --- | --- | --- | --- | --- |
"""
BESIDE = """
## Beside what others publish

Their value over ours, least and most over the joints; 1 = the same. Our gains hold the robot at
`home`; theirs are often made for learning. Theirs are in [published.yaml](published.yaml).

| robot | source | kp | kd | armature | effort |
| --- | --- | --- | --- | --- | --- |
"""


def main(bundles: list[Path]) -> None:
    """Print the page; folders without a report are left out."""
    found = [bundle for bundle in sorted(bundles) if (bundle / "report/report.json").exists()]
    print(HEAD, end="")
    for bundle in found:
        print(row(bundle))
    print(BESIDE, end="")
    published = yaml.safe_load(PUBLISHED.read_text(encoding="utf-8"))
    for bundle in found:
        drives = actuators(bundle)
        for source, rows in published.get(bundle.name, {}).items():
            cells = [ratios(drives, rows, value) for value in VALUES]
            print(f"| {bundle.name} | {source} | {' | '.join(cells)} |")


def row(bundle: Path) -> str:
    """One line of the first table."""
    report = json.loads((bundle / "report/report.json").read_text(encoding="utf-8"))
    card = (bundle / "model_card.md").read_text(encoding="utf-8")
    status = [check["status"] for check in report["checks"].values()]
    severities = [finding["severity"] for finding in report["findings"]]
    sources = {a["source"] for a in actuators(bundle)}
    cells = [
        bundle.name,
        cell(card, "moving joints"),
        f"{float(cell(card, 'total mass, kg')):.2f}",
        f"{status.count('pass')} of {len(status) - status.count('skip')}",
        f"{severities.count('error')}, {severities.count('warning')}",
        grade(card),
        cell(card, "licence"),
        "limits" if all("limit" in s and ";" not in s for s in sources) else "see the recipe",
    ]
    return f"| {' | '.join(cells)} |"


def grade(card: str) -> str:
    """Return the grade that the model card states."""
    found = re.search(r"from the evidence of this build: (\S+)", card)
    return found[1] if found else "-"


def cell(card: str, name: str) -> str:
    """The value beside a name in the model card's tables."""
    found = re.search(rf"^\| {re.escape(name)} \| (.*) \|$", card, re.MULTILINE)
    return found[1] if found else "-"


def actuators(bundle: Path) -> list[dict[str, Any]]:
    """The robot's actuator table, passive joints left out."""
    robot = json.loads((bundle / "report/robot.json").read_text(encoding="utf-8"))
    return [a for a in robot["control"]["actuators"] if a["model"] != "passive"]


def ratios(drives: list[dict[str, Any]], rows: list[dict[str, Any]], value: str) -> str:
    """Least and most of theirs over ours; a dash where one of both has none."""
    found = list(_ratios(drives, rows, value))
    if not found:
        return "-"
    low, high = min(found), max(found)
    return f"{low:.2g}" if high - low < 0.005 * high else f"{low:.2g} to {high:.2g}"


def _ratios(
    drives: list[dict[str, Any]], rows: list[dict[str, Any]], value: str
) -> Iterator[float]:
    for drive in drives:
        theirs = next((r for r in rows if re.fullmatch(r["joints"], drive["joint"])), {})
        if theirs.get(value) and drive[value]:
            yield theirs[value] / drive[value]


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
