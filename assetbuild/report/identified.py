"""What was measured: fitted parameters with their intervals, measured beside simulated motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

from assetbuild.report.tables import Table, html_table, table
from assetbuild.robot.identified import Curve, Curves, Fit

WIDTH, HEIGHT, PAD = 900, 150, 34


def identified_section(fits: Sequence[tuple[Fit, Curves]]) -> str:
    """Tables and pictures of each entry of `identify`; "" without any."""
    return "".join(_entry(fit, curves) for fit, curves in fits)


def _entry(fit: Fit, curves: Curves) -> str:
    known = sum(not p.refused for p in fit.parameters)
    shown = [parameters_table(fit), _predictions(fit), _logs(fit)]
    if fit.related:
        shown.append(_related(fit))
    tables = "".join(f"<h3>{escape(t.title)}</h3>{html_table(t)}" for t in shown)
    plots = "".join(_figure(curve) for curve in curves.curves)
    return (
        f"<p>{known} of {len(fit.parameters)} parameters are identified; those that the logs do "
        f"not show keep their priors.</p>{tables}"
        f"<details><summary>Measured and simulated position of {len(curves.curves)} joints"
        f"</summary>{plots}</details>"
    )


def parameters_table(fit: Fit) -> Table:
    """Each parameter with its 95 % interval."""
    rows = [
        (
            p.label,
            None if p.refused else p.value,
            p.low,
            p.high,
            p.prior,
            p.unit,
            p.refused or "identified",
        )
        for p in fit.parameters
    ]
    head = ("parameter", "value", "low", "high", "prior", "unit", "verdict")
    return table("Parameters", head, rows, "low, high: 95 % interval from the fitted part")


def _predictions(fit: Fit) -> Table:
    rows = [(p.joint, p.fitted, p.before, p.after) for p in fit.predictions]
    head = ("joint", "fitted part", "held out, priors", "held out, identified")
    note = "RMS of measured minus simulated position, rad or m"
    return table("Residuals", head, rows, note)


def _logs(fit: Fit) -> Table:
    rows = [(log.file, log.seconds, log.held_s, log.rate_hz, log.sha256) for log in fit.logs]
    head = ("log", "fitted, s", "held out, s", "samples, Hz", "sha256")
    note = f"condition of the scaled Fisher information: {fit.condition:.4g}"
    return table("Logs", head, rows, note)


def _related(fit: Fit) -> Table:
    rows = [(r.a, r.b, r.correlation) for r in fit.related]
    note = "parameters whose estimates depend on one another; above 0.99 both are refused"
    return table("Correlated parameters", ("of", "and", "correlation"), rows, note)


def _figure(curve: Curve) -> str:
    lines = (
        ("measured", curve.measured, "var(--text)", 2.4),
        ("priors", curve.before, "var(--warn)", 1.0),
        ("identified", curve.after, "var(--link)", 1.2),
    )
    values = [*curve.measured, *curve.after]
    low, high = min(values), max(values)
    span = max(high - low, 1e-9)
    end = max(curve.time_s[-1], 1e-9)

    def points(series: Sequence[float]) -> Iterator[str]:
        for t, v in zip(curve.time_s, series, strict=True):
            inside = min(max(v, low - 0.1 * span), high + 0.1 * span)
            x = PAD + t / end * (WIDTH - PAD)
            y = HEIGHT - 18 - (inside - low) / span * (HEIGHT - 36)
            yield f"{x:.1f},{y:.1f}"

    drawn = "".join(
        f'<polyline fill="none" stroke="{colour}" stroke-width="{width}" '
        f'points="{" ".join(points(series))}"><title>{name}</title></polyline>'
        for name, series, colour, width in lines
    )
    held = PAD + curve.held_from_s / end * (WIDTH - PAD)
    text = (
        f"{curve.joint}: position over {end:.4g} s, {low:.3g} to {high:.3g}; measured (dark), "
        "simulated with the priors (orange) and as identified (blue); right of the line: held out"
    )
    return (
        f'<figure><svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(text)}">'
        f'<path d="M{held:.1f} 6V{HEIGHT - 14}" stroke="var(--soft)" stroke-dasharray="4 3"/>'
        f"{drawn}</svg><figcaption>{escape(text)}</figcaption></figure>"
    )
