"""COLLADA files: all surfaces arrive where their nodes put them; what is sloppy is said."""

from __future__ import annotations

import re

import pytest
from daes import CUBE, dae

from assetbuild.errors import StepError
from assetbuild.mesh.material import SurfaceMaterial
from assetbuild.mesh.read import read_mesh
from assetbuild.mesh.triangles import area, cleaned, merged, signed_volume


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


def test_comments_and_absent_cameras_and_lights_among_the_nodes_are_nothing_to_report():
    more = b'<!-- rig --><node><instance_camera url="#no"/></node><node><instance_light url="#no"/>'
    source = read_mesh(
        dae().replace(b'<node id="mirror">', more + b'</node><node id="mirror">'), "dae"
    )
    assert rules(source) == rules(read_mesh(dae(), "dae"))


def test_a_false_up_axis_is_ignored_and_said_or_honoured_when_asked():
    ignored = read_mesh(dae(up="Y_UP"), "dae")
    honoured = read_mesh(dae(up="Y_UP"), "dae", up_axis="honour")
    assert rules(ignored)["mesh.up_axis"] == {"stated": "Y_UP", "honoured": False}
    assert rules(honoured)["mesh.up_axis"] == {"stated": "Y_UP", "honoured": True}
    plain, turned = (merged([p.mesh for p in s.parts]) for s in (ignored, honoured))
    assert turned.vertices[:, 2] == pytest.approx(plain.vertices[:, 1])
    assert turned.vertices[:, 1] == pytest.approx(-plain.vertices[:, 2])
    assert signed_volume(cleaned(turned)) == pytest.approx(signed_volume(cleaned(plain)))


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


SECOND = CUBE.replace("1", "3")
"""A cube of three metres."""


def element(data: bytes, pattern: bytes) -> bytes:
    found = re.search(pattern, data, re.S)
    assert found
    return found[0]


def one_cube(**stated) -> bytes:
    """The file with one node and without lines: six square metres at x = 10."""
    data = dae(unit="1", **stated)
    mirror = element(data, rb'<node id="mirror">.*?</node>')
    return data.replace(mirror, b"").replace(element(data, rb"<lines.*?</lines>"), b"")


def with_second(data: bytes, geometry: bytes, url: bytes = b"#second") -> bytes:
    """The file with one more geometry, which one more node shows."""
    first = element(data, rb"<geometry .*?</geometry>")
    node = element(data, rb'<node id="plain">.*?</node>')
    again = node.replace(b'"#g"', b'"' + url + b'"').replace(b"plain", b"again")
    return data.replace(first, first + geometry).replace(node, node + again)


def surface(source) -> float:
    return sum(area(part.mesh) for part in source.parts)


def test_geometries_that_repeat_the_ids_of_sources_keep_their_own():
    data = one_cube()
    first = element(data, rb"<geometry .*?</geometry>")
    second = first.replace(b'id="g"', b'id="second"').replace(CUBE.encode(), SECOND.encode())
    source = read_mesh(with_second(data, second), "dae")
    assert surface(source) == pytest.approx(6.0 + 54.0)
    assert rules(source)["mesh.repeated_ids"] == {"ids": 1}


HULL = b'<geometry id="hull"><convex_mesh convex_hull_of="#g"/></geometry>'
PHYSICS = b"""<library_physics_models><physics_model id="p"><rigid_body sid="b">
 <technique_common><shape><instance_geometry url="#hull"/></shape></technique_common>
 </rigid_body></physics_model></library_physics_models><library_visual_scenes>"""
STRIP = b"""<linestrips count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 7</p>
 </linestrips><triangles"""
SPLINE = b'<geometry id="second"><spline/></geometry>'
# RoboDK and Autodesk export hundreds of convex meshes for physics beside what is seen.
NO_SURFACE = {
    "physics": (one_cube().replace(b"<library_geometries>", b"<library_geometries>" + HULL)
                .replace(b"<library_visual_scenes>", PHYSICS), {}, "info"),
    "lines": (one_cube().replace(b"<triangles", STRIP), {"linestrips": 1}, "info"),
    "nothing": (with_second(one_cube(), b""),
                {"instances of geometry that the file lacks": 1}, "warning"),
    "splines": (with_second(one_cube(), SPLINE), {"splines or hulls": 1}, "warning"),
}  # fmt: skip


@pytest.mark.parametrize(("data", "left_out", "severity"), NO_SURFACE.values(), ids=NO_SURFACE)
def test_what_is_no_surface_is_left_out_and_said(data, left_out, severity):
    source = read_mesh(data, "dae")
    assert surface(source) == pytest.approx(6.0)
    assert rules(source) == {"mesh.skipped": {"cameras": 1, **left_out}}
    assert source.findings[0].severity == severity


