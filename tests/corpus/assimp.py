"""What assimp makes of a mesh file: area, volume and bounds, for a comparison with our reader.

The library is the one that pinocchio brings (`cmeel-assimp`), called through its C interface.
Polygons are measured as they are, because assimp drops triangles of those that are not convex.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Iterator
from ctypes import POINTER, c_char_p, c_float, c_int, c_uint32, c_void_p
from dataclasses import dataclass
from importlib.metadata import files
from pathlib import Path

import numpy as np


class Face(ctypes.Structure):
    _fields_ = (("count", c_uint32), ("corners", c_void_p))


class Mesh(ctypes.Structure):
    """The head of assimp's `aiMesh`."""

    _fields_ = (
        ("kinds", c_uint32),
        ("vertex_count", c_uint32),
        ("face_count", c_uint32),
        ("vertices", c_void_p),
        ("directions", c_void_p * 3),
        ("colours", c_void_p * 8),
        ("texture", c_void_p * 8),
        ("texture_sizes", c_uint32 * 8),
        ("faces", POINTER(Face)),
    )


class Node(ctypes.Structure):
    pass


Node._fields_ = (
    ("length", c_uint32),
    ("name", ctypes.c_char * 1024),
    ("transform", c_float * 16),
    ("parent", POINTER(Node)),
    ("child_count", c_uint32),
    ("children", POINTER(POINTER(Node))),
    ("mesh_count", c_uint32),
    ("meshes", POINTER(c_uint32)),
)


class Scene(ctypes.Structure):
    _fields_ = (
        ("flags", c_uint32),
        ("root", POINTER(Node)),
        ("mesh_count", c_uint32),
        ("meshes", POINTER(POINTER(Mesh))),
    )


@dataclass(frozen=True)
class Measured:
    """area: m2; volume: m3, signed; lower, upper: corners of the box, m."""

    area: float
    volume: float
    lower: np.ndarray
    upper: np.ndarray


def polygons(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """((n, 3) corners in m, polygon by polygon; how many each has): up axis ignored, unit applied.

    ValueError where assimp refuses the file.
    """
    library = _library()
    scene = library.aiImportFileExWithProperties(bytes(path), 0, None, _as_numbers_are())
    if not scene:
        raise ValueError(library.aiGetErrorString().decode("utf-8", "replace"))
    try:
        surfaces = list(_surfaces(scene.contents, scene.contents.root.contents, np.eye(4)))
    finally:
        library.aiReleaseImport(scene)
    if not surfaces:
        raise ValueError("no surfaces")
    corners, counts = zip(*surfaces, strict=True)
    return np.concatenate(corners), np.concatenate(counts)


def polygons_measured(corners: np.ndarray, counts: np.ndarray) -> Measured:
    """corners: (n, 3) m, polygon by polygon; counts: of each polygon."""
    starts = np.cumsum(counts) - counts
    after = np.arange(len(corners)) + 1
    after[starts + counts - 1] = starts
    # The volume of an open surface depends on this point, and one far away loses digits.
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    crosses = np.cross(corners - middle, corners[after] - middle)
    normals = np.add.reduceat(crosses, starts) / 2.0
    heights = np.einsum("ij,ij->i", normals, corners[starts] - middle)
    return Measured(
        float(np.linalg.norm(normals, axis=1).sum()),
        float(heights.sum() / 3.0),
        corners.min(axis=0),
        corners.max(axis=0),
    )


def _surfaces(
    scene: Scene, node: Node, above: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """(corners of all polygons, corners of each) of every mesh where its nodes put it."""
    X = above @ np.array(node.transform, dtype=np.float64).reshape(4, 4)
    for number in range(node.mesh_count):
        mesh = scene.meshes[node.meshes[number]].contents
        floats = ctypes.string_at(mesh.vertices, 12 * mesh.vertex_count)
        vertices = np.frombuffer(floats, dtype=np.float32).reshape(-1, 3).astype(np.float64)
        faces = [mesh.faces[i] for i in range(mesh.face_count)]
        faces = [(face.corners, face.count) for face in faces if face.count > 2]
        if faces:
            text = b"".join(ctypes.string_at(at, 4 * count) for at, count in faces)
            index = np.frombuffer(text, dtype=np.uint32)
            sign = np.sign(np.linalg.det(X[:3, :3]))
            counts = np.array([count for _, count in faces])
            corners = vertices[index] @ X[:3, :3].T + X[:3, 3]
            yield (corners, counts) if sign > 0 else (corners[::-1], counts[::-1])
    for number in range(node.child_count):
        yield from _surfaces(scene, node.children[number].contents, X)


@functools.cache
def _library() -> ctypes.CDLL:
    (path,) = [
        f for f in files("cmeel-assimp") or () if f.name in ("libassimp.so", "libassimp.dylib")
    ]
    library = ctypes.CDLL(str(path.locate()))
    library.aiImportFileExWithProperties.restype = POINTER(Scene)
    library.aiImportFileExWithProperties.argtypes = (c_char_p, c_uint32, c_void_p, c_void_p)
    library.aiReleaseImport.argtypes = (POINTER(Scene),)
    library.aiGetErrorString.restype = c_char_p
    library.aiCreatePropertyStore.restype = c_void_p
    library.aiSetImportPropertyInteger.argtypes = (c_void_p, c_char_p, c_int)
    return library


@functools.cache
def _as_numbers_are() -> int:
    """Properties: COLLADA's up axis is not applied, as RViz and coal read."""
    store = _library().aiCreatePropertyStore()
    _library().aiSetImportPropertyInteger(store, b"IMPORT_COLLADA_IGNORE_UP_DIRECTION", 1)
    return int(store)
