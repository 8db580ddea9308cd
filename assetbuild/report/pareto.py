"""Collision quality against simulation speed: which levels no other beats in both, as SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from xml.sax.saxutils import escape  # only written

WIDTH, HEIGHT = 760, 480
LEFT, RIGHT, TOP, BOTTOM = 60, 30, 84, 60
DOT = 5.0
"""Radius of a dot."""
LETTER, LINE = 7.2, 13.0
"""Room for a letter of 12 pixels, bold, and for a line of them."""
DISTANCES = (0.0, 14.0, 28.0, 42.0, 56.0, 70.0)
"""How far a name may be moved from its dot; a moved one gets a thin line to it."""
Point = tuple[float, float]
"""Pixels from the upper left corner."""
Segment = tuple[Point, Point]
TICKS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)


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
    frame = _Frame.about([speed for speed, _ in points.values()], [q for _, q in points.values()])
    dots = {name: frame.place(*point) for name, point in points.items()}
    ordered = sorted(dots[name] for name in best)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        f'<text x="{LEFT}" y="26" font-size="15">{escape(title)}</text>',
        f'<text x="{LEFT}" y="46" fill="#1f6fb2">blue, bold: the Pareto front, '
        "no other level is both faster and nearer to the meshes</text>",
        *frame.axes(),
    ]
    if len(ordered) > 1:
        path = " ".join(f"{x},{y}" for x, y in ordered)
        lines.append(f'<polyline points="{path}" fill="none" stroke="#1f6fb2" stroke-width="2"/>')
    lines += _labelled(dots, best, list(pairwise(ordered)))
    for name, (x, y) in dots.items():
        colour = "#1f6fb2" if name in best else "#888"
        lines.append(f'<circle cx="{x}" cy="{y}" r="{DOT:g}" fill="{colour}"/>')
    return "\n".join([*lines, "</svg>"]) + "\n"


@dataclass(frozen=True)
class _Frame:
    """The ranges of the axes: logarithms of the speed, and IoU in twentieths."""

    low: float
    high: float
    floor: int
    ceiling: int

    @classmethod
    def about(cls, speeds: Sequence[float], ious: Sequence[float]) -> _Frame:
        floor = min(math.floor(20.0 * min(ious) - 0.2), 18)
        ceiling = min(math.ceil(20.0 * max(ious) + 0.2), 20)
        return cls(
            math.log10(min(speeds) / 1.1), math.log10(max(speeds) * 1.15),
            max(floor, 0), max(ceiling, floor + 2),
        )  # fmt: skip

    def place(self, speed: float, iou: float) -> Point:
        """Where a level stands, pixels."""
        across = (math.log10(speed) - self.low) / (self.high - self.low)
        up = (20.0 * iou - self.floor) / (self.ceiling - self.floor)
        x, y = across * (WIDTH - LEFT - RIGHT), up * (HEIGHT - TOP - BOTTOM)
        return round(LEFT + x, 1), round(HEIGHT - BOTTOM - y, 1)

    def axes(self) -> list[str]:
        """Both, with their grid and names."""
        lines = []
        for exponent in range(math.floor(self.low), math.ceil(self.high) + 1):
            for value in (digit * 10.0**exponent for digit in TICKS):
                if self.low <= math.log10(value) <= self.high:
                    x, y = self.place(value, self.floor / 20.0)
                    lines.append(f'<path d="M{x} {TOP}V{y}" stroke="#ddd"/>')
                    shown = f"{value:,.0f}"
                    lines.append(f'<text x="{x}" y="{y + 18}" text-anchor="middle">{shown}</text>')
        for twentieth in range(self.floor, self.ceiling + 1):
            x, y = self.place(10.0**self.low, twentieth / 20.0)
            lines.append(f'<path d="M{x} {y}H{WIDTH - RIGHT}" stroke="#ddd"/>')
            shown = f"{twentieth / 20.0:.2f}"
            lines.append(f'<text x="{x - 8}" y="{y + 4}" text-anchor="end">{shown}</text>')
        middle = (LEFT + WIDTH - RIGHT) / 2
        name = "simulation steps / s"
        lines.append(f'<text x="{middle}" y="{HEIGHT - 14}" text-anchor="middle">{name}</text>')
        lines.append(f'<text x="14" y="{TOP - 14}">mean IoU with the meshes</text>')
        return lines


# --- names ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Box:
    """A rectangle about a text: its left, upper, right and lower edge."""

    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: _Box) -> bool:
        """Whether the two overlap."""
        return (
            self.left < other.right
            and other.left < self.right
            and self.top < other.bottom
            and other.top < self.bottom
        )

    def nearest(self, point: Point) -> Point:
        """Return the point of the rectangle that is nearest to `point`."""
        x, y = point
        return min(max(x, self.left), self.right), min(max(y, self.top), self.bottom)

    def is_crossed(self, segment: Segment) -> bool:
        """Whether a line runs through it: what is left of it between all four edges."""
        (x, y), (u, v) = segment
        first, last = 0.0, 1.0
        for start, step, low, high in (
            (x, u - x, self.left, self.right),
            (y, v - y, self.top, self.bottom),
        ):
            if step == 0.0:
                if not low < start < high:
                    return False
                continue
            near, far = sorted(((low - start) / step, (high - start) / step))
            first, last = max(first, near), min(last, far)
        return first < last


def _labelled(
    dots: Mapping[str, Point], best: frozenset[str], drawn: Sequence[Segment]
) -> list[str]:
    """The names, each at the first place near its dot that covers no dot, name or line."""
    lines: list[str] = []
    all_dots = list(dots.values())
    taken = [_Box(x - DOT, y - DOT, x + DOT, y + DOT) for x, y in all_dots]
    crossing = list(drawn)
    for name, dot in sorted(dots.items(), key=lambda item: item[1]):
        places = [_moved(name, dot, way, far) for far in DISTANCES for way in _WAYS]
        costs = [
            _in_the_way(dot, box, taken, crossing) + 2 * _misread(dot, box, all_dots)
            for box in places
        ]
        box = places[costs.index(min(costs))]  # of equals the first
        taken.append(box)
        for start, end in _leader(dot, box):
            crossing.append((start, end))
            ends = f"M{start[0]} {start[1]}L{end[0]:.1f} {end[1]:.1f}"
            lines.append(f'<path d="{ends}" stroke="#888"/>')
        weight = ' font-weight="bold"' if name in best else ""
        lines.append(
            f'<text x="{(box.left + box.right) / 2:.1f}" y="{box.bottom - 3:.1f}" '
            f'text-anchor="middle"{weight}>{escape(name)}</text>'
        )
    return lines


def _leader(dot: Point, box: _Box) -> list[Segment]:
    """The line from a dot to a name that stands away from it; none to a near one."""
    end = box.nearest(dot)
    return [(dot, end)] if math.dist(end, dot) > 2.5 * DOT else []


_WAYS = ((1, -1), (1, 1), (-1, 1), (-1, -1), (1, 0), (-1, 0), (0, -1), (0, 1))
"""Directions from a dot to its name, the liked ones first; y points down."""


def _moved(name: str, dot: Point, way: tuple[int, int], far: float) -> _Box:
    width = LETTER * len(name)
    gap = DOT + (3.0 if 0 in way else 0.5) + far
    x, y = dot[0] + way[0] * (gap + width / 2.0), dot[1] + way[1] * (gap + LINE / 2.0)
    return _Box(x - width / 2.0, y - LINE / 2.0, x + width / 2.0, y + LINE / 2.0)


def _in_the_way(dot: Point, box: _Box, taken: Sequence[_Box], crossing: Sequence[Segment]) -> int:
    """How much a name there covers, its own line with it; outside of the plot is the worst."""
    out = box.left < LEFT or box.right > WIDTH - 4
    out = out or box.top < TOP - 10 or box.bottom > HEIGHT - BOTTOM - 2
    hidden = sum(box.meets(other) for other in taken)
    leaders = _leader(dot, box)  # it crosses its own dot, which speaks for a near place
    hidden += sum(other.is_crossed(leader) for other in taken for leader in leaders)
    return 100 * out + 2 * hidden + sum(box.is_crossed(segment) for segment in crossing)


def _misread(dot: Point, box: _Box, dots: Sequence[Point]) -> bool:
    """Whether a name without a line stands as near to another dot."""
    if _leader(dot, box):
        return False
    own = math.dist(box.nearest(dot), dot)
    return any(math.dist(box.nearest(o), o) < own + 2.0 for o in dots if o != dot)
