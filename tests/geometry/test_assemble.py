"""Meshes and pieces go to the places of the source's geometry, each content once."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
from robot_files import run_step

from assetbuild.collision import write_pieces
from assetbuild.findings import Finding
from assetbuild.geometry.assemble import Assemble, Use, called
from assetbuild.geometry.convert_mesh import write_converted
from assetbuild.mesh.material import MaterialPart, SurfaceMaterial
from assetbuild.mesh.primitives import tessellate
from assetbuild.mesh.solid import ConvexPiece
from assetbuild.robot.codec import decode, encode
from assetbuild.robot.pose import IDENTITY, Pose
from assetbuild.robot.shapes import (
    Box,
    Material,
    Mesh,
    MeshFile,
    Shape,
    Shapes,
    SourceShape,
    SourceShapes,
    Sphere,
)

RAISED = Pose((0.0, 0.0, 1.0))
RED = (1.0, 0.0, 0.0, 1.0)


def converted(folder: Path, *materials: SurfaceMaterial) -> None:
    """A box per material, the first of 1 m, the second of 2 m along x."""
    folder.mkdir(parents=True)
    boxes = [tessellate(Box((1.0 + n, 1.0, 1.0))) for n in range(len(materials))]
    write_converted(folder, list(map(MaterialPart, materials, boxes)))


def assembled(
    tmp_path: Path, source: SourceShapes, step: Assemble
) -> tuple[Shapes, Path, list[Finding]]:
    """The shapes, the folder of their meshes, and what was found."""
    (tmp_path / "in").mkdir(exist_ok=True)
    (tmp_path / "in" / "shapes.json").write_bytes(encode(source))
    found = run_step(step, tmp_path / "in", tmp_path / "out")
    shapes = decode(Shapes, (tmp_path / "out" / "shapes.json").read_bytes())
    return shapes, tmp_path / "out" / "meshes", found


def drawn(path: str, *links: str, X: Pose = IDENTITY) -> SourceShapes:
    """One file that some links show; the shapes have the links' names."""
    return SourceShapes(tuple(SourceShape(n, n, "visual", MeshFile(path), X) for n in links))


def test_a_mesh_that_two_links_share_is_one_file(tmp_path: Path):
    converted(tmp_path / "in/visual/leg", SurfaceMaterial())
    source = drawn("m/leg.dae", "left", "right", X=RAISED)
    uses = tuple(Use(n, "visual", n, mesh="visual/leg", stem="leg") for n in ("left", "right"))
    shapes, meshes, _ = assembled(tmp_path, source, Assemble(uses=uses))
    assert [s.name for s in shapes.shapes] == ["left_visual", "right_visual"]
    assert {s.geometry for s in shapes.shapes} == {Mesh(shapes.meshes[0].name)}
    assert all(s.X_link_shape == RAISED for s in shapes.shapes)
    assert [p.name for p in meshes.iterdir()] == [shapes.meshes[0].file]
    assert shapes.meshes[0].name.startswith("leg-")


def test_a_part_keeps_its_own_colour_and_else_takes_the_description_s(tmp_path: Path):
    converted(tmp_path / "in/visual/arm", SurfaceMaterial("材质", RED), SurfaceMaterial())
    silver = Material("silver", (0.7, 0.7, 0.8, 1.0))
    shape = SourceShape("a", "arm", "visual", MeshFile("arm.dae"), material="silver")
    step = Assemble(uses=(Use("arm", "visual", "a", mesh="visual/arm", stem="arm"),))
    shapes, *_ = assembled(tmp_path, SourceShapes((shape,), (silver, Material("unused"))), step)
    assert [s.name for s in shapes.shapes] == ["arm_visual1", "arm_visual2"]
    assert [s.material for s in shapes.shapes] == ["材质", "silver"]
    assert [(m.name, m.rgba) for m in shapes.materials] == [("材质", RED), ("silver", silver.rgba)]


def test_two_colours_of_one_name_stay_two_materials(tmp_path: Path):
    for name, rgba in (("a", RED), ("b", (0.0, 1.0, 0.0, 1.0))):
        converted(tmp_path / "in/visual" / name, SurfaceMaterial("paint", rgba))
    source = SourceShapes(tuple(SourceShape(n, n, "visual", MeshFile(f"{n}.dae")) for n in "ab"))
    uses = tuple(Use(n, "visual", n, mesh=f"visual/{n}", stem=n) for n in "ab")
    shapes, *_ = assembled(tmp_path, source, Assemble(uses=uses))
    assert [m.name for m in shapes.materials] == ["paint", "paint_2"]
    assert [s.material for s in shapes.shapes] == ["paint", "paint_2"]
    assert len(shapes.meshes) == 1  # the same geometry, in two colours


def test_pieces_are_placed_in_the_frame_of_their_shape(tmp_path: Path):
    folder = tmp_path / "in/collision/hull"
    folder.mkdir(parents=True)
    offset = Pose((0.5, 0.0, 0.0))
    hull = tessellate(Box((1.0, 1.0, 1.0)))
    write_pieces(folder, [ConvexPiece(hull), ConvexPiece(Sphere(0.1), offset)], None)
    source = SourceShapes((SourceShape("s", "foot", "collision", MeshFile("f.stl"), RAISED),))
    use = Use("foot", "collision", "s", pieces="collision/hull", stem="foot")
    shapes, *_ = assembled(tmp_path, source, Assemble(uses=(use,)))
    assert [s.name for s in shapes.shapes] == ["foot_collision1", "foot_collision2"]
    assert [shape.X_link_shape for shape in shapes.shapes] == [RAISED, RAISED @ offset]
    assert shapes.shapes[1].geometry == Sphere(0.1)
    assert shapes.meshes[0].convex


