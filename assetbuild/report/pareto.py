"""Collision quality against simulation speed: which levels no other beats in both, as SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from xml.sax.saxutils import escape  # only written

WIDTH, HEIGHT = 720, 440
LEFT, RIGHT, TOP, BOTTOM = 70, 30, 40, 60


def front(points: Mapping[str, tuple[float, float]]) -> frozenset[str]:
    """Names that no other point beats: at least as good in both, better in one."""
    return frozenset(
        name
        for name, (x, y) in points.items()
        if not any(
            (u >= x and v >= y) and (u > x or v > y)
            for other, (u, v) in points.items()
            if other != name
        )
    )


def pareto_svg(title: str, points: Mapping[str, tuple[float, float]]) -> str:
    """points: name -> (simulation steps per second, mean IoU). The front is a line of dots."""
    best = front(points)
    speeds = [speed for speed, _ in points.values()]
    low, high = math.log10(min(speeds) / 1.15), math.log10(max(speeds) * 1.15)
    floor = math.floor(10.0 * min(iou for _, iou in points.values())) / 10.0
    floor = min(floor, 0.9)

    def place(speed: float, iou: float) -> tuple[float, float]:
        x = LEFT + (math.log10(speed) - low) / (high - low) * (WIDTH - LEFT - RIGHT)
        y = HEIGHT - BOTTOM - (iou - floor) / (1.0 - floor) * (HEIGHT - TOP - BOTTOM)
        return round(x, 1), round(y, 1)

    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        f'<text x="{LEFT}" y="22" font-size="15">{escape(title)}</text>',
        *_axes(place, low, high, floor),
    ]
    ordered = sorted((place(*points[name]), name) for name in best)
    if len(ordered) > 1:
        path = " ".join(f"{x},{y}" for (x, y), _ in ordered)
        lines.append(f'<polyline points="{path}" fill="none" stroke="#1f6fb2" stroke-width="2"/>')
    lines += _labelled([(place(*points[name]), name, name in best) for name in points])
    return "\n".join([*lines, "</svg>"]) + "\n"


def _axes(place, low: float, high: float, floor: float) -> list[str]:  # type: ignore[no-untyped-def] # noqa: ANN001 # a closure
    lines = []
    for exponent in range(math.floor(low), math.ceil(high) + 1):
        for digit in (1, 2, 5):
            value = digit * 10.0**exponent
            if not low <= math.log10(value) <= high:
                continue
            x, y = place(value, floor)
            lines.append(f'<path d="M{x} {TOP}V{y}" stroke="#ddd"/>')
            lines.append(f'<text x="{x}" y="{y + 18}" text-anchor="middle">{value:,.0f}</text>')
    steps = round((1.0 - floor) * 10)
    for k in range(steps + 1):
        iou = floor + k / 10.0
        _, y = place(10.0**low, iou)
        lines.append(f'<path d="M{LEFT} {y}H{WIDTH - RIGHT}" stroke="#ddd"/>')
        lines.append(f'<text x="{LEFT - 8}" y="{y + 4}" text-anchor="end">{iou:.1f}</text>')
    middle = (LEFT + WIDTH - RIGHT) / 2
    lines.append(
        f'<text x="{middle}" y="{HEIGHT - 14}" text-anchor="middle">simulation steps / s</text>'
    )
    lines.append(f'<text x="12" y="{TOP - 6}">mean IoU with the meshes</text>')
    return lines


def _labelled(dots: Sequence[tuple[tuple[float, float], str, bool]]) -> list[str]:
    """Dots with their names; a name moves down until it is clear of the ones before."""
    lines: list[str] = []
    taken: list[tuple[float, float]] = []
    for (x, y), name, is_best in sorted(dots):
        colour = "#1f6fb2" if is_best else "#888"
        lines.append(f'<circle cx="{x}" cy="{y}" r="5" fill="{colour}"/>')
        label = y - 8
        while any(abs(x - u) < 90 and abs(label - v) < 13 for u, v in taken):
            label += 13
        taken.append((x, label))
        weight = ' font-weight="bold"' if is_best else ""
        anchor = "end" if x > WIDTH - 110 else "start"
        shift = -8 if anchor == "end" else 8
        lines.append(
            f'<text x="{x + shift}" y="{label:.1f}" text-anchor="{anchor}"{weight}>'
            f"{escape(name)}</text>"
        )
    return lines
