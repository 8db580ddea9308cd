"""`assetbuild report`: the verdict and findings of a bundle."""

from __future__ import annotations

import argparse
import sys
import webbrowser
from collections.abc import Iterator, Mapping
from typing import Any

from assetbuild.cli.summary import every_finding_line, shown_figures
from assetbuild.engine.world import World
from assetbuild.errors import UsageError
from assetbuild.findings import finding_from_json
from assetbuild.rendering.plan import renderer
from assetbuild.rendering.render import draw_all
from assetbuild.report.bundle import read_json


def run(arguments: argparse.Namespace) -> int:
    """Print verdict, checks and findings; 0 when ready for training, else 1."""
    name = "report/report.json"
    report = read_json(arguments.bundle, name)
    try:
        lines = list(_lines(report))
    except (KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"{arguments.bundle / name}: not a report: {error!r}") from None
    print("\n".join(lines))
    if arguments.pictures:
        scene = arguments.bundle / "mjcf" / "scene.xml"
        if not scene.is_file():
            raise UsageError(f"no `{scene}` to draw", hint="build the target `mjcf`")
        draw_all(scene, arguments.pictures, renderer(World()))
        print(f"pictures: {arguments.pictures}", file=sys.stderr)
    if arguments.open:
        page = (arguments.bundle / "report" / "index.html").resolve()
        if not webbrowser.open(page.as_uri()):
            print(f"no browser found; open {page}", file=sys.stderr)
    return 0 if report["verdict"]["ready"] else 1


def _lines(report: Mapping[str, Any]) -> Iterator[str]:  # Any: JSON
    """The verdict, then the checks, then the findings."""
    verdict = report["verdict"]
    yield f"{report['robot']}: ready for training: {'yes' if verdict['ready'] else 'no'}"
    for part in ("formats", "physics"):  # bundles of older versions have neither
        if part in verdict:
            status, sentence = verdict[part]["status"], verdict[part]["sentence"]
            shown = sentence if sentence.startswith(status) else f"{status}: {sentence}"
            yield f"  {part}: {shown}"
    for name, trainer in verdict.get("trainers", {}).items():
        figures = trainer["status"] != "not tried"
        sentence = shown_figures(name, trainer["sentence"]) if figures else trainer["sentence"]
        yield f"  trainers: {name}: {trainer['status']}: {sentence}"
    for name, check in report["checks"].items():
        yield f"  {check['status']:4}  {name}  {check.get('note', '')}".rstrip()
    yield from every_finding_line([finding_from_json(raw) for raw in report["findings"]])
