"""What was measured: fitted parameters with their intervals, measured beside simulated motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from assetbuild.report.tables import Table, table
from assetbuild.robot.identify import Curve, Curves, Fit

WIDTH, HEIGHT, PAD = 900, 150, 34
"""Of a plot, in units of its view box: size, and the margin on the left."""


@dataclass(frozen=True)
class Plot:
    """One joint. lines: (name, points, colour, width); held: where the held-out part begins."""

    text: str
    lines: tuple[tuple[str, str, str, float], ...]
    held: str


@dataclass(frozen=True)
class IdentifiedEntry:
    """One entry of `identify`. known, of: parameters that are identified, and all."""

    known: int
    of: int
    tables: tuple[Table, ...]
    plots: tuple[Plot, ...]


def identified(fit: Fit, curves: Curves) -> IdentifiedEntry:
    """Tables and plots of what the logs showed."""
    known = sum(not p.refused for p in fit.parameters)
    plots = tuple(map(_plot, curves.curves))
    return IdentifiedEntry(known, len(fit.parameters), tuple(_tables(fit)), plots)


def _tables(fit: Fit) -> Iterator[Table]:
    yield table(
        "Parameters",
        ("parameter", "value", "low", "high", "prior", "unit", "verdict"),
        [
            (p.label, None if p.refused else p.value, p.low, p.high, p.prior, p.unit,
             p.refused or "identified")
            for p in fit.parameters
        ],
        "low, high: 95 % interval from the fitted part",
    )  # fmt: skip
    yield table(
        "Residuals",
        ("joint", "fitted part", "held out, priors", "held out, identified"),
        [(p.joint, p.fitted, p.before, p.after) for p in fit.predictions],
        "RMS of measured minus simulated position, rad or m",
    )
    yield table(
        "Logs",
        ("log", "fitted, s", "held out, s", "samples, Hz", "sha256"),
        [(log.file, log.seconds, log.held_s, log.rate_hz, log.sha256) for log in fit.logs],
        f"condition of the scaled Fisher information: {fit.condition:.4g}",
    )
    if fit.related:
        yield table(
            "Correlated parameters",
            ("of", "and", "correlation"),
            [(r.a, r.b, r.correlation) for r in fit.related],
            "parameters whose estimates depend on one another; above 0.99 both are refused",
        )


def _plot(curve: Curve) -> Plot:
    values = [*curve.measured, *curve.after]
    low, high, end = min(values), max(values), max(curve.time_s[-1], 1e-9)
    span = max(high - low, 1e-9)

    def points(series: Sequence[float]) -> str:
        inside = [min(max(v, low - 0.1 * span), high + 0.1 * span) for v in series]
        return " ".join(
            f"{PAD + t / end * (WIDTH - PAD):.1f},"
            f"{HEIGHT - 18 - (v - low) / span * (HEIGHT - 36):.1f}"
            for t, v in zip(curve.time_s, inside, strict=True)
        )

    text = (
        f"{curve.joint}: position over {end:.4g} s, {low:.3g} to {high:.3g}; measured (dark), "
        "simulated with the priors (orange) and as identified (blue); right of the line: held out"
    )
    lines = (
        ("measured", points(curve.measured), "text", 2.4),
        ("priors", points(curve.before), "warn", 1.0),
        ("identified", points(curve.after), "link", 1.2),
    )
    return Plot(text, lines, f"{PAD + curve.held_from_s / end * (WIDTH - PAD):.1f}")
