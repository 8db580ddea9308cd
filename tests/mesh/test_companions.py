"""A mesh names other files in many spellings; each is found, and none leads elsewhere."""

from __future__ import annotations

import json
import time

import pytest

from assetbuild.mesh.companions import companions_of, relative_name

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
