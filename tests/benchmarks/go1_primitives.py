"""Go1's rear left hip and thigh at home: our primitives against the hand-made ones.

python tests/benchmarks/go1_primitives.py

Reads the hand-made model's collision geoms from $ASSETBUILD_SHARED/gold/unitree_go1.json. The
two links are scored as one, because the hand-made model puts the thigh's motor on the hip.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from links import load_link
from ten_links import cpu

from assetbuild.collision import PlacedSource
from assetbuild.collision.primitive import FitPrimitive
from assetbuild.mesh.cover import Reference, measure
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import merged
from assetbuild.mesh.weld import cleaned
from assetbuild.robot.model import Box, Capsule, Cylinder, Sphere
from assetbuild.robot.pose import Pose, quat_of_rpy

X_HIP_MESH = Pose(quat=(0.0, 0.0, 1.0, 0.0))
X_HIP_THIGH = Pose((0.0, 0.08, 0.0), quat_of_rpy(0.0, 0.9, 0.0))
SOURCE = (PlacedSource.of_mesh("mesh"),)


def ours(link: str, count: int, bones: Sequence[tuple[float, float, float]]) -> list[ConvexPiece]:
    """What `method: primitive, max_hulls: count` makes of a link's mesh."""
    step = FitPrimitive(sources=SOURCE, max_hulls=count, bones=tuple(bones))
    return list(step.fit(Reference(load_link(link))).pieces)


def by_hand(body: str) -> list[ConvexPiece]:
    """The collision geoms of a body of the hand-made model."""
    path = Path(os.environ["ASSETBUILD_SHARED"]) / "gold/unitree_go1.json"
    return [_piece(g) for g in json.loads(path.read_text())["collision_geoms"] if g["body"] == body]


def _piece(geom: dict[str, object]) -> ConvexPiece:
    kind, size = str(geom["type"]).lower().removeprefix("mjgeom_"), list(geom["size"])  # type: ignore[call-overload]
    solids = {
        "box": lambda: Box(tuple(2 * s for s in size)),
        "sphere": lambda: Sphere(size[0]),
        "capsule": lambda: Capsule(size[0], 2 * size[1]),
        "cylinder": lambda: Cylinder(size[0], 2 * size[1]),
    }
    return ConvexPiece(None, solids[kind](), Pose(tuple(geom["pos"]), tuple(geom["quat"])))  # type: ignore[arg-type]


def placed(pieces: Sequence[ConvexPiece], pose: Pose) -> list[ConvexPiece]:
    """The pieces in the frame that `pose` is given in."""
    return [replace(p, X_frame_piece=pose @ p.X_frame_piece) for p in pieces]


def main() -> None:
    """Print the table."""
    before = cpu()
    hip = ours("go1_hip", 2, [(0.0, 0.08, 0.0)])
    thigh = ours("go1_thigh", 3, [(0.0, 0.0, -0.213)])
    spent = cpu() - before
    whole = [load_link("go1_hip").placed(X_HIP_MESH), load_link("go1_thigh").placed(X_HIP_THIGH)]
    reference = Reference(cleaned(merged(whole)))
    sets = {
        "ours": placed(hip, X_HIP_MESH) + placed(thigh, X_HIP_THIGH),
        "by hand": by_hand("RL_hip") + placed(by_hand("RL_thigh"), X_HIP_THIGH),
    }
    print("| hip + thigh | IoU | over | missing | mean % | outside mm | primitives | CPU s |")
    print("|---|---|---|---|---|---|---|---|")
    for name, pieces in sets.items():
        q = measure(reference, pieces)
        mean = 100 * q.mean_m / reference.diagonal
        print(
            f"| {name} | {q.iou:.3f} | {q.over:.2f} | {q.missing:.2f} | {mean:.2f} "
            f"| {1e3 * q.max_outside_m:.1f} | {q.pieces} | {spent if name == 'ours' else 0:.1f} |"
        )


if __name__ == "__main__":
    main()
