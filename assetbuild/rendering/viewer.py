"""The geometry of the report's 3D view, and the library that draws it."""

from __future__ import annotations

import base64
import gzip
import importlib.util
import io
import json
import re
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from assetbuild.engine.step import Files, Step
from assetbuild.findings import Finding, Rule
from assetbuild.mesh import MESH_MODULES
from assetbuild.mesh.arrays import read_meshes
from assetbuild.mesh.simplify import clustered, simplified
from assetbuild.mesh.solid import Distance, distance_to
from assetbuild.mesh.triangles import TriangleMesh, area, cleaned
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.model import Tree
from assetbuild.robot.pose import Array
from assetbuild.robot.shapes import Geometry, Mesh, Shapes

BEYOND_IMPORTS = ("trimesh",)
SPAN_M = 0.03
"""Distances between visual and collision geometry are shown up to this one, larger ones alike."""
LIBRARY = re.compile(r'/\*\*\s*\* @license.*?"__esModule",\{value:!0\}\)\}\)\);', re.DOTALL)
"""three.js with its licence line, as trimesh ships it inside its notebook viewer (MIT)."""

MOST = 40_000
"""Triangles of all visual meshes together, each counted once."""
SMALLEST = 400
"""Triangles up to which a mesh is left as it is: a screw stays a screw."""
OWN, WHOLE = 0.005, 0.0012
"""Side of the cells within which vertices become one, as a share of the mesh's own diagonal and of
the largest mesh's: 0.8 mm on a trunk of 0.6 m, a pixel of the view. The larger counts."""
AREA = (0.95, 1.05)
"""Area after / before. Where decimation eats thin parts and small components, it falls."""
DECIMALS = 5
"""Vertices are rounded to so many decimals of a metre."""

NO_VIEWER = Rule(
    "viewer.none",
    "info",
    "the report has no 3D view: the installed trimesh brings no three.js",
    "install another version of trimesh",
)


class Viewer(Step):
    """`tree.json`, `shapes.json` and `triangles.npz` -> `viewer.json` and `three.js`.

    Meshes that nothing collides with are thinned, because the view only shows them.

    viewer.json: {"gzip": base64 of a compressed JSON}, which holds {"span_m", "meshes": {name:
    {"lower", "size", "points", "faces", "wide"}}, "shapes": [{"name", "link", "body", "role",
    "kind", ..., "distance"}]}. Poses are in the body's frame. points:
    base64 of uint16 (n, 3), in `size / 65535` from `lower`; faces: uint16, or uint32 where wide;
    distance: uint8 per point, 128 = on the collision surface, 255 = SPAN_M outside it. m,
    quaternions wxyz.
    """

    shares = True
    usual_s = 1.0
    outputs = ("viewer.json", "three.js")
    isolated = True
    preload = MESH_MODULES

    def run(self, files: Files) -> Iterator[Finding]:
        """Write the 3D view; without the library the page has none, and a finding says so."""
        robot = RobotFiles(files.inputs)
        meshes = shown_meshes(robot)
        library = three_js()
        if library is None:
            yield NO_VIEWER("robot", NO_VIEWER.meaning)
        content = {
            "span_m": SPAN_M,
            "meshes": {name: packed_mesh(mesh) for name, mesh in sorted(meshes.items())},
            "shapes": _shapes(robot.tree, robot.shapes, meshes),
        }
        text = json.dumps(content, sort_keys=True, separators=(",", ":"))
        packed = gzip.compress(text.encode("ascii"), compresslevel=6, mtime=0)
        whole = json.dumps({"gzip": base64.b64encode(packed).decode("ascii")})
        (files.outputs / "viewer.json").write_text(whole, encoding="ascii")
        (files.outputs / "three.js").write_text(library or "", encoding="utf-8")


def shown_meshes(robot: RobotFiles) -> dict[str, TriangleMesh]:
    """Each mesh by name: thinned where it is only looked at."""
    meshes = read_meshes(robot.triangles)
    seen, hit = (
        {s.geometry.mesh for s in robot.shapes.of(role) if isinstance(s.geometry, Mesh)}
        for role in ("visual", "collision")
    )
    light = lightened({name: meshes[name] for name in sorted(seen)})
    return {**meshes, **{name: mesh for name, mesh in light.items() if name not in hit}}


def lightened(meshes: Mapping[str, TriangleMesh], max_faces: int = MOST) -> dict[str, TriangleMesh]:
    """The meshes that became smaller, by name.

    Vertices that nearly touch become one; where the meshes then have more than `max_faces`
    triangles together, all lose some in proportion, but for those that would lose area with them.
    The view shows colours and no textures. Nothing of this is physics, and no target reads it.
    """
    plain = {name: cleaned(mesh) for name, mesh in meshes.items()}
    large = {name: mesh for name, mesh in plain.items() if len(mesh.faces) > SMALLEST}
    whole = max((mesh.diagonal for mesh in large.values()), default=0.0)
    joined = {
        name: clustered(mesh, max(OWN * mesh.diagonal, WHOLE * whole), DECIMALS)
        for name, mesh in large.items()
    }
    share = max_faces / max(sum(len(mesh.faces) for mesh in joined.values()), 1)
    light = {name: _light(mesh, joined[name], share) for name, mesh in large.items()}
    return {name: mesh for name, mesh in light.items() if mesh is not plain[name]}


