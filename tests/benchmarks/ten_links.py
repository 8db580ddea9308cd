"""Ten real links: our `auto` beside one hull, V-HACD 8 and 32, and CoACD 0.05.

python tests/benchmarks/ten_links.py [LINK ...] [--without-coacd] [--only-auto]

CPU seconds are user + system of this process and its children; CoACD runs with its own default
parameters but for 64 vertices, and is ended after 60 CPU seconds.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from assetbuild.collision import PlacedSource
from assetbuild.collision.auto import PRESETS, Auto
from assetbuild.collision.hull import Hull
from assetbuild.engine.step import Files
from assetbuild.geometry.convert_mesh import ConvertMesh
from assetbuild.mesh.arrays import PARTS, read_meshes
from assetbuild.mesh.cover import Reference, measure
from assetbuild.mesh.decomposition import CoAcdOptions, VHacdOptions, coacd_parts, vhacd_parts
from assetbuild.mesh.native import NativeError, NativeLimits
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.mesh.triangles import TriangleMesh, cleaned, merged

LINKS = {
    "ur5_base": "ur_description/meshes/ur5/collision/base.stl",
    "ur5_forearm": "ur_description/meshes/ur5/collision/forearm.stl",
    "panda_finger": "panda_description/meshes/visual/finger.dae",
    "panda_hand": "panda_description/meshes/visual/hand.dae",
    "go1_thigh": "go1_description/meshes/thigh.dae",
    "go1_calf": "go1_description/meshes/calf.dae",
    "go1_hip": "go1_description/meshes/hip.dae",
    "go1_trunk": "go1_description/meshes/trunk.dae",
    "g1_knee": "g1_description/meshes/left_knee_link.STL",
    "g1_torso": "g1_description/meshes/torso_link_rev_1_0.STL",
}


def robots_root() -> Path:
    """The package's `robots` folder."""
    return Path(os.environ["ASSETBUILD_TEST_DATA"]) / "example-robot-data/robots"


def load_link(name: str) -> TriangleMesh:
    """The link's mesh as `convert_mesh` writes it, welded, m."""
    source = robots_root() / LINKS[name]
    with tempfile.TemporaryDirectory() as inputs, tempfile.TemporaryDirectory() as made:
        shutil.copyfile(source, Path(inputs) / "mesh")
        step = ConvertMesh(format=source.suffix.lower().lstrip("."))
        list(step.run(Files(Path(inputs), Path(made))))
        return cleaned(merged([*read_meshes(Path(made) / PARTS).values()]))


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
                    f"| {name} | {label} | {failure} | | | | | | {cpu() - before:.1f} |", flush=True
                )
                continue
            spent = cpu() - before
            q = measure(reference, cap.verified(made))
            figures = f"{q.iou:.3f} | {q.over:.3f} | {q.missing:.3f} | {1e3 * q.max_outside_m:.1f}"
            figures += f" | {1e3 * q.p99_m:.1f} | {q.pieces} | {spent:.1f}"
            print(f"| {name} | {label} | {figures} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