def test_links_that_hit_nothing_are_told(tmp_path: Path):
    shapes = tuple(SourceShape(n, n, "collision", Sphere(0.1)) for n in ("foot", "rotor"))
    step = Assemble(uses=(Use("foot", "collision", "foot"),))
    (finding,) = assembled(tmp_path, SourceShapes(shapes), step)[2]
    assert finding.rule == "collision.none"
    assert "`rotor`" in finding.message
    assert "`foot`" not in finding.message


def test_collision_made_of_what_is_seen_leaves_that_its_name(tmp_path: Path):
    """Shapes of an MJCF keep their names; two geoms of one name are refused by MuJoCo."""
    source = SourceShapes((SourceShape("lid", "box", "visual", Box((1.0, 1.0, 1.0))),))
    step = Assemble(
        uses=tuple(Use("box", role, "lid", named=True) for role in ("visual", "collision"))
    )
    shapes, *_ = assembled(tmp_path, source, step)
    assert [(s.name, s.role) for s in shapes.shapes] == [
        ("lid", "visual"),
        ("box_collision", "collision"),
    ]


@pytest.mark.parametrize(
    ("source", "second"),
    [
        ("base_collision", "base_2_collision"),
        ("base_collision1", "base_2_collision1"),
        ("pad", "pad_2"),
        ("my_collision_pad", "my_collision_pad_2"),
    ],
)
def test_the_pieces_of_a_named_shape_are_found_as_the_shape_was(source: str, second: str):
    """mjlab's configs look for `.*_collision` with digits at most behind it."""
    pieces = [Shape("", "base", "collision", Sphere(1.0))] * 2
    assert [shape.name for shape in called(pieces, source)] == [source, second]


def half_black(folder: Path, left: tuple[int, int, int]) -> None:
    """A picture, 8 x 4, whose right half is black."""
    picture = Image.new("RGB", (8, 4), (0, 0, 0))
    picture.paste(left, (0, 0, 4, 4))
    folder.mkdir(parents=True)
    picture.save(folder / "texture.png")


@pytest.mark.parametrize("named", [False, True], ids=["URDF", "MJCF"])
@pytest.mark.parametrize("how", ["mesh", "primitive"])
@pytest.mark.parametrize("left", [(0, 0, 0), (255, 0, 51)], ids=["black", "red"])
def test_a_texture_without_coordinates_gives_its_mean_colour(
    left: tuple[int, int, int], how: str, named: bool, tmp_path: Path
):
    """The right half is black: half of each channel, times the stated opacity. An MJCF's colour is
    compared with MuJoCo's own, which no picture changes."""
    half_black(tmp_path / "in/textures/0", left)
    converted(tmp_path / "in/visual/a", SurfaceMaterial())
    geometry = MeshFile("a.stl") if how == "mesh" else Box((1.0, 1.0, 1.0))
    material = Material("m", (1.0, 1.0, 1.0, 0.5), "m.png")
    shape = SourceShape("a", "arm", "visual", geometry, material="m")
    folder = "visual/a" if how == "mesh" else None
    use = Use("a", "visual", "a", mesh=folder, named=named)
    step = Assemble(uses=(use,), textures=("m.png",))
    shapes, *_ = assembled(tmp_path, SourceShapes((shape,), (material,)), step)
    mean = (1.0, 1.0, 1.0) if named else tuple(v / 2 / 255 for v in left)
    assert shapes.materials[0].rgba == pytest.approx((*mean, 0.5), abs=1e-6)
    assert shapes.materials[0].texture is None


@pytest.mark.parametrize(
    ("own", "stated", "count"), [(RED, "silver", 1), (None, "silver", 0), (RED, None, 0)]
)
def test_a_material_that_the_mesh_overrules_is_said(
    own: tuple[float, ...] | None, stated: str | None, count: int, tmp_path: Path
):
    """RViz gives the URDF's material to parts without one of their own only."""
    material = SurfaceMaterial("own", own) if own else SurfaceMaterial()  # type: ignore[arg-type] # four
    converted(tmp_path / "in/visual/a", material)
    shape = SourceShape("a", "arm", "visual", MeshFile("a.obj"), material=stated)
    source = SourceShapes((shape,), (Material("silver", (0.7, 0.7, 0.8, 1.0)),))
    step = Assemble(uses=(Use("a", "visual", "a", mesh="visual/a"),))
    found = assembled(tmp_path, source, step)[2]
    assert [f.rule for f in found if f.rule == "material.of_mesh"] == ["material.of_mesh"] * count


@pytest.mark.parametrize(
    ("listed", "rules"), [((), ["texture.missing"]), (("m.png",), ["texture.no_coordinates"])]
)
def test_a_texture_that_the_source_lacks_is_told(
    listed: tuple[str, ...], rules: list[str], tmp_path: Path
):
    half_black(tmp_path / "in/textures/0", (255, 0, 51))
    shape = SourceShape("a", "arm", "visual", Box((1.0, 1.0, 1.0)), material="m")
    source = SourceShapes((shape,), (Material("m", (1.0, 1.0, 1.0, 1.0), "m.png"),))
    step = Assemble(uses=(Use("a", "visual", "a"),), textures=listed)
    found = assembled(tmp_path, source, step)[2]
    assert [f.rule for f in found if f.rule.startswith("texture.")] == rules
