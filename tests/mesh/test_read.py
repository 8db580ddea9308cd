"""Mesh files of every format are read, or refused in one sentence, and so are their companions."""

from __future__ import annotations

import io
import json
import time

import mujoco
import numpy as np
import pytest
import trimesh
from daes import dae
from PIL import Image
from tiny import stl

from assetbuild.errors import StepError
from assetbuild.mesh.companions import companions_of, relative_name
from assetbuild.mesh.material import SurfaceMaterial
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.read import read_mesh
from assetbuild.mesh.triangles import area, signed_volume
from assetbuild.robot.shapes import Box

BOX = tessellate(Box((1.0, 2.0, 3.0)))


def rules(source) -> dict[str, dict]:
    return {f.rule: dict(f.data) for f in source.findings}


def test_a_binary_stl_that_begins_with_solid_is_binary():
    (part,) = read_mesh(stl(BOX.corners, b"solid made by CAD"), "stl").parts
    assert np.array_equal(part.mesh.corners, BOX.corners)


@pytest.mark.parametrize("header", [b"", b"solid facet"])
def test_a_few_bytes_after_the_last_triangle_are_left_out_and_said(header):
    source = read_mesh(stl(BOX.corners, header) + b"\r\n", "stl")
    assert np.array_equal(source.parts[0].mesh.corners, BOX.corners)
    assert list(rules(source)) == ["mesh.stray_bytes"]


def msh(faces: int = 12) -> bytes:
    """The box as MuJoCo's MSH, with normals and texture coordinates. faces: what it promises."""
    count = len(BOX.vertices)
    floats = [BOX.vertices.ravel(), np.tile([0.0, 0.0, 1.0], count), np.zeros(2 * count)]
    parts = np.array([count, count, count, faces], "<i4"), np.concatenate(floats).astype("<f4")
    return b"".join(part.tobytes() for part in (*parts, BOX.faces.astype("<i4")))


