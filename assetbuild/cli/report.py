"""`assetbuild report`: the verdict and findings of a bundle."""

from __future__ import annotations

import argparse
import sys
import webbrowser
from collections.abc import Iterator

from assetbuild.cli.summary import every_finding_line, shown_report
from assetbuild.engine.world import World
from assetbuild.errors import UsageError
from assetbuild.rendering.plan import renderer
from assetbuild.rendering.render import draw_all
from assetbuild.report.bundle import read_json
from assetbuild.report.document import Report, report_of
from assetbuild.report.verdict import verdict_rows


def run(arguments: argparse.Namespace) -> int:
    """Print verdict, checks and findings; 0 when ready for training, else 1."""
    name = "report/report.json"
    try:
        report = shown_report(report_of(read_json(arguments.bundle, name)))
    except (KeyError, TypeError, ValueError, AttributeError):
        message = f"{arguments.bundle / name}: not a report"
        raise UsageError(message, hint="build the bundle again") from None
    print("\n".join(_lines(report)))
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
    return 0 if report.verdict.ready else 1


def _lines(report: Report) -> Iterator[str]:
    """The verdict, then the checks, then the findings."""
    yield f"{report.robot}: ready for training: {'yes' if report.verdict.ready else 'no'}"
    yield from (f"  {part}: {sentence}" for part, sentence in verdict_rows(report.verdict))
    for name, check in report.checks.items():
        yield f"  {check.status:4}  {name}  {check.note}".rstrip()
    yield from every_finding_line(report.findings)
