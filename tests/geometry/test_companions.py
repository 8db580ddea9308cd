"""Textures on their whole way: named by a mesh in a source, shown by MJCF and URDF."""

from __future__ import annotations

import io
import json
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from PIL import Image

from assetbuild.cli.check import check
from assetbuild.engine.questions import KIND
from assetbuild.errors import RecipeError
from assetbuild.pipeline.building import Outcome, Request, build_all

pytestmark = pytest.mark.slow

URDF = """<robot name="r">
  <material name="paper"><color rgba="1 1 0 1"/><texture filename="pictures/check.bmp"/></material>
  <link name="base">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="meshes/a/tile.obj"/></geometry></visual>
    <visual><origin xyz="1 0 0"/><geometry><mesh filename="meshes/a/tile.obj" scale="2 2 2"/>
      </geometry></visual>
    <visual><origin xyz="2 0 0"/><geometry><mesh filename="meshes/plain.obj"/></geometry>
      <material name="paper"/></visual>
    <visual><geometry><box size="1 1 1"/></geometry><material name="paper"/></visual>
  </link>
</robot>
"""
# A square whose picture is upright when the first row of pixels lies at y = 1.
TILE = """mtllib ../looks/tile.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl wood
f 1/1 2/2 3/3 4/4
"""
MTL = "newmtl wood\nKd 1 1 1\nmap_Kd wood one.jpg\n"
RECIPE = """schema: assetbuild/v1
robot: r
source: {{{source}, urdf: r.urdf, license: MIT}}
collision: {{default: {{method: none}}}}
targets: [mjcf, urdf]
"""


def picture(top: tuple[int, int, int], bottom: tuple[int, int, int], format: str) -> bytes:
    image, out = Image.new("RGB", (16, 16), bottom), io.BytesIO()
    image.paste(top, (0, 0, 16, 8))
    image.save(out, format=format)
    return out.getvalue()


FILES = {
    "r.urdf": URDF.encode(),
    "meshes/a/tile.obj": TILE.encode(),
    "meshes/looks/tile.mtl": MTL.encode(),
    "meshes/looks/wood one.jpg": picture((250, 0, 0), (0, 0, 250), "JPEG"),
    "meshes/plain.obj": TILE.replace("mtllib ../looks/tile.mtl\n", "").encode(),
    "pictures/check.bmp": picture((0, 250, 0), (0, 0, 0), "BMP"),
}


