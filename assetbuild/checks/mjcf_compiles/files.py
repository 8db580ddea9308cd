"""What MuJoCo makes of the robot's meshes and pictures: the very surfaces and pixels that they are.

Readers of facts know a copy of such a file by its bytes. That MuJoCo reads those bytes as the build
does is proved here, once for all forms of the MJCF.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from assetbuild.facts.compare import differences, equality_findings
from assetbuild.facts.mjcf import MESHES
from assetbuild.facts.mjcf_meshes import Meshes, pose_of
from assetbuild.facts.reference import Assets
from assetbuild.facts.surface import Surface
from assetbuild.facts.table import Value, Writer
from assetbuild.findings import Finding
from assetbuild.simulators.mujoco import Model, name_of


def read_otherwise(model: Model, assets: Assets) -> Iterator[Finding]:
    """Findings `equal.mjcf.*` of the files that a compiled model holds otherwise than the build."""
    surfaces, pixels = dict(assets.surfaces), dict(assets.pixels)
    meshes = Meshes(model, stated={name for name, own in surfaces.items() if own.normals})
    expected, found = Writer(), Writer()
    for index in range(model.nmesh):
        name = name_of(model, "mesh", index)
        if name in surfaces:
            X_file_mesh = pose_of(model.mesh_pos[index], model.mesh_quat[index])
            expected.put("shape", name, _facts(surfaces[name]))
            found.put("shape", name, _facts(meshes.of(index).moved(X_file_mesh)))
    for index in range(model.ntex):
        name = _file(model, int(model.tex_pathadr[index]))
        if name in pixels:
            expected.put("shape", name, {"texture": pixels[name]})
            found.put("shape", name, {"texture": meshes.pixels(index)})
    different = differences(expected.table(), found.table(), MESHES)
    for finding in equality_findings(different, "mjcf", "MuJoCo", {}, "the file"):
        yield replace(finding, subject=finding.subject.replace("shape ", "file ", 1))


def _facts(surface: Surface) -> dict[str, Value]:
    return surface.facts() | ({"mjcf:normals": surface.normals} if surface.normals else {})


def _file(model: Model, start: int) -> str:
    """The name of the file behind an asset; "" of one without."""
    path = model.paths[start:].split(b"\0")[0] if start >= 0 else b""
    return Path(path.decode("utf-8", "surrogateescape")).name
