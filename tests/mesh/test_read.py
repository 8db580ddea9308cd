"""Mesh files of every format: what is in them arrives, what is broken is named."""

from __future__ import annotations

import io
import json
import re

import numpy as np
import pytest
import trimesh
from PIL import Image
from tiny import stl

from assetbuild.errors import StepError
from assetbuild.mesh.material import SurfaceMaterial
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.read import read_mesh
from assetbuild.mesh.triangles import merged
from assetbuild.mesh.volume import area, signed_volume
from assetbuild.mesh.weld import cleaned
from assetbuild.robot.shapes import Box

BOX = tessellate(Box((1.0, 2.0, 3.0)))

DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset><created>{date}</created><modified>{date}</modified>
  <unit name="x" meter="{unit}"/><up_axis>{up}</up_axis></asset>
 <library_cameras><camera id="cam"><optics><technique_common><perspective>
  <yfov>1</yfov><znear>0.1</znear><zfar>9</zfar></perspective></technique_common></optics></camera>
 </library_cameras>
 <library_effects>
  <effect id="e1"><profile_COMMON><technique sid="c"><lambert><diffuse>
   <color>0.1 0.2 0.3 1</color></diffuse></lambert></technique></profile_COMMON></effect>
  <effect id="e2"><profile_COMMON><technique sid="c"><lambert><diffuse>
   <color>0.9 0.8 0.7 0.5</color></diffuse></lambert></technique></profile_COMMON></effect>
 </library_effects>
 <library_materials>
  <material id="m1" name="材质"><instance_effect url="#e1"/></material>
  <material id="m2" name="red"><instance_effect url="#e2"/></material>
 </library_materials>
 <library_geometries><geometry id="g"><mesh>
  <source id="pos"><float_array id="pa" count="24">{positions}</float_array>
   <technique_common><accessor source="#pa" count="8" stride="3">
   <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
   </accessor></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#pos"/></vertices>
  <triangles material="s1" count="4"><input semantic="VERTEX" source="#v" offset="0"/>
   <p>0 1 3 0 3 2 4 6 7 4 7 5</p></triangles>
  <polylist material="s2" count="2"><input semantic="VERTEX" source="#v" offset="0"/>
   <vcount>4 4</vcount><p>0 4 5 1 2 3 7 6</p></polylist>
  <polygons material="s2" count="2"><input semantic="VERTEX" source="#v" offset="0"/>
   <p>0 2 6 4</p><p>1 5 7 3</p></polygons>
  <lines material="s1" count="1"><input semantic="VERTEX" source="#v" offset="0"/>
   <p>0 7</p></lines>
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="s">
  <node id="outer"><translate>10 0 0</translate>
   <node id="plain"><instance_geometry url="#g"><bind_material><technique_common>
    <instance_material symbol="s1" target="#m1"/><instance_material symbol="s2" target="#m2"/>
   </technique_common></bind_material></instance_geometry></node>
   <node id="mirror"><matrix>-1 0 0 -3  0 1 0 0  0 0 1 0  0 0 0 1</matrix>
    <instance_geometry url="#g"><bind_material><technique_common>
    <instance_material symbol="s1" target="#m1"/><instance_material symbol="s2" target="#m2"/>
   </technique_common></bind_material></instance_geometry></node>
  </node></visual_scene></library_visual_scenes>
 <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"""
CUBE = "0 0 0  0 0 1  0 1 0  0 1 1  1 0 0  1 0 1  1 1 0  1 1 1"


def dae(positions=CUBE, unit="0.01", up="Z_UP", date="2024-01-01T00:00:00") -> bytes:
    text = DAE.format(positions=positions, unit=unit, up=up, date=date)
    return text.encode()


def rules(source) -> dict[str, dict]:
    return {f.rule: dict(f.data) for f in source.findings}


def test_a_dae_gives_its_materials_nodes_polygons_and_unit():
    source = read_mesh(dae(), "dae")
    assert [p.material for p in source.parts] == [
        SurfaceMaterial("材质", (0.1, 0.2, 0.3, 1.0)),
        SurfaceMaterial("red", (0.9, 0.8, 0.7, 0.5)),
    ]
    assert [len(p.mesh.faces) for p in source.parts] == [8, 16]
    whole = cleaned(merged([p.mesh for p in source.parts]))
    # Two unit cubes in centimetres, one mirrored; a wrong winding would cancel the volume.
    assert signed_volume(whole) == pytest.approx(2e-6, rel=1e-12)
    assert area(whole) == pytest.approx(12e-4, rel=1e-12)
    lower, upper = whole.bounds
    assert lower == pytest.approx([0.06, 0.0, 0.0])
    assert upper == pytest.approx([0.11, 0.01, 0.01])
    assert rules(source) == {
        "mesh.skipped": {"cameras": 1, "lines": 2},
        "mesh.unit": {"unit_m": 0.01},
    }


def test_each_mirrored_cube_faces_outwards():
    source = read_mesh(dae(unit="1"), "dae")
    whole = merged([p.mesh for p in source.parts])
    left = whole.corners[:, :, 0].max(axis=1) < 8.0
    assert signed_volume(cleaned(whole.select(left))) == pytest.approx(1.0)
    assert signed_volume(cleaned(whole.select(~left))) == pytest.approx(1.0)


def test_a_false_up_axis_is_ignored_and_said_or_honoured_when_asked():
    ignored = read_mesh(dae(up="Y_UP"), "dae")
    honoured = read_mesh(dae(up="Y_UP"), "dae", up_axis="honour")
    assert rules(ignored)["mesh.up_axis"] == {"stated": "Y_UP", "honoured": False}
    assert rules(honoured)["mesh.up_axis"] == {"stated": "Y_UP", "honoured": True}
    plain, turned = (merged([p.mesh for p in s.parts]) for s in (ignored, honoured))
    assert turned.vertices[:, 2] == pytest.approx(plain.vertices[:, 1])
    assert turned.vertices[:, 1] == pytest.approx(-plain.vertices[:, 2])
    assert signed_volume(cleaned(turned)) == pytest.approx(signed_volume(cleaned(plain)))


def test_x_up_lets_x_point_up():
    turned = read_mesh(dae(up="X_UP", unit="1"), "dae", up_axis="honour")
    lower, upper = merged([p.mesh for p in turned.parts]).bounds
    assert (lower[2], upper[2]) == pytest.approx((6.0, 11.0))


def test_a_dae_without_any_material_is_fine():
    bare = dae().replace(b' material="s1"', b"").replace(b' material="s2"', b"")
    (part,) = read_mesh(bare, "dae").parts
    assert part.material == SurfaceMaterial()
    assert len(part.mesh.faces) == 24


def test_a_shape_survives_a_material_that_is_missing():
    """pycollada would leave out the whole geometry: this robot's foot was lost."""
    whole = read_mesh(dae(), "dae")
    lost = re.sub(rb'<material id="m1".*?</material>', b"", dae(), flags=re.S)
    assert lost != dae()
    source = read_mesh(lost, "dae")
    assert sum(len(p.mesh.faces) for p in source.parts) == sum(
        len(p.mesh.faces) for p in whole.parts
    )
    assert "mesh.ignored" in {finding.rule for finding in source.findings}