def test_an_msh_is_read_as_mujoco_reads_it():
    (part,) = read_mesh(msh(), "msh").parts
    assert np.array_equal(part.mesh.corners, BOX.corners)
    text = """<mujoco><asset><mesh file="b.msh"/></asset><worldbody><body>
      <geom type="mesh" mesh="b" density="10"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text, {"b.msh": msh()})
    assert model.body_mass[1] == pytest.approx(10.0 * signed_volume(part.mesh))


@pytest.mark.parametrize("change", [bytes.upper, lambda text: b"\xef\xbb\xbf" + text])
def test_a_text_stl_in_capitals_or_with_a_byte_order_mark_is_read(change):
    text = trimesh.Trimesh(BOX.vertices, BOX.faces, process=False).export(file_type="stl_ascii")
    (part,) = read_mesh(change(text.encode()), "stl").parts
    assert part.mesh.corners == pytest.approx(BOX.corners)


def test_an_obj_takes_its_colours_from_its_library():
    corners = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    text = b"mtllib a.mtl\n" + corners + b"usemtl red\nf 1 2 3\nusemtl sky\nf 1 2 4"
    library = b"newmtl red\nKd 1 0 0\nnewmtl sky\nKd 0 0 1\nd 0.5\nmap_Kd sky.png\n"
    source = read_mesh(text, "obj", companions={"a.mtl": library})
    assert [p.material for p in source.parts] == [
        SurfaceMaterial("red", (1.0, 0.0, 0.0, 1.0)),
        SurfaceMaterial("sky", (0.0, 0.0, 1.0, 0.5), "sky.png"),
    ]
    assert not source.findings
    assert rules(read_mesh(text, "obj")) == {"mesh.no_mtl": {"libraries": ("a.mtl",)}}


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_ply_arrives(encoding):
    data = trimesh.Trimesh(BOX.vertices, BOX.faces, process=False).export(
        file_type="ply", encoding=encoding
    )
    (part,) = read_mesh(data, "ply").parts
    assert part.mesh.corners == pytest.approx(BOX.corners)


PLY = """ply
format ascii 1.0
element vertex 8
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
element face {count}
property list uchar int vertex_indices
end_header
{vertices}
{faces}
"""
QUADS = ("0 1 3 2", "4 6 7 5", "0 4 5 1", "2 3 7 6", "0 2 6 4", "1 5 7 3")


@pytest.mark.parametrize("split", [0, 1, 6], ids=["quads alone", "both", "triangles alone"])
def test_a_ply_of_quads_has_the_right_shape(split):
    rows = [QUADS[k].split() for k in range(6)]
    faces = [f"4 {' '.join(r)}" for r in rows[split:]]
    for a, b, c, d in rows[:split]:
        faces += [f"3 {a} {b} {c}", f"3 {a} {c} {d}"]
    corners = "\n".join(f"{x} {y} {z} 9 9 9" for x in (0, 1) for y in (0, 1) for z in (0, 1))
    text = PLY.format(count=len(faces), vertices=corners, faces="\n".join(faces))
    source = read_mesh(text.encode(), "ply")
    assert abs(signed_volume(source.parts[0].mesh)) == pytest.approx(1.0)
    assert area(source.parts[0].mesh) == pytest.approx(6.0)
    assert rules(source) == {"mesh.vertex_colours": {}}


def test_colours_of_vertices_are_told_as_left_out():
    text = b"v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nf 1 2 3\n"
    assert "mesh.vertex_colours" in rules(read_mesh(text, "obj"))
    mesh = trimesh.Trimesh(BOX.vertices, BOX.faces, process=False)
    mesh.visual.vertex_colors = np.arange(4 * len(BOX.vertices)).reshape(-1, 4) % 255
    assert "mesh.vertex_colours" in rules(read_mesh(mesh.export(file_type="glb"), "glb"))
    blue = b'<input semantic="VERTEX" source="#v" offset="0"/><input semantic="COLOR" '
    blue += b'source="#pos" offset="0"/>'
    data = dae().replace(b'<input semantic="VERTEX" source="#v" offset="0"/>', blue)
    assert "mesh.vertex_colours" in rules(read_mesh(data, "dae"))


def test_a_glb_arrives_with_nodes_materials_and_colours():
    scene = trimesh.Scene()
    for name, x, colour in (("a", 0.0, (128, 0, 1, 128)), ("b", 5.0, (0, 0, 255, 255))):
        material = trimesh.visual.material.PBRMaterial(name=f"paint {name}", baseColorFactor=colour)
        mesh = trimesh.Trimesh(BOX.vertices, BOX.faces, process=False)
        mesh.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(mesh, transform=trimesh.transformations.translation_matrix([x, 0, 0]))
    source = read_mesh(scene.export(file_type="glb"), "glb")
    assert [p.material.name for p in source.parts] == ["paint a", "paint b"]
    half = (188 / 255, 0.0, 12.92 / 255, 128 / 255)  # screens show half the light as 188 of 255
    assert source.parts[0].material.rgba == pytest.approx(half, abs=1 / 255)
    assert source.parts[1].material.rgba == (0.0, 0.0, 1.0, 1.0)
    assert source.parts[1].mesh.bounds[0] == pytest.approx([4.5, -1.0, -1.5])
    assert rules(source)["mesh.up_axis"]["honoured"] is False


def textured_box(image: Image.Image | None = None) -> trimesh.Scene:
    """A box that wears a picture, one corner of which is marked by its coordinates."""
    uv = np.linspace(0.0, 1.0, 2 * len(BOX.vertices)).reshape(-1, 2)
    picture = image or Image.new("RGB", (4, 2), (255, 0, 0))
    material = trimesh.visual.material.PBRMaterial(
        name="skin", baseColorTexture=picture, baseColorFactor=(255, 255, 0, 255)
    )
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    return trimesh.Scene(trimesh.Trimesh(BOX.vertices, BOX.faces, visual=visual, process=False))


def test_a_glb_brings_its_own_pictures():
    source = read_mesh(textured_box().export(file_type="glb"), "glb")
    (part,) = source.parts
    assert part.material == SurfaceMaterial("skin", (1.0, 1.0, 0.0, 1.0), "skin.png")
    picture = Image.open(io.BytesIO(source.pictures["skin.png"]))
    assert (picture.format, picture.size) == ("PNG", (4, 2))
    wanted = np.linspace(0.0, 1.0, 2 * len(BOX.vertices)).reshape(-1, 2)[BOX.faces]
    assert part.mesh.uv == pytest.approx(wanted, abs=1e-6)


def test_a_gltf_reads_its_companions_and_nothing_else():
    files = textured_box().export(file_type="gltf")
    main = json.loads(files.pop("model.gltf"))
    main["images"] = [{"uri": "my%20skin.png"}]
    text = json.dumps(main).encode()
    out = io.BytesIO()
    Image.new("RGB", (4, 2), (255, 0, 0)).save(out, format="PNG")
    source = read_mesh(text, "gltf", companions={**files, "my skin.png": out.getvalue()})
    assert source.parts[0].material.texture in source.pictures
    assert len(source.parts[0].mesh.faces) == 12
    source = read_mesh(text, "gltf", companions=files)
    assert source.parts[0].material.texture == "skin"
    assert source.pictures == {}  # told as lost
    with pytest.raises(StepError, match=r"its buffer `gltf_buffer_0.bin` is not in the source\n"):
        read_mesh(text, "gltf")


def glb_with(change) -> bytes:
    """A box as GLB, its header changed."""
    data = trimesh.Trimesh(BOX.vertices, BOX.faces, process=False).export(file_type="glb")
    length = int.from_bytes(data[12:16], "little")
    header = json.loads(data[20 : 20 + length])
    change(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    rest = len(text).to_bytes(4, "little") + b"JSON" + text + data[20 + length :]
    return data[:8] + (12 + len(rest)).to_bytes(4, "little") + rest


def test_bytes_after_the_end_of_a_glb_are_left_out_and_said():
    plain = glb_with(lambda header: header.update(extensionsRequired=["KHR_materials_ior"]))
    source = read_mesh(plain + b"garbage", "glb")
    assert area(source.parts[0].mesh) == pytest.approx(area(BOX))
    assert "mesh.stray_bytes" in rules(source)


def test_a_picture_that_is_too_large_is_refused_in_a_glb_too():
    wide = Image.new("1", (12_000, 6_000))
    with pytest.raises(StepError, match="too large: 12000 x 6000"):
        read_mesh(textured_box(wide).export(file_type="glb"), "glb")


def with_fans(header: dict) -> None:
    header["meshes"][0]["primitives"][0].update(mode=6)


def with_draco(header: dict) -> None:
    header.update(extensionsRequired=["KHR_draco_mesh_compression"])


COUNTS = "its counts do not match its size"
RUBBISH = b"\x00\x01rubbish" * 20


@pytest.mark.parametrize(
    ("format", "data", "says"),
    [
        ("stl", stl(BOX.corners, count=13), "13 faces, which is 734 bytes, the file has 684"),
        ("stl", stl(BOX.corners)[:-7], "promises 12 faces"),
        ("stl", stl(BOX.corners) + bytes(50), "promises 12 faces"),
        ("stl", stl(BOX.corners[:0]), "no triangles"),
        ("stl", stl(np.full((2, 3, 3), np.nan)), "vertex 0 is not a finite number"),
        ("stl", b"solid x\n facet normal 0 0 1\n  outer loop\n   vertex 0 0", "cut off at line 4"),
        ("stl", b"short", "too few"),
        *(("msh", data, COUNTS) for data in (msh(11), msh()[:-4], msh()[:10], msh(-1))),
        # What would be lost without a word.
        ("glb", glb_with(with_fans), "triangle fan"),
        ("glb", glb_with(with_draco), "`KHR_draco"),
        *((format, RUBBISH, None) for format in ("ply", "glb", "gltf", "obj")),
    ],
)
def test_a_broken_mesh_is_one_error(format, data, says):
    with pytest.raises(StepError, match=says):
        read_mesh(data, format)


DAE = b"""<COLLADA><library_images>
 <image id="a"><init_from>skin%20one.png</init_from></image>
 <x:image id="b"><x:init_from><x:ref>./tex/two&amp;.jpg</x:ref></x:init_from></x:image>
 <image id="c"><init_from>file:///home/me/three.png</init_from></image></library_images>
 <surface type="2D"><init_from>a</init_from></surface></COLLADA>"""
MTL = b"""newmtl m
 map_Kd -blendu on -s 2 2 1 -o 0.5 my wood.png\r
