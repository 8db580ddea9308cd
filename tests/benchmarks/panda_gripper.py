"""Panda's gripper: what is open stays open under `auto` with `keep_open`; a hull closes it.

python tests/benchmarks/panda_gripper.py [picture.svg]

Three places: the recess behind the finger's pad and the hand's underside, found from the mesh (the
deepest ball inside the hull that touches no triangle), and the gap between the fingers of the whole
gripper, open by 80 mm, as one body.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from links import load_link

from assetbuild.collision import PlacedSource, ProbeSource
from assetbuild.collision.auto import PRESETS, Auto
from assetbuild.collision.hull import Hull
from assetbuild.mesh.cover import Reference, blocked_by
from assetbuild.mesh.solid import ConvexPiece, sobol
from assetbuild.mesh.triangles import TriangleMesh, merged
from assetbuild.mesh.weld import cleaned
from assetbuild.robot.pose import Pose, quat_of_rpy

SOURCE = (PlacedSource.of_mesh("mesh"),)
SHARE = 0.6
"""Of the deepest ball: the probe."""


def deepest(reference: Reference) -> ProbeSource:
    """The largest ball between the mesh and its hull that lies wholly inside the hull."""
    points = sobol(2**13, *reference.mesh.bounds)
    points = points[~reference.solid.contains(points)]
    room = np.minimum(
        reference.surface.distance(points), -ConvexPiece(reference.hull).distance(points)
    )
    best = int(np.argmax(room))
    x, y, z = (float(v) for v in np.round(points[best], 4))
    return ProbeSource(start=(x, y, z), end=(x, y, z), radius=round(SHARE * float(room[best]), 4))


def gripper() -> TriangleMesh:
    """Hand and both fingers, each 40 mm out, in the frame of the hand."""
    finger = load_link("panda_finger")
    left = Pose((0.0, 0.04, 0.0584))
    right = Pose((0.0, -0.04, 0.0584), quat_of_rpy(0.0, 0.0, np.pi))
    return cleaned(merged([load_link("panda_hand"), finger.placed(left), finger.placed(right)]))


GAP = ProbeSource(start=(0.0, -0.03, 0.1), end=(0.0, 0.03, 0.1), radius=0.008)
"""Between the pads, 10 mm clear of either."""


def cases() -> Iterator[tuple[str, Reference, ProbeSource]]:
    """(name, mesh, the place that must stay open)."""
    for link in ("panda_finger", "panda_hand"):
        reference = Reference(load_link(link))
        yield link, reference, deepest(reference)
    yield "panda_gripper", Reference(gripper()), GAP


def picture(cuts: dict[str, Sequence[ConvexPiece]], probe: ProbeSource, r: Reference) -> str:
    """Cuts through the probe, x to the right and z up: mesh grey, pieces blue, probe red."""
    low, high = r.mesh.bounds
    step = r.diagonal / 200
    xs, zs = np.arange(low[0], high[0], step), np.arange(low[2], high[2], step)
    if len(xs) < 5 or np.ptp(r.mesh.vertices[:, 1]) > np.ptp(r.mesh.vertices[:, 0]):
        axis, xs = 1, np.arange(low[1], high[1], step)
    else:
        axis = 0
    grid = np.array([(x, z) for x in xs for z in zs])
    points = np.tile(np.asarray(probe.start), (len(grid), 1))
    points[:, axis], points[:, 2] = grid[:, 0], grid[:, 1]
    inside = r.solid.contains(points)
    out, width = [], (xs[-1] - xs[0]) / step * 2 + 20
    height = (zs[-1] - zs[0]) / step * 2 + 40
    for number, (name, pieces) in enumerate(cuts.items()):
        covered = np.min([p.distance(points) for p in pieces], axis=0) <= 0.0
        out.append(f'<text x="{number * width + 4:.0f}" y="14">{name}</text>')
        for (x, z), is_in, is_covered in zip(grid, inside, covered, strict=True):
            if not (is_in or is_covered):
                continue
            colour = "#1f6fb2" if is_covered and not is_in else "#999" if is_covered else "#e5b567"
            u, v = number * width + (x - xs[0]) / step * 2, height - 10 - (z - zs[0]) / step * 2
            out.append(f'<rect x="{u:.1f}" y="{v:.1f}" width="2" height="2" fill="{colour}"/>')
        middle = np.add(probe.start, probe.end) / 2.0
        u = number * width + (middle[axis] - xs[0]) / step * 2
        v = height - 10 - (middle[2] - zs[0]) / step * 2
        radius = probe.radius / step * 2
        out.append(f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{radius:.1f}" fill="none" stroke="red"/>')
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width * len(cuts):.0f}" '
    return (
        head
        + f'height="{height:.0f}" font-family="sans-serif" font-size="12">'
        + "".join(out)
        + "</svg>\n"
    )


def main(arguments: Sequence[str]) -> None:
    """Print who closes the probe."""
    for link, reference, probe in cases():
        auto = Auto.model_validate(
            {"sources": SOURCE, "probes": (probe,), **PRESETS["manipulation"]}
        )
        cuts = {
            "hull": Hull(sources=SOURCE).fit(reference).pieces,
            "auto, keep_open": auto.fit(reference).pieces,
        }
        at = ", ".join(f"{1e3 * v:.1f}" for v in probe.start)
        print(f"{link}: a probe of radius {1e3 * probe.radius:.1f} mm at ({at}) mm")
        for name, pieces in cuts.items():
            closing = sum(blocked_by(piece, probe.probe) for piece in pieces)
            state = f"closed by {closing} pieces" if closing else "open"
            print(f"  {name}: {len(pieces)} pieces, {state}", flush=True)
        if arguments:
            path = Path(arguments[0])
            path.with_stem(f"{path.stem}-{link}").write_text(picture(cuts, probe, reference))


if __name__ == "__main__":
    main(sys.argv[1:])
