"""Meshes whose points stand in the MJCF itself, or that MuJoCo makes: each becomes an OBJ."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from assetbuild.errors import SourceError
from assetbuild.findings import Data, Finding
from assetbuild.mesh.hull import convex_hull
from assetbuild.robot.pose import Array, normalised_quat, rotation_of
from assetbuild.source.mjcf.text import DROPPED, error_at, own_attributes, where_of

if TYPE_CHECKING:
    from lxml.etree import _Element

FOLDER = "(inline)/"
"""Where such files lie for those who read the source: no folder of its own is called that."""
WRITTEN = ("vertex", "face", "builtin", "params")
LOST = ("normal", "texcoord", "facenormal", "facetexcoord")


def write_inline(root: _Element, folder: Path) -> Iterator[Finding]:
    """Write each mesh without a file to a folder, and name that file instead of its points."""
    folder.mkdir()
    meshes = [mesh for mesh in root.iterfind("asset/mesh") if not mesh.get("file")]
    for number, mesh in enumerate(meshes):
        name = str(mesh.get("name"))
        if mesh.get("vertex"):
            points, faces = _stated(mesh, name)
        elif mesh.get("builtin"):
            points, faces = _made(mesh, name)
        else:
            raise error_at(mesh, f"mesh `{name}` has neither a file nor points")
        lines = [f"v {' '.join(map(repr, point))}" for point in points]
        lines += [f"f {' '.join(str(corner + 1) for corner in face)}" for face in faces]
        (folder / f"{number}.obj").write_text("\n".join(lines) + "\n", encoding="ascii")
        lost = tuple(word for word in LOST if word in mesh.attrib)
        for word in (*WRITTEN, *LOST):
            mesh.attrib.pop(word, "")
        mesh.set("file", f"{FOLDER}{number}.obj")
        if lost:
            message = f"{', '.join(f'`{a}`' for a in lost)} of mesh `{name}` was left out "
            hint = "store the mesh in an OBJ file"
            data: Data = {"element": "mesh", "attributes": lost}
            yield DROPPED(f"mesh {name}", f"{message}({where_of(mesh)})", hint, data=data)


_Triangles = tuple[Sequence[Sequence[float]], Sequence[Sequence[int]]]


def _stated(mesh: _Element, name: str) -> _Triangles:
    """Points, m, and triangles; without triangles the hull of the points, as MuJoCo has it."""
    try:
        points = np.array([float(word) for word in mesh.get("vertex", "").split()])
        faces = np.array([int(word) for word in mesh.get("face", "").split()], dtype=np.int64)
        points, faces = points.reshape(-1, 3), faces.reshape(-1, 3)
    except ValueError:
        message = f"mesh `{name}`: `vertex` and `face` are rows of three numbers"
        raise error_at(mesh, message) from None
    outside = (faces < 0) | (faces >= len(points))
    if not np.isfinite(points).all() or outside.any():
        raise error_at(mesh, f"mesh `{name}`: a point is not finite, or a corner is none of them")
    if not faces.size:
        hull = convex_hull(points, subject=f"mesh {name}")
        points, faces = hull.vertices, hull.faces
    return points.tolist(), faces.tolist()


def _made(mesh: _Element, name: str) -> _Triangles:
    """What MuJoCo makes of `builtin`, moved back from the principal axes where it keeps it."""
    import mujoco
    from lxml import etree

    said = {key: value for key, value in own_attributes(mesh).items() if key in WRITTEN}
    alone = etree.tostring(etree.Element("mesh", {"name": "m", **said}), encoding="unicode")
    text = f"""<mujoco><asset>{alone}</asset>
      <worldbody><geom type="mesh" mesh="m" contype="0" conaffinity="0"/></worldbody></mujoco>"""
    try:
        model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        words = " ".join(str(error).split())
        message = f"mesh `{name}`: MuJoCo does not make it: {words}"
        raise SourceError(message, where=where_of(mesh)) from None
    turn = normalised_quat(tuple(float(v) for v in model.mesh_quat[0]))  # type: ignore[arg-type] # four numbers
    points: Array = np.asarray(model.mesh_vert, dtype=np.float64) @ rotation_of(turn).T
    return (points + model.mesh_pos[0]).tolist(), np.asarray(model.mesh_face).tolist()