map_Kd  textures\\two  spaces.jpg
map_Bump bump.png
"""
GLTF = {
    "buffers": [{"uri": "a%20b.bin"}, {"uri": "data:application/octet-stream;base64,AAAA"}],
    "images": [{"uri": "../w.png"}, {"bufferView": 0}],
}


@pytest.mark.parametrize(
    ("format", "data", "names"),
    [
        ("dae", DAE, ("skin one.png", "tex/two&.jpg")),
        ("mtl", MTL, ("my wood.png", "textures/two  spaces.jpg")),
        ("obj", b"# mtllib no.mtl\nmtllib ./my parts.mtl\r\nv 0 0 0\n", ("my parts.mtl",)),
        ("gltf", json.dumps(GLTF).encode(), ("../w.png", "a b.bin")),
        ("gltf", b"{", ()),
        ("gltf", b'{"images": [3, {"uri": 4}], "buffers": {"a": 1}}', ()),
        ("dae", b"\xff\xfe<image", ()),
    ],
)
def test_names_are_found_in_one_spelling(format, data, names):
    assert companions_of(data, format) == names


ELSEWHERE = ["/etc/passwd", "C:\\a.png", "http://x/y.png", "", ".", "a/"]
IMPOSSIBLE = ["a" * 256, "a/" * 600 + "b", "a\0b", "\ud800"]


@pytest.mark.parametrize("stated", [*ELSEWHERE, *IMPOSSIBLE])
def test_what_leads_elsewhere_is_no_companion(stated):
    assert relative_name(stated) is None


@pytest.mark.parametrize(
    "piece", [b"<image>", b"<image ", b"<init_from>", b"<" + b"a" * 50, b"\n "]
)
def test_no_file_takes_more_than_a_pass(piece):
    started = time.process_time()
    for format in ("dae", "obj", "mtl", "gltf"):
        assert companions_of(piece * (3_000_000 // len(piece)), format) == ()
    assert time.process_time() - started < 5.0  # a quadratic search takes hours
