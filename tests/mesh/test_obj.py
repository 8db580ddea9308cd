"""What we write we read back to the bit; what others write we read, or say why not."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from assetbuild.errors import StepError
from assetbuild.mesh.obj import obj_bytes, parse_obj, read_triangles
from assetbuild.mesh.triangles import TriangleMesh

TRIANGLES = np.array([[0, 1, 2], [2, 1, 3]])


@given(npst.arrays(np.float64, (4, 3), elements=st.floats(allow_nan=False, allow_infinity=False)))
def test_every_float_survives_to_the_bit(vertices):
    read = read_triangles(obj_bytes(TriangleMesh(vertices, TRIANGLES)))
    assert np.array_equal(read.vertices, vertices)
    assert np.array_equal(read.faces, TRIANGLES)


@pytest.mark.parametrize("with_uv", [False, True])
@pytest.mark.parametrize("with_normals", [False, True])
def test_texture_and_normals_survive_per_corner(with_uv, with_normals):
    rng = np.random.default_rng(0)
    mesh = TriangleMesh(
        rng.random((4, 3)),
        TRIANGLES,
        rng.random((2, 3, 2)) if with_uv else None,
        rng.random((2, 3, 3)) if with_normals else None,
    )
    data = obj_bytes(mesh)
    read = read_triangles(data)
    for name in ("vertices", "faces", "uv", "normals"):
        assert np.array_equal(getattr(read, name), getattr(mesh, name)), name
    assert obj_bytes(read) == data


def test_foreign_text_polygons_negative_indices_comments_and_materials():
    text = b"""# exporter 1.0
mtllib parts.mtl
o thing
v 0 0 0 1 0 0
v 1 0 0 1 0 0
v 1 1 0 1 0 0
v 0 1 0 1 0 0
vt 0.5
vn 0 0 1
usemtl red paint
f 1/1/1 2/1/1 3/1/1 4/1/1
usemtl blue
f -4//1 -2//-1 \\
  -1//1
l 1 2
"""
    obj = parse_obj(text, "mesh")
    (red, red_mesh), (blue, blue_mesh) = obj.parts
    assert (red, blue) == ("red paint", "blue")
    assert red_mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert blue_mesh.faces.tolist() == [[0, 2, 3]]
    assert blue_mesh.uv is None
    assert blue_mesh.normals[0].tolist() == [[0, 0, 1]] * 3
    assert obj.libraries == ("parts.mtl",)
    assert obj.skipped == {"l": 1}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "line 4: index 9 of `v`, there are 3"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n\nf 1 2\nf 1 2 9\n", "line 6: index 9"),
        (b"v 0 0 0\nv 1 x 0\nv 0 1 0\nf 1 2 3\n", "line 2: not 3 numbers"),
        (b"v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", "line 2: not 3 numbers"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 three\n", "line 4: face indices"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "line 4: index 0 of `v`"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -9 1 2\n", "line 4: index"),
    ],
)
def test_a_broken_line_is_named(text, says):
    with pytest.raises(StepError, match=says) as caught:
        read_triangles(text, "mesh meshes/bad.obj")
    assert "mesh meshes/bad.obj" in str(caught.value)


TETRAHEDRON = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize(
    ("text", "skipped", "lost"),
    [
        (TETRAHEDRON.replace(b" ", b"\t"), {}, ()),
        (TETRAHEDRON.replace(b"\n", b"\r"), {}, ()),
        (TETRAHEDRON + b"f 1 2\nf 3\n", {"f": 2}, ()),
        (TETRAHEDRON.replace(b"f 1 2 4", b"f 1/7/1 2/8/1 4/9/1"), {}, ("vn", "vt")),
        (TETRAHEDRON.replace(b"f 2 3 4", b"f -3 -2 -1"), {}, ()),
    ],
)
def test_text_that_other_readers_take_is_taken(text, skipped, lost):
    obj = parse_obj(text, "mesh")
    ((_, mesh),) = obj.parts
    assert mesh.faces.tolist() == [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    assert (obj.skipped, obj.lost) == (skipped, lost)


@pytest.mark.parametrize("corner", range(8))
def test_skew_quads_are_cut_as_mujoco_cuts_them(corner: int):
    box = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (0.0, 3.0)])
    box[corner] += (0.11, -0.07, 0.13)
    quads = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
    lines = [*(f"v {x} {y} {z}" for x, y, z in box), *(f"f {quad}" for quad in quads)]
    text = "\n".join(lines).encode()
    xml = (
        "<mujoco><asset><mesh file='a.obj'/></asset>"
        "<worldbody><geom type='mesh' mesh='a'/></worldbody></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(xml, {"a.obj": text})
    ours = read_triangles(text)
    theirs = model.mesh_vert[model.mesh_face]
    assert volume_of(ours.vertices[ours.faces]) == pytest.approx(volume_of(theirs), rel=1e-6)


def volume_of(triangles: np.ndarray) -> float:
    """(k, 3, 3) m; m3."""
    a, b, c = np.moveaxis(np.asarray(triangles, dtype=float), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def test_negative_indices_count_back_in_each_table_for_itself():
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf -3/-1 -2/-1 -1/-1\nvt 1 1\nv 5 5 5\n"
    ((_, mesh),) = parse_obj(text, "mesh").parts
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert mesh.uv.tolist() == [[[0, 0]] * 3]
