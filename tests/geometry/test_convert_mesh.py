"""Meshes and pictures are converted, measured, and refused in one sentence."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from PIL.PngImagePlugin import PngInfo
from robot_files import run_step
from tiny import box_obj, stl

from assetbuild.errors import StepError
from assetbuild.geometry.companion_files import ConvertTexture
from assetbuild.geometry.convert_mesh import ConvertMesh
from assetbuild.mesh.arrays import PARTS, read_meshes
from assetbuild.mesh.material import ConvertedMesh, SurfaceMaterial
from assetbuild.mesh.obj import read_triangles
from assetbuild.mesh.triangles import area, merged, signed_volume
from assetbuild.robot.codec import decode

GO1_MESHES = (
    "calf",
    "depthCamera",
    "hip",
    "thigh",
    "thigh_mirror",
    pytest.param("trunk", marks=pytest.mark.slow),  # 260,000 faces
    "ultraSound",
)


def convert(tmp_path: Path, data: bytes, **fields):
    """(record, first part, findings, all bytes written)."""
    inputs, outputs = tmp_path / "in", tmp_path / f"out{len(list(tmp_path.glob('out*')))}"
    inputs.mkdir(exist_ok=True)
    outputs.mkdir()
    (inputs / "mesh").write_bytes(data)
    findings = run_step(ConvertMesh(**fields), inputs, outputs)
    record = decode(ConvertedMesh, (outputs / "mesh.json").read_bytes())
    files = {p.name: p.read_bytes() for p in sorted(outputs.rglob("*")) if p.is_file()}
    mesh = read_meshes(outputs / PARTS, surface=True)["0"]
    return record, mesh, findings, files


BOX = read_triangles(box_obj((1.0, 2.0, 4.0)))


def test_an_stl_is_welded_measured_and_written(tmp_path):
    record, mesh, findings, _ = convert(tmp_path, stl(BOX.corners), format="stl")
    assert (record.faces, len(mesh.vertices)) == (12, 8)
    assert record.volume_m3 == pytest.approx(8.0)
    assert (record.lower, record.upper) == ((-0.5, -1.0, -2.0), (0.5, 1.0, 2.0))
    assert record.materials == (SurfaceMaterial(),)
    assert findings == []


def test_scale_is_baked_and_a_mirroring_one_keeps_the_volume_positive(tmp_path):
    scale = (0.001, -0.001, 0.002)
    record, mesh, _, _ = convert(tmp_path, stl(BOX.corners), format="stl", scale=scale)
    assert signed_volume(mesh) == pytest.approx(16e-9)
    assert record.upper == pytest.approx((0.0005, 0.001, 0.004))


def test_a_file_saved_again_gives_the_same_bytes(tmp_path):
    *_, first = convert(tmp_path, stl(BOX.corners, b"CAD 1, Monday"), format="stl")
    *_, again = convert(tmp_path, stl(BOX.corners, b"solid CAD 2, Tuesday"), format="stl")
    assert first == again


PALETTE = {"p.mtl": b"".join(b"newmtl %c\nKd %d 0 0\n" % (c, i) for i, c in enumerate(b"abc"))}


def test_parts_follow_the_first_use_of_their_material(tmp_path):
    data = b"mtllib p.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n" + b"".join(
        b"usemtl %s\nf %s\n" % pair
        for pair in [(b"b", b"1 3 2"), (b"a", b"1 2 4"), (b"b", b"1 4 3"), (b"c", b"2 3 4")]
    )
    record, _, _, files = convert_with(tmp_path, data, PALETTE)
    faces = [len(mesh.faces) for mesh in read_meshes(tmp_path / "out0" / PARTS).values()]
    assert ([m.name for m in record.materials], faces) == (["b", "a", "c"], [2, 3, 3])
    assert record.volume_m3 == pytest.approx(1 / 6)  # the parts close one another
    assert set(files) == {"meshes.npz", "mesh.json"}


TRIANGLE = (
    b"mtllib ./a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 9\nvt 0 0\nvt 1 0\nusemtl m\n"
    b"f 1/1 2/2 3/1\nf 1/1 2/1 4/1\n"
)


def saved(image: Image.Image | None = None, size=(2, 2), format="PNG", **how) -> bytes:
    """A picture file, of red alone unless an image is given."""
    out = io.BytesIO()
    (image or Image.new("RGB", size, (255, 0, 0))).save(out, format=format, **how)
    return out.getvalue()


def convert_with(tmp_path: Path, data: bytes, companions: dict[str, bytes], **fields):
    """An OBJ with the files beside it."""
    folder = tmp_path / "in" / "companions"
    folder.mkdir(parents=True, exist_ok=True)
    for number, content in enumerate(companions.values()):
        (folder / str(number)).write_bytes(content)
    return convert(tmp_path, data, companions=tuple(companions), format="obj", **fields)


def convert_worn(tmp_path: Path, picture: bytes, mesh: bytes = TRIANGLE):
    """A triangle that wears a picture."""
    files = {"a.mtl": b"newmtl m\nmap_Kd w.png\n", "w.png": picture}
    return convert_with(tmp_path, mesh, files)


def test_texture_coordinates_stay_only_with_a_texture(tmp_path):
    plain = {"a.mtl": b"newmtl m\nKd 1 0 0\n"}
    _, mesh, findings, _ = convert_with(tmp_path, TRIANGLE, plain)
    assert mesh.uv is None
    assert [f.rule for f in findings] == ["mesh.uv"]
    _, mesh, findings, _ = convert_with(tmp_path, TRIANGLE, plain, keep_uv=True)
    assert mesh.uv[:1].tolist() == [[[0, 0], [1, 0], [0, 0]]]
    assert findings == []


def test_a_texture_becomes_a_png_beside_its_part(tmp_path):
    red = saved(size=(3, 2), format="JPEG")
    files = {"a.mtl": b"newmtl m\nKd 0 0 0\nmap_Kd -s 1 1 1 my wood.jpg\n", "my wood.jpg": red}
    record, mesh, findings, written = convert_with(tmp_path, TRIANGLE, files)
    (material,) = record.materials
    assert findings == []
    assert mesh.uv[:1].tolist() == [[[0, 0], [1, 0], [0, 0]]]
    assert material.rgba == (1.0, 1.0, 1.0, 1.0)  # black would hide the picture
    picture = Image.open(io.BytesIO(written[material.texture]))
    assert (picture.format, picture.size, picture.mode) == ("PNG", (3, 2), "RGB")
    assert material.texture.startswith("my_wood-")


def test_a_picture_saved_with_another_date_gives_the_same_bytes(tmp_path):
    info = PngInfo()
    info.add_text("date", "Monday")
    noted = saved(pnginfo=info, dpi=(72, 72))
    assert noted != saved()
    assert convert_worn(tmp_path, noted)[3] == convert_worn(tmp_path, saved())[3]


@pytest.mark.parametrize(
    ("stated", "companions", "says"),
    [
        ("w.png", {}, "is not in the source"),
        ("../../../etc/w.png", {}, "is not in the source"),
        ("C:\\pictures\\w.png", {}, "is not in the source"),
        ("w.png", {"w.png": b"no picture"}, "not readable as a picture"),
        ("w.png", {"w.png": saved()[:45]}, "not readable as a picture"),
    ],
)
def test_a_mesh_without_its_texture_is_built_in_one_colour(tmp_path, stated, companions, says):
    library = f"newmtl m\nKd 1 0 0\nmap_Kd {stated}\n".encode()
    record, _, findings, _ = convert_with(tmp_path, TRIANGLE, {"a.mtl": library, **companions})
    assert (record.materials[0].texture, record.materials[0].rgba) == (None, (1.0, 0.0, 0.0, 1.0))
    (finding,) = [f for f in findings if f.rule == "mesh.texture"]
    assert says in finding.message


@pytest.mark.parametrize(("alpha", "told"), [(255, []), (254, ["mesh.texture_alpha"])])
def test_transparent_parts_of_a_texture_are_told(tmp_path, alpha, told):
    picture = saved(Image.new("RGBA", (2, 2), (255, 0, 0, alpha)))
    *_, findings, _ = convert_worn(tmp_path, picture)
    assert [f.rule for f in findings] == told


def test_a_picture_of_sixteen_bits_keeps_its_tone(tmp_path):
    deep = saved(Image.fromarray(np.full((2, 2), 0x80FF, dtype=np.uint16)))
    record, *_, written = convert_worn(tmp_path, deep)
    picture = Image.open(io.BytesIO(written[record.materials[0].texture]))
    assert picture.getpixel((0, 0)) == (128,) * 3  # 0x80FF of 0xFFFF is 128.49 of 255


def test_a_texture_bomb_is_refused_before_it_is_decoded(tmp_path):
    width = struct.pack(">I", 30_000)
    bomb = saved().replace(struct.pack(">II", 2, 2), width + width, 1)
    head = bomb[12:29]  # the header's checksum covers its type and data
    bomb = bomb.replace(bomb[29:33], struct.pack(">I", zlib.crc32(head)), 1)
    with pytest.raises(StepError, match=r"picture `w.png` is too large"):
        convert_worn(tmp_path, bomb)


def test_collapsed_triangles_are_left_out_and_counted(tmp_path):
    flat = np.concatenate([BOX.corners, np.repeat(BOX.corners[:2, :1], 3, axis=1)])
    record, _, findings, _ = convert(tmp_path, stl(flat), format="stl")
    assert record.faces == 12
    assert [(f.rule, f.data["dropped"]) for f in findings] == [("mesh.collapsed_faces", 2)]


def test_a_mesh_that_is_inside_out_is_told(tmp_path):
    *_, findings, _ = convert(tmp_path, stl(BOX.corners[:, ::-1]), format="stl")
    assert [(f.rule, f.severity) for f in findings] == [("mesh.inside_out", "warning")]


def test_normals_are_kept_and_missing_ones_are_those_of_the_face(tmp_path):
    corners = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 3 4\nvn 0 0 0\n"
    text = corners + b"f 1//1 2//1 3//2\nf 1//1 2//1 4//1\n"
    normals = convert(tmp_path, text, format="obj")[1].normals[0]
    assert normals.tolist() == [[0.0, 0.6, 0.8], [0.0, 0.6, 0.8], [0.0, 0.0, 1.0]]


def test_scale_zero_is_an_error(tmp_path):
    with pytest.raises(StepError, match="scaled to zero"):
        convert(tmp_path, stl(BOX.corners), format="stl", scale=(1.0, 0.0, 1.0))


@pytest.mark.parametrize("name", GO1_MESHES)
def test_each_mesh_of_go1_arrives_whole(tmp_path, go1_root, name):
    path = go1_root / "robots/go1_description/meshes" / f"{name}.dae"
    scene = trimesh.load_scene(path, process=False)
    other = [g for g in scene.dump() if hasattr(g, "faces")]
    record, _, findings, _ = convert(tmp_path, path.read_bytes(), format="dae")
    whole = merged([*read_meshes(tmp_path / "out0" / PARTS).values()])
    assert record.faces == sum(len(g.faces) for g in other)
    assert np.allclose([record.lower, record.upper], scene.bounds, atol=1e-7)
    assert area(whole) == pytest.approx(sum(g.area for g in other), rel=1e-5)
    told = [f.rule for f in findings]
    assert told == (["mesh.up_axis"] if name == "trunk" else [])
    material = record.materials[0].name
    expected = {"depthCamera": "材质", "trunk": None, "hip": "Material.029"}
    assert material == expected.get(name, material)


ONE = np.array([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])


def test_a_single_triangle_gets_a_fourth_corner_on_its_surface(tmp_path):
    record, mesh, findings, _ = convert(tmp_path, stl(ONE), format="stl")
    assert findings == []
    assert (len(mesh.vertices), record.faces) == (4, 3)
    assert area(mesh) == pytest.approx(1.0)
    assert not mesh.vertices[:, 2].any()
    normals = np.cross(*(mesh.corners[:, i] - mesh.corners[:, 0] for i in (1, 2)))
    assert (normals[:, 2] > 0.0).all()


def test_a_part_that_is_a_line_is_left_out_and_told(tmp_path):
    line = b"v 3 0 0\nv 4 0 0\nv 5 0 0\n"
    data = b"mtllib p.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n" + line
    data += b"usemtl a\nf 1 2 3\nusemtl b\nf 4 5 6\n"
    record, _, findings, _ = convert_with(tmp_path, data, PALETTE)
    assert [material.name for material in record.materials] == ["a"]
    assert "mesh.no_area" in [finding.rule for finding in findings]


def test_nothing_but_a_line_is_refused(tmp_path):
    with pytest.raises(StepError, match="no triangle has an area"):
        convert(tmp_path, stl(ONE * [1.0, 0.0, 1.0]), format="stl")


JPEG = saved(size=(64, 64), format="JPEG")


@pytest.mark.parametrize(
    "data", [JPEG, b"", JPEG[:200], b"<html>404</html>"], ids=["whole", "empty", "cut", "a page"]
)
def test_what_is_no_picture_is_told_and_leaves_no_file(data: bytes, tmp_path: Path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in/picture").write_bytes(data)
    found = run_step(ConvertTexture(name="wood.jpg"), tmp_path / "in", tmp_path / "out")
    made = tmp_path / "out/texture/texture.png"
    if data == JPEG:
        assert (found, Image.open(made).size) == ([], (64, 64))
    else:
        assert ([f.rule for f in found], made.exists()) == (["texture.unreadable"], False)


def test_a_texture_without_coordinates_is_told(tmp_path):
    bare = TRIANGLE.replace(b"1/1 2/2 3/1", b"1 2 3")
    record, _, findings, _ = convert_worn(tmp_path, saved(), bare)
    assert record.materials[0].texture is None
    assert "no texture coordinates" in findings[0].message
    assert findings[0].hint == "unwrap the mesh"
