"""Ten real links: our `auto` beside one hull, V-HACD 8 and 32, and CoACD 0.05.

python tests/benchmarks/ten_links.py [LINK ...] [--without-coacd] [--only-auto]

CPU seconds are user + system of this process and its children; CoACD runs with its own default
parameters but for 64 vertices, and is ended after 60 CPU seconds.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from links import LINKS, load_link

from assetbuild.collision import PlacedSource
from assetbuild.collision.auto import PRESETS, Auto
from assetbuild.collision.hull import Hull
from assetbuild.mesh.coacd import CoAcdOptions, coacd_parts
from assetbuild.mesh.cover import Reference, measure
from assetbuild.mesh.native import NativeError, NativeLimits
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.mesh.vhacd import VHacdOptions, vhacd_parts

SOURCE = (PlacedSource("mesh"),)
LIMITS = NativeLimits(cpu_s=60.0, memory_mb=4096)
COACD = CoAcdOptions(resolution=2000, mcts_nodes=20, mcts_iterations=150, mcts_depth=3)

Method = Callable[[TriangleMesh], Sequence[ConvexPiece]]


def _auto(preset: str) -> Method:
    step = Auto.model_validate({"sources": SOURCE, **PRESETS[preset]})
    return lambda mesh: step.fit(Reference(mesh)).pieces


def _vhacd(count: int) -> Method:
    def run(mesh: TriangleMesh) -> Sequence[ConvexPiece]:
        options = VHacdOptions()
        parts = vhacd_parts(mesh, options, max_hulls=count, max_vertices=64, limits=LIMITS)
        return tuple(map(ConvexPiece, parts))

    return run


def _coacd(mesh: TriangleMesh) -> Sequence[ConvexPiece]:
    parts = coacd_parts(mesh, COACD, max_hulls=None, max_vertices=64, limits=LIMITS)
    return tuple(map(ConvexPiece, parts))


METHODS: dict[str, Method] = {
    "auto, manipulation": _auto("manipulation"),
    "auto, locomotion": _auto("locomotion"),
    "hull": lambda mesh: [ConvexPiece(Reference(mesh).hull)],
    "V-HACD 8": _vhacd(8),
    "V-HACD 32": _vhacd(32),
    "CoACD .05": _coacd,
}


def cpu() -> float:
    """User and system seconds of this process and its children."""
    t = os.times()
    return t.user + t.system + t.children_user + t.children_system


def main(arguments: Sequence[str]) -> None:
    """Print the table."""
    names = [a for a in arguments if not a.startswith("--")] or list(LINKS)
    methods = dict(METHODS)
    if "--without-coacd" in arguments:
        del methods["CoACD .05"]
    if "--only-auto" in arguments:
        methods = {label: method for label, method in methods.items() if "auto" in label}
    cap = Hull(sources=SOURCE)
    print("| link | method | IoU | over | missing | outside mm | p99 mm | hulls | CPU s |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in names:
        mesh = load_link(name)
        reference = Reference(mesh)
        for label, method in methods.items():
            before = cpu()
            try:
                made = method(mesh)
            except NativeError as failure:
                print(
                    f"| {name} | {label} | {failure} | | | | | | {cpu() - before:.1f} |",
                    flush=True,
                )
                continue
            spent = cpu() - before
            pieces = [p for p in map(cap.verified, made) if p is not None]
            q = measure(reference, pieces)
            print(
                f"| {name} | {label} | {q.iou:.3f} | {q.over:.3f} | {q.missing:.3f} "
                f"| {1e3 * q.max_outside_m:.1f} | {1e3 * q.p99_m:.1f} "
                f"| {q.pieces} | {spent:.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1:])