TEXTURED = """<newparam sid="w-surface"><surface type="2D"><init_from>w</init_from></surface>
 </newparam><newparam sid="w-sampler"><sampler2D><source>{surface}</source></sampler2D></newparam>
 <technique sid="c"><lambert><diffuse><texture texture="{texture}" texcoord="UVSET0"/></diffuse>
 </lambert></technique>"""
IMAGE = (
    b"<library_images><image id='w'><init_from>my%20wood.png</init_from></image></library_images>"
)


@pytest.mark.parametrize(
    ("texture", "surface"),
    [("w-sampler", "w-surface"), ("w", "w-surface"), ("w", "lost-surface")],
    ids=["as the standard says", "names the picture", "and the sampler leads nowhere"],
)
def test_a_dae_names_its_texture_in_three_ways(texture, surface):
    painted = re.compile(rb'<technique sid="c"><lambert><diffuse>\s*<color>0\.1.*?</technique>')
    text = TEXTURED.format(texture=texture, surface=surface).encode()
    data = painted.sub(text, dae().replace(b"\n", b" "))
    source = read_mesh(data.replace(b"<library_effects>", IMAGE + b"<library_effects>"), "dae")
    assert source.parts[0].material == SurfaceMaterial("材质", None, "my wood.png")
    assert ("mesh.ignored" in rules(source)) == (surface == "lost-surface")


