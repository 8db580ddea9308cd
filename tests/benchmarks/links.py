"""Links of real robots that collision methods are compared on (example-robot-data)."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from assetbuild.engine.step import Files
from assetbuild.geometry.convert_mesh import ConvertMesh
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.triangles import TriangleMesh, cleaned, merged
from assetbuild.plugin_types import ConvertedMesh
from assetbuild.robot.codec import decode

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


def converted(name: str, folder: Path) -> Path:
    """The link's mesh as `convert_mesh` writes it, in `folder`."""
    source = robots_root() / LINKS[name]
    with tempfile.TemporaryDirectory() as inputs:
        shutil.copyfile(source, Path(inputs) / "mesh")
        step = ConvertMesh(format=source.suffix.lower().lstrip("."))
        folder.mkdir(parents=True, exist_ok=True)
        list(step.run(Files(Path(inputs), folder)))
    return folder


def load_link(name: str) -> TriangleMesh:
    """The link's mesh, welded, m."""
    with tempfile.TemporaryDirectory() as folder:
        out = converted(name, Path(folder))
        record = decode(ConvertedMesh, (out / "mesh.json").read_bytes())
        files = [out / "parts" / part.file for part in record.parts]
        return cleaned(merged([read_triangles(f.read_bytes(), name) for f in files]))