def _light(mesh: TriangleMesh, joined: TriangleMesh, share: float) -> TriangleMesh:
    """A share of the triangles of the mesh with joined vertices, if the area stays; else that mesh;
    else the full one."""
    goal = max(SMALLEST, int(len(joined.faces) * share))
    whole = area(mesh)
    for made in (simplified(joined, goal, DECIMALS), joined):
        kept = len(made.faces) >= 4 and AREA[0] <= area(made) / whole <= AREA[1]
        if kept and len(made.faces) < len(mesh.faces):
            return made
    return mesh


def three_js() -> str | None:
    """The library's text from the installed trimesh; None where it is not found."""
    spec = importlib.util.find_spec("trimesh")
    if spec is None or not spec.origin:
        return None
    path = Path(spec.origin).parent / "resources" / "templates" / "viewer.zip"
    try:
        with zipfile.ZipFile(io.BytesIO(path.read_bytes())) as archive:
            texts = [archive.read(name).decode("utf-8") for name in sorted(archive.namelist())]
    except (OSError, zipfile.BadZipFile, UnicodeDecodeError):
        return None
    for text in texts:
        match = LIBRARY.search(text)
        if match and "</script" not in match.group(0):
            return match.group(0)
    return None


def packed_mesh(mesh: TriangleMesh) -> dict[str, object]:
    """A mesh in 16 bits per coordinate: a hundredth of a millimetre on a robot of 60 cm."""
    lower, upper = mesh.bounds
    size = np.maximum(upper - lower, 1e-9)
    points = np.round((mesh.vertices - lower) / size * 65535).astype("<u2")
    wide = len(mesh.vertices) > 65535
    return {
        "lower": [round(float(v), 6) for v in lower],
        "size": [round(float(v), 6) for v in size],
        "points": _base64(points),
        "faces": _base64(mesh.faces.astype("<u4" if wide else "<u2")),
        "wide": wide,
    }


def _base64(values: NDArray[np.generic]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")


def _shapes(
    tree: Tree, shapes: Shapes, meshes: Mapping[str, TriangleMesh]
) -> list[dict[str, object]]:
    colours = {material.name: material.rgba for material in shapes.materials}
    solids: dict[str, list[tuple[Array, Distance]]] = {}
    for shape in shapes.of("collision"):
        body, X_body_shape = tree.shape_placement(shape)
        geometry = shape.geometry
        reach = np.array([[-np.inf], [np.inf]])
        if isinstance(geometry, Mesh):
            points = X_body_shape.apply(meshes[geometry.mesh].vertices)
            reach = np.array([points.min(axis=0) - SPAN_M, points.max(axis=0) + SPAN_M])
            distance = distance_to(meshes[geometry.mesh].vertices, X_body_shape)
        else:
            distance = distance_to(geometry, X_body_shape)
        solids.setdefault(body, []).append((reach, distance))
    rows = []
    for shape in shapes.shapes:
        body, X_body_shape = tree.shape_placement(shape)
        row: dict[str, object] = {
            "name": shape.name,
            "link": shape.link,
            "body": body,
            "role": shape.role,
            "xyz": [round(float(v), 7) for v in X_body_shape.xyz],
            "quat": [round(float(v), 7) for v in X_body_shape.quat],
            "rgba": list(colours.get(shape.material or "", (0.62, 0.64, 0.67, 1.0))),
            **_described(shape.geometry),
        }
        if shape.role == "visual" and isinstance(shape.geometry, Mesh) and body in solids:
            points = X_body_shape.apply(meshes[shape.geometry.mesh].vertices)
            row["distance"] = _base64(in_bytes(nearest(points, solids[body])))
        rows.append(row)
    return rows


def nearest(points: Array, solids: Iterable[tuple[Array, Distance]]) -> Array:
    """(n,) distance from the nearest solid up to SPAN_M, m. solids: with the box they reach to."""
    least = np.full(len(points), SPAN_M)
    for (lower, upper), distance in solids:
        near = ((points >= lower) & (points <= upper)).all(axis=1)
        if near.any():  # a body of a hundred parts takes minutes otherwise
            least[near] = np.minimum(least[near], distance(points[near]))
    return least


def in_bytes(distance_m: Array) -> NDArray[np.uint8]:
    """-SPAN_M..SPAN_M as 1..255; 128 = 0."""
    steps = np.round(np.clip(distance_m / SPAN_M, -1.0, 1.0) * 127.0)
    return np.asarray(steps + 128.0, dtype=np.uint8)


def _described(geometry: Geometry) -> dict[str, object]:
    kind = type(geometry).__name__.lower()
    if isinstance(geometry, Mesh):
        return {"kind": kind, "mesh": geometry.mesh}
    return {"kind": kind, "dims": np.ravel([*vars(geometry).values()]).tolist()}
