"""How the draws of each body are spread, as one SVG picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

ROW, WIDTH, NAME, GAP = 22, 220, 180, 40
COLUMNS = (
    ("mass_kg", "mass, kg"),
    ("com_shift_m", "shift of the centre of mass, m"),
    ("largest_moment_kg_m2", "largest principal moment, kg m²"),
)
_STYLE = (
    "text { font: 12px system-ui, sans-serif; fill: #333; } .bar { fill: #5b8db8; } "
    ".frame { fill: none; stroke: #8888; } .small { font-size: 10px; fill: #555; } "
    "@media (prefers-color-scheme: dark) { text { fill: #ddd; } .small { fill: #aaa; } }"
)


def draws_svg(statistics: Mapping[str, Any]) -> str:  # Any: JSON
    """A histogram for each body and quantity; below each its least and largest value."""
    bodies: Sequence[Mapping[str, Any]] = statistics["bodies"]  # Any: JSON
    height = 60 + len(bodies) * (ROW + 18)
    width = NAME + len(COLUMNS) * (WIDTH + GAP)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'role="img" aria-label="spread of the draws">',
        f"<style>{_STYLE}</style>",
        f'<text x="8" y="20">{statistics["draws"]:,} draws for each body</text>',
    ]
    for column, (_, title) in enumerate(COLUMNS):
        parts.append(f'<text x="{_left(column)}" y="42">{escape(title)}</text>')
    for index, body in enumerate(bodies):
        top = 52 + index * (ROW + 18)
        parts.append(f'<text x="8" y="{top + 15}">{escape(str(body["body"]))}</text>')
        for column, (key, _) in enumerate(COLUMNS):
            parts += _histogram(body[key], _left(column), top)
    parts.append("</svg>\n")
    return "\n".join(parts)


def _left(column: int) -> int:
    return NAME + column * (WIDTH + GAP)


def _histogram(values: Mapping[str, Any], left: int, top: int) -> list[str]:  # Any: JSON
    counts: Sequence[int] = values["histogram"]
    step, most = WIDTH / len(counts), max(counts) or 1
    bars = [
        f'<rect class="bar" x="{left + i * step:.2f}" y="{top + ROW * (1 - n / most):.2f}" '
        f'width="{step:.2f}" height="{ROW * n / most:.2f}"/>'
        for i, n in enumerate(counts)
        if n
    ]
    frame = f'<rect class="frame" x="{left}" y="{top}" width="{WIDTH}" height="{ROW}"/>'
    label = f'<text class="small" x="{left}" y="{top + ROW + 11}">{values["least"]:.4g}</text>'
    end = (
        f'<text class="small" x="{left + WIDTH}" y="{top + ROW + 11}" text-anchor="end">'
        f"{values['most']:.4g}</text>"
    )
    return [*bars, frame, label, end]