SKIN = b"""<library_controllers><controller id="c"><skin source="#g">
 <bind_shape_matrix>1 0 0 10 0 1 0 0 0 0 1 0 0 0 0 1</bind_shape_matrix>
 <source id="j"><Name_array id="ja" count="1">b</Name_array><technique_common>
  <accessor source="#ja" count="1" stride="1"><param name="JOINT" type="name"/></accessor>
 </technique_common></source>
 <source id="m"><float_array id="ma" count="16">1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</float_array>
  <technique_common><accessor source="#ma" count="1" stride="16">
  <param name="TRANSFORM" type="float4x4"/></accessor></technique_common></source>
 <source id="w"><float_array id="wa" count="1">1</float_array><technique_common>
  <accessor source="#wa" count="1" stride="1"><param name="WEIGHT" type="float"/></accessor>
 </technique_common></source>
 <joints><input semantic="JOINT" source="#j"/>
  <input semantic="INV_BIND_MATRIX" source="#m"/></joints>
 <vertex_weights count="8"><input semantic="JOINT" source="#j" offset="0"/>
  <input semantic="WEIGHT" source="#w" offset="1"/><vcount>1 1 1 1 1 1 1 1</vcount>
  <v>0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0</v></vertex_weights>
</skin></controller></library_controllers>"""


def skinned(data: bytes) -> bytes:
    node = element(data, rb'<node id="plain">.*?</node>')
    skin = b'<node id="b" sid="b" type="JOINT"/><node id="plain"><instance_controller url="#c"/>'
    data = data.replace(node, skin + b"</node>")
    return data.replace(b"<library_visual_scenes>", SKIN + b"<library_visual_scenes>")


def test_a_skin_counts_where_its_skeleton_holds_it_where_it_lies():
    source = read_mesh(skinned(one_cube()), "dae")
    assert surface(source) == pytest.approx(6.0)
    elsewhere = skinned(one_cube()).replace(b"1 0 0 10", b"1 0 0 11")
    with pytest.raises(StepError, match="skins on a skeleton"):
        read_mesh(elsewhere, "dae")


STRAY = {
    "zeros at the end": lambda data: data + b"\0\0\0",
    "more at the end": lambda data: data + b"<more/>",
    "another end": lambda data: data + b"\0\0a></scene></COLLADA>",
    "blanks first": lambda data: b"\n " + data,
    "Windows-1252": lambda data: data.replace(
        b"<created>", b"<title>M\xfcller &amp; Co</title><created>"
    ),
    "control": lambda data: data.replace(b"<created>", b"<title>M\x01ller & Co</title><created>"),
}


@pytest.mark.parametrize("change", STRAY.values(), ids=STRAY)
def test_stray_bytes_beside_the_geometry_are_left_out_and_said(change):
    source = read_mesh(change(one_cube()), "dae")
    assert surface(source) == pytest.approx(6.0)
    assert "mesh.stray_bytes" in rules(source)


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
        # Readers take these differently.
        (one_cube().replace(b'meter="1"', b'meter="0,01"'), ':4: the unit is `meter="0,01"`'),
        (one_cube().replace(b'meter="1"', b'meter="0"'), ":4: the unit"),
        (one_cube().replace(b'stride="3"', b'stride="3" offset="3"'), "offset 3"),
        (one_cube().replace(b'stride="3"', b'stride="4"'), "stride 4"),
        (one_cube().replace(b"<p>0 2 6 4</p>", b"<ph><p>0 2 6 4</p></ph>"), "holes"),
        (one_cube().replace(b"<vcount>4 4<", b"<vcount>4 5<"), "9 corners, there are 8"),
        (
            with_second(one_cube(), b'<geometry id="g"><mesh/></geometry>', b"#g"),
            "second geometry has the id `g`",
        ),
    ],
)
def test_a_broken_dae_is_one_error_that_names_the_defect(data, says):
    with pytest.raises(StepError, match=says) as caught:
        read_mesh(data, "dae", subject="mesh meshes/bad.dae")
    assert str(caught.value).startswith("mesh meshes/bad.dae:")


def test_x_up_lets_x_point_up():
    turned = read_mesh(dae(up="X_UP", unit="1"), "dae", up_axis="honour")
    lower, upper = merged([p.mesh for p in turned.parts]).bounds
    assert (lower[2], upper[2]) == pytest.approx((6.0, 11.0))


def test_a_dae_without_any_material_is_fine():
    bare = dae().replace(b' material="s1"', b"").replace(b' material="s2"', b"")
    (part,) = read_mesh(bare, "dae").parts
    assert part.material == SurfaceMaterial()
    assert len(part.mesh.faces) == 24