def test_decimal_numbers_of_a_dae_stay_decimal():
    source = read_mesh(dae(positions=CUBE.replace("1", "0.123456789012"), unit="1"), "dae")
    assert source.parts[0].mesh.vertices[:, 1].max() == 0.123456789012


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (dae()[:1500], ":2[0-9]: broken XML"),
        (dae(positions=CUBE.replace("1 1 1", "1 nan 1")), "vertex 7 of `pos` is not a finite"),
        (dae().replace(b"0 1 3 0 3 2", b"0 1 3 0 3 99"), "99|index|geometry"),
        (dae().replace(b"0 1 3 0 3 2", b"0 1 3 0 3 -2"), "-2|index|geometry"),
        (dae(positions="0 0 0"), "index|geometry"),
        (b"<html><body>404</body></html>", "COLLADA|scene"),
        (b"PK\x03\x04....", "zip"),
        (b'<!DOCTYPE x [<!ENTITY a "b">]>' + dae(), "entities"),
        (('<!DOCTYPE x [<!ENTITY a "b">]>' + dae().decode()).encode("utf-16"), "entities"),
        (dae().replace(b'<instance_visual_scene url="#s"/>', b""), "no scene"),
        (b"", "empty"),
    ],
)
def test_a_broken_dae_is_one_error_that_names_the_defect(data, says):
    with pytest.raises(StepError, match=says) as caught:
        read_mesh(data, "dae", subject="mesh meshes/bad.dae")
    assert str(caught.value).startswith("mesh meshes/bad.dae:")


def test_a_binary_stl_that_begins_with_solid_is_binary():
    (part,) = read_mesh(stl(BOX.corners, b"solid made by CAD"), "stl").parts
    assert np.array_equal(part.mesh.corners, BOX.corners)


def test_a_text_stl_is_text():
    text = trimesh.Trimesh(BOX.vertices, BOX.faces, process=False).export(file_type="stl_ascii")
    (part,) = read_mesh(text.encode(), "stl").parts
    assert part.mesh.corners == pytest.approx(BOX.corners)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (
            stl(BOX.corners, count=13),
            "promises 13 faces, which is 734 bytes, the file has 684",
        ),
        (stl(BOX.corners)[:-7], "promises 12 faces"),
        (stl(BOX.corners[:0]), "no triangles"),
        (stl(np.full((2, 3, 3), np.nan)), "vertex 0 is not a finite number"),
        (b"solid x\n facet normal 0 0 1\n  outer loop\n   vertex 0 0", "cut off at line 4"),
        (b"short", "too few"),
    ],
)
def test_a_broken_stl_is_one_error(data, says):
    with pytest.raises(StepError, match=says):
        read_mesh(data, "stl")


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
    for name, x, colour in (("a", 0.0, (255, 0, 0, 255)), ("b", 5.0, (0, 0, 255, 255))):
        material = trimesh.visual.material.PBRMaterial(name=f"paint {name}", baseColorFactor=colour)
        mesh = trimesh.Trimesh(BOX.vertices, BOX.faces, process=False)
        mesh.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(mesh, transform=trimesh.transformations.translation_matrix([x, 0, 0]))
    source = read_mesh(scene.export(file_type="glb"), "glb")
    assert [p.material.name for p in source.parts] == ["paint a", "paint b"]
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
    with pytest.raises(StepError, match=r"gltf_buffer_0.bin` is not in the source"):
        read_mesh(text, "gltf")


def test_a_glb_keeps_the_normals_that_it_states_and_makes_up_none():
    bare = read_mesh(textured_box().export(file_type="glb", include_normals=False), "glb")
    stated = read_mesh(textured_box().export(file_type="glb", include_normals=True), "glb")
    assert bare.parts[0].mesh.normals is None
    assert stated.parts[0].mesh.normals is not None


def test_a_picture_that_is_too_large_is_refused_in_a_glb_too():
    wide = Image.new("1", (12_000, 6_000))
    with pytest.raises(StepError, match="too large: 12000 x 6000"):
        read_mesh(textured_box(wide).export(file_type="glb"), "glb")


@pytest.mark.parametrize("format", ["ply", "glb", "gltf", "obj"])
def test_rubbish_is_one_error(format):
    with pytest.raises(StepError):
        read_mesh(io.BytesIO(b"\x00\x01rubbish" * 20).getvalue(), format)