@pytest.fixture(autouse=True)
def own_store(tmp_path: Path, first: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A store in which the steps of the robot of `FILES` are done."""
    shutil.copytree(first / "store", tmp_path / "store")
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "store"))
    monkeypatch.setenv("MUJOCO_GL", "disable")


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the robot of `FILES`, its bundle and the store that it was built in."""
    folder = tmp_path_factory.mktemp("first")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ASSETBUILD_CACHE", str(folder / "store"))
        patch.setenv("MUJOCO_GL", "disable")
        _, _, told = built(laid_out(folder, FILES))
    assert "mesh.texture" not in told
    assert len(told["texture.no_coordinates"]) == 1  # the box
    return folder


def laid_out(folder: Path, files: dict[str, bytes]) -> Path:
    for name, data in files.items():
        (folder / "robot" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "robot" / name).write_bytes(data)
    recipe = folder / "r.yaml"
    recipe.write_text(RECIPE.format(source="path: robot"))
    return recipe


def built(recipe: Path) -> tuple[Outcome, Path, dict[str, list[str]]]:
    """The outcome, its bundle, and the messages of its findings by rule."""
    out = recipe.parent / "out"
    (outcome,) = build_all([Request(recipe=recipe, out=out)], lambda _: None, lambda _: None)
    assert outcome.exit_code == 0, outcome.errors or outcome.report
    told: dict[str, list[str]] = {}
    for finding in json.loads((out / "report/report.json").read_text())["findings"]:
        told.setdefault(finding["rule"], []).append(finding["message"])
    return outcome, out, told


def test_mujoco_shows_both_pictures_where_they_belong(first: Path):
    model = mujoco.MjModel.from_xml_path(str(first / "out/mjcf/r.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    meshes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
    reds, blues, greens = (250, 0, 0), (0, 0, 250), (0, 250, 0)
    halves = ((reds, blues), (reds, blues), (greens, (0, 0, 0)))
    for geom, (top, bottom) in zip(meshes, halves, strict=True):
        for y, colour in corner_colours(model, data, geom):
            assert colour == pytest.approx(top if y > 0.5 else bottom, abs=10)  # it was a JPEG


def corner_colours(model, data, geom):
    """(world y, colour of the texture there) of each corner of a geom's mesh."""
    mesh = model.geom_dataid[geom]
    texture = model.mat_texid[model.geom_matid[geom], mujoco.mjtTextureRole.mjTEXROLE_RGB]
    width, height = model.tex_width[texture], model.tex_height[texture]
    start = model.tex_adr[texture]
    # The first row of the data is t = 0, as OpenGL has it.
    pixels = model.tex_data[start : start + 3 * width * height].reshape(height, width, 3)
    first, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    for corners, coordinates in zip(
        model.mesh_face[face : face + model.mesh_facenum[mesh]],
        model.mesh_facetexcoord[face : face + model.mesh_facenum[mesh]],
        strict=True,
    ):
        for corner, coordinate in zip(corners, coordinates, strict=True):
            vertex = model.mesh_vert[first + corner]
            y = (data.geom_xmat[geom].reshape(3, 3) @ vertex + data.geom_xpos[geom])[1]
            s, t = model.mesh_texcoord[model.mesh_texcoordadr[mesh] + coordinate]
            row, column = min(int(t * height), height - 1), min(int(s * width), width - 1)
            yield y, tuple(int(v) for v in pixels[row, column])


def test_a_viewer_of_the_urdf_finds_the_texture_beside_the_mesh(first: Path):
    for path in sorted((first / "out/urdf/meshes").glob("tile*.obj")):
        mesh = trimesh.load(path, force="mesh", process=False)
        assert mesh.visual.material.image.size == (16, 16)
        assert mesh.visual.uv.shape == (4, 2)


def test_a_picture_that_appears_later_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("ASSETBUILD_CACHE", str(tmp_path / "empty"))
    files = {k: v for k, v in FILES.items() if k != "meshes/looks/wood one.jpg"}
    recipe = laid_out(tmp_path, files)
    outcome, _, told = built(recipe)
    missing = tmp_path / "robot/meshes/looks/wood one.jpg"
    assert outcome.loaded.world.whole.record[(KIND, str(missing), "")] == ""
    assert "`../looks/wood one.jpg` is not in the source" in told["mesh.texture"][0]
    missing.write_bytes(FILES["meshes/looks/wood one.jpg"])
    outcome, _, told = built(recipe)
    assert "mesh.texture" not in told
    ran = {label for label, result in outcome.results.items() if result.status == "ran"}
    assert "convert_mesh tile" in ran


CORNER = b"mtllib no.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize("role", ["visual", "collision"])
def test_the_looks_of_what_only_collides_are_of_no_interest(role: str, tmp_path: Path):
    more = f'<{role}><geometry><mesh filename="meshes/c.obj"/></geometry></{role}></link>'
    files = {"r.urdf": URDF.replace("</link>", more).encode(), "meshes/c.obj": CORNER}
    recipe = laid_out(tmp_path, {**FILES, **files})
    recipe.write_text(recipe.read_text().replace("none", "keep, from: collision"))
    assert ("mesh.no_mtl" in built(recipe)[2]) is (role == "visual")


def test_a_picture_outside_of_the_source_is_not_followed(tmp_path: Path):
    (tmp_path / "secret.png").write_bytes(picture((1, 2, 3), (4, 5, 6), "PNG"))
    outside = MTL.replace("wood one.jpg", "../../../secret.png").encode()
    _, out, told = built(laid_out(tmp_path, {**FILES, "meshes/looks/tile.mtl": outside}))
    assert "is not in the source" in told["mesh.texture"][0]
    assert not list(out.rglob("secret*"))


def test_a_pattern_of_turned_meshes_that_matches_none_is_an_error_of_the_recipe(tmp_path: Path):
    recipe = laid_out(tmp_path, FILES)
    text = recipe.read_text().replace("license:", 'honour_up_axis: ["meshes/tyle.*"], license:')
    recipe.write_text(text)
    with pytest.raises(RecipeError, match=r"`meshes/tyle.\*` matches no mesh"):
        check(recipe)


MJCF = """<mujoco><compiler meshdir="meshes" texturedir="pictures"/><asset>
 <texture name="t" type="2d" file="check.png"/><material name="paper" texture="t" rgba="1 1 0 1"/>
 <material name="dull" rgba="0 1 1 1"/>
 <mesh name="tile" file="tile.obj"/></asset><worldbody><body name="base">
 <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
 <geom type="mesh" mesh="tile" material="paper" contype="0" conaffinity="0"/>
 <geom type="mesh" mesh="tile" material="dull" contype="0" conaffinity="0"/>
</body></worldbody></mujoco>"""
# MuJoCo wants a volume.
BLOCK = (
    "mtllib looks.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n"
    "f 1/1 3/3 2/2\nf 1/1 2/2 4/3\nf 1/1 4/3 3/2\nf 2/1 3/2 4/3\n"
)


def test_an_mjcf_says_all_about_its_looks_itself(tmp_path: Path):
    files = {
        "r.xml": MJCF.encode(),
        "meshes/tile.obj": BLOCK.encode(),
        "meshes/looks.mtl": b"newmtl red\nKd 1 0 0\n",
        "pictures/check.png": picture((0, 250, 0), (0, 0, 0), "PNG"),
    }
    recipe = laid_out(tmp_path, files)
    text = recipe.read_text().replace("urdf: r.urdf", "mjcf: r.xml")
    recipe.write_text(text.replace("targets: [mjcf, urdf]", "targets: [mjcf]"))
    _, out, _ = built(recipe)
    model = mujoco.MjModel.from_xml_path(str(out / "mjcf/r.xml"))
    looks = {model.material(i).name: model.mat_rgba[i].tolist() for i in range(model.nmat)}
    assert looks == {"paper": [1.0, 1.0, 0.0, 1.0], "dull": [0.0, 1.0, 1.0, 1.0]}
    assert model.ntex == 1
    assert model.mesh_texcoordnum.min() > 0
