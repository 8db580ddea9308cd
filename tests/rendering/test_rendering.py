"""Light meshes, pictures and the view's geometry; a gain changes none of them."""

from __future__ import annotations

import base64
import functools
import gzip
import json
import re
import shutil
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from PIL import Image
from robot_files import run_step, write_robot_ports
from tiny import TinyRobot, pendulum, tiny_quadruped

from assetbuild.control.keep import KeepPose
from assetbuild.engine.world import World
from assetbuild.errors import StepError
from assetbuild.mesh.obj import obj_bytes, read_triangles
from assetbuild.mesh.triangles import TriangleMesh
from assetbuild.rendering.plan import renderer
from assetbuild.rendering.render import MARGIN, Render, draw_all, ellipsoid_points, fitted
from assetbuild.rendering.studio import BACKGROUND
from assetbuild.rendering.viewer import SPAN_M, Viewer, in_bytes, lightened, nearest, three_js
from assetbuild.robot.codec import encode
from assetbuild.robot.model import Control
from assetbuild.robot.pose import Pose
from assetbuild.robot.shapes import Box, Mesh, MeshAsset, Shape, Shapes, Sphere
from assetbuild.targets.mjcf import Mjcf

pytestmark = pytest.mark.usefixtures("drawing")


PLACE = Pose((0.0, 0.0, 0.5))


def mesh_robot(mesh: trimesh.Trimesh, *shapes: Shape) -> TinyRobot:
    """The pendulum with these shapes in the place of its own, of which some show the mesh."""
    data = obj_bytes(TriangleMesh(np.array(mesh.vertices), np.array(mesh.faces)))
    asset = MeshAsset("mesh", "mesh.obj", len(mesh.vertices), len(mesh.faces))
    return replace(pendulum(), shapes=Shapes(shapes, (), (asset,)), meshes={"mesh.obj": data})


def ball_robot(*more: Shape) -> TinyRobot:
    """A finely meshed ball of 0.1 m that is seen, and a sphere of 0.09 m that collides."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    seen = Shape("ball", "arm", "visual", Mesh("mesh"), PLACE)
    return mesh_robot(ball, seen, Shape("hit", "arm", "collision", Sphere(0.09), PLACE), *more)


BALL = read_triangles(ball_robot().meshes["mesh.obj"])


def test_light_meshes_have_fewer_triangles_and_the_same_shape():
    mesh = lightened({"ball": BALL}, 2000)["ball"]
    assert len(mesh.faces) < 5120 / 2
    radii = np.linalg.norm(mesh.vertices, axis=1)
    assert radii == pytest.approx(0.1, rel=0.01)
    assert len(lightened({"ball": BALL}, 500)["ball"].faces) <= 510


def test_a_light_mesh_that_lost_a_part_is_not_taken(monkeypatch: pytest.MonkeyPatch):
    def half(mesh: TriangleMesh, *_: object) -> TriangleMesh:
        return TriangleMesh(mesh.vertices, mesh.faces[mesh.corners[:, :, 0].min(axis=1) > 0.0])

    monkeypatch.setattr("assetbuild.rendering.viewer.clustered", half)
    monkeypatch.setattr("assetbuild.rendering.viewer.simplified", half)
    assert lightened({"ball": BALL}, 2000) == {}


@pytest.mark.parametrize("collides", [False, True])
def test_the_view_shows_the_thinned_mesh_unless_it_collides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, collides: bool
):
    fewer = functools.partial(lightened, max_faces=2000)
    monkeypatch.setattr("assetbuild.rendering.viewer.lightened", fewer)
    more = [Shape("c", "base", "collision", Mesh("mesh"))] if collides else []
    view = view_of(ball_robot(*more), tmp_path)
    faces = base64.b64decode(view["meshes"]["mesh"]["faces"])
    shown = BALL if collides else fewer({"ball": BALL})["ball"]
    assert len(faces) == 2 * 3 * len(shown.faces)


def test_a_gain_a_friction_and_a_timestep_leave_the_pose_as_it_is(tmp_path: Path):
    control = tiny_quadruped().control
    stiffer = tuple(replace(a, kp=2 * a.kp + 1, effort=3.0) for a in control.actuators)
    other = replace(
        control,
        actuators=stiffer,
        contact=control.contact.model_copy(update={"friction": (0.1, 0.0, 0.0)}),
        simulation=control.simulation.model_copy(update={"timestep": 1e-4}),
    )
    moved = replace(control, keyframes=(replace(control.keyframes[0], name="other"),))
    made = [_pose(tmp_path / str(n), c) for n, c in enumerate((control, other, moved))]
    assert made[0] == made[1] != made[2]


def _pose(folder: Path, control: Control) -> bytes:
    (folder / "in").mkdir(parents=True)
    (folder / "in/control.json").write_bytes(encode(control))
    run_step(KeepPose(), folder / "in", folder / "out")
    return (folder / "out/control.json").read_bytes()


def view_of(robot: TinyRobot, folder: Path) -> dict:
    """The content of the view's compressed file; its findings are those of the step."""
    inputs = write_robot_ports(folder / "in", robot)
    findings = run_step(Viewer(), inputs, folder / "out")
    packed = json.loads((folder / "out/viewer.json").read_text())["gzip"]
    view = json.loads(gzip.decompress(base64.b64decode(packed)))
    return view | {"rules": [finding.rule for finding in findings]}


def test_the_view_tells_how_far_visual_and_collision_are_apart(tmp_path: Path):
    """A ball of 100 mm around a collision sphere of 90 mm: 10 mm are not covered, everywhere."""
    view = view_of(ball_robot(), tmp_path)
    (row,) = [shape for shape in view["shapes"] if shape["role"] == "visual"]
    distance = np.frombuffer(base64.b64decode(row["distance"]), dtype=np.uint8)
    told = (distance.astype(float) - 128) / 127 * SPAN_M
    assert told == pytest.approx(0.01, abs=SPAN_M / 127)


def test_only_what_is_near_a_solid_is_measured_from_it():
    """A body of a hundred parts took minutes."""
    asked = []

    def distance(points: np.ndarray) -> np.ndarray:
        asked.append(len(points))
        return np.zeros(len(points))

    points = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0]])
    boxes = np.array([[0.4] * 3, [0.6] * 3]) * [1, 0, 0], np.full((2, 3), 9.0)
    assert nearest(points, [(box, distance) for box in boxes]).tolist() == [SPAN_M, 0.0, SPAN_M]
    assert asked == [1]


def test_the_view_holds_boxes_and_packed_points(tmp_path: Path):
    """A mesh to a hundredth of a millimetre per metre; distances up to the span."""
    view = view_of(ball_robot(Shape("b", "base", "visual", Box((0.1, 0.2, 0.3)))), tmp_path)
    assert [row["dims"] for row in view["shapes"] if row["kind"] == "box"] == [[0.1, 0.2, 0.3]]
    mesh = view["meshes"]["mesh"]
    points = np.frombuffer(base64.b64decode(mesh["points"]), dtype="<u2").reshape(-1, 3)
    found = points / 65535 * mesh["size"] + mesh["lower"]
    assert np.abs(found - BALL.vertices).max() < 1e-5
    assert in_bytes(np.array([-1.0, 0.0, 1.0])).tolist() == [1, 128, 255]


def test_the_library_is_whole_and_says_whose_it_is():
    text = three_js()
    if text is None:
        pytest.skip("the installed trimesh brings no three.js")
    assert "Three.js Authors" in text[:200] and "MIT" in text[:200]
    assert "WebGLRenderer" in text and "</script" not in text


def test_a_trimesh_without_the_library_leaves_the_page_without_a_view(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    assert view_of(ball_robot(), tmp_path / "with")["rules"] == []
    monkeypatch.setattr(trimesh.__spec__, "origin", str(tmp_path / "trimesh/__init__.py"))
    view = view_of(ball_robot(), tmp_path / "without")
    assert view["rules"] == ["viewer.none"]
    assert view["shapes"]


def test_a_machine_without_opengl_says_so_and_goes_on(tmp_path: Path):
    (tmp_path / "in").mkdir()
    found = run_step(Render(renderer="none"), tmp_path / "in", tmp_path / "out")
    assert [f.rule for f in found] == ["pictures.none"]
    assert list((tmp_path / "out/images").iterdir()) == []
    with pytest.raises(StepError, match="no pictures: no OpenGL"):
        draw_all(tmp_path / "in/mjcf/scene.xml", tmp_path / "all", "none")


def test_an_mjcf_that_does_not_load_has_no_pictures_and_says_why(tmp_path: Path):
    (tmp_path / "in/mjcf").mkdir(parents=True)
    (tmp_path / "in/mjcf/scene.xml").write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    found = run_step(Render(renderer="egl x"), tmp_path / "in", tmp_path / "out")
    assert [f.rule for f in found] == ["pictures.none"]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny quadruped as a scene of MuJoCo."""
    if renderer(World()) == "none":
        pytest.skip("no OpenGL without a window: apt-get install libegl1 libgl1-mesa-dri")
    return scene_of(tiny_quadruped(), tmp_path_factory.mktemp("render"))


def scene_of(robot: TinyRobot, folder: Path) -> Path:
    run_step(Mjcf(robot="tiny"), write_robot_ports(folder / "in", robot), folder)
    return folder / "mjcf/scene.xml"


@pytest.fixture(scope="module")
def rendered(scene: Path) -> dict[str, bytes]:
    """All its pictures."""
    return drawn(scene)


def drawn(scene: Path) -> dict[str, bytes]:
    folder = scene.parents[1] / "all"
    draw_all(scene, folder, renderer(World()))
    return {path.stem: path.read_bytes() for path in folder.iterdir()}


def pixels(data: bytes, mode: str) -> np.ndarray:
    return np.asarray(Image.open(BytesIO(data)).convert(mode)).astype(int)


def test_a_build_draws_one_picture_and_two_runs_the_same_bytes(scene: Path, rendered):
    runs = []
    for name in ("a", "b"):
        step = Render(renderer=renderer(World()))
        assert run_step(step, scene.parents[1], scene.parents[1] / name) == []
        images = scene.parents[1] / name / "images"
        runs.append({path.name: path.read_bytes() for path in images.iterdir()})
    assert runs[0] == runs[1]
    assert runs[0].keys() == {"hero.png", "thumbnail.png"}
    assert runs[0]["hero.png"] == rendered["hero"]
    assert Image.open(BytesIO(runs[0]["thumbnail.png"])).size == (256, 256)


def test_a_robot_whose_inertia_mujoco_refuses_is_seen_all_the_same(scene: Path, rendered):
    folder = scene.parents[1] / "refused/mjcf"
    shutil.copytree(scene.parent, folder)
    for file in folder.glob("*.xml"):
        file.write_text(re.sub(r'diaginertia="\S+', 'diaginertia="9.0', file.read_text()))
    with pytest.raises(ValueError, match=r"A \+ B >= C"):
        mujoco.MjModel.from_xml_path(str(folder / scene.name))
    step = Render(renderer=renderer(World()))
    assert run_step(step, folder.parent, folder.parent / "out") == []
    assert (folder.parent / "out/images/hero.png").read_bytes() == rendered["hero"]
    with pytest.raises(StepError, match="no pictures"):  # one of them shows inertia
        draw_all(folder / scene.name, folder.parent / "all", renderer(World()))


def test_every_picture_shows_something_of_its_own(rendered):
    """The robot fills its frame, and the shadow of the hero is not cut off at the edges."""
    assert rendered.keys() == {"hero", "behind", "collision", "inertia", "joints", "contacts"}
    assert len(set(rendered.values())) == len(rendered)
    grey = {name: pixels(data, "L") for name, data in rendered.items()}
    for name, picture in grey.items():
        assert picture.std() > 3.0, name
        assert max(picture.shape) == 1600, name
    rows, columns = np.nonzero(np.abs(grey["behind"] - BACKGROUND) > 12)
    height, width = grey["behind"].shape
    assert max(np.ptp(rows) / height, np.ptp(columns) / width) > 0.75
    hero = grey["hero"]
    for edge in (hero[0], hero[-1], hero[:, 0], hero[:, -1]):
        assert np.abs(edge - BACKGROUND).max() <= 4


def test_a_robot_of_collision_geometry_alone_is_seen_and_a_notch_is_not(
    tmp_path: Path, scene: Path
):
    """The hull is what collides; an empty floor says nothing about a robot."""
    cross = trimesh.util.concatenate(
        [trimesh.creation.box(size) for size in ([0.6, 0.05, 0.05], [0.05, 0.6, 0.05])]
    )
    shown = []
    for name, mesh in (("cross", cross), ("hull", cross.convex_hull)):
        robot = mesh_robot(mesh, Shape("c", "arm", "collision", Mesh("mesh"), PLACE))
        pictures = drawn(scene_of(robot, tmp_path / name))
        shown.append({name: pixels(data, "RGB") for name, data in pictures.items()})
    different = np.abs(shown[0]["collision"] - shown[1]["collision"]).max(axis=2) > 40
    assert different.mean() < 0.005, "the cross is drawn as its hull"
    assert shown[1]["hero"].std() > 10, "the floor alone is one grey"


def test_a_robot_without_geometry_is_seen_by_its_inertia(tmp_path: Path, scene: Path):
    pictures = drawn(scene_of(replace(pendulum(), shapes=Shapes()), tmp_path))
    assert set(pictures) == {"hero", "joints"}
    assert all(pixels(data, "RGB").std() > 5 for data in pictures.values())


@pytest.mark.parametrize("scale", [0.01, 1.0, 30.0])
@pytest.mark.parametrize("aspect", [0.75, 4 / 3])
def test_the_camera_fits_a_robot_of_any_size_and_posture(scale: float, aspect: float):
    """Every point lies in the frame, and some point lies as near to its edge as the margin."""
    rng = np.random.default_rng(3)
    for stretch in ([1, 1, 1], [0.1, 0.1, 2], [3, 0.2, 0.1]):
        points = scale * (rng.normal(size=(200, 3)) * stretch + [5, -2, 1])
        camera = fitted(points, 140.0, -14.0, aspect)
        axes = np.stack([camera.right, camera.up, camera.forward])
        x, y, depth = axes @ (points - camera.position).T
        places = np.stack([x / camera.half_width, y / camera.half_height]) / depth
        assert np.abs(places).max() == pytest.approx(1 / MARGIN, rel=1e-6)


def test_the_camera_sees_the_ends_of_inertia_ellipsoids():
    """A uniform ellipsoid with semiaxes a, b, c has the moment m (b² + c²) / 5 about its a."""
    a, b, c, mass = 0.1, 0.2, 0.4, 3.0
    moments = [mass / 5 * (b * b + c * c), mass / 5 * (a * a + c * c), mass / 5 * (a * a + b * b)]
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><body pos="1 2 3"><freejoint/><inertial pos="0 0 0" mass="{mass}"
        diaginertia="{" ".join(map(str, moments))}"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    points = ellipsoid_points(model, data)
    assert np.ptp(points, axis=0) == pytest.approx(2 * np.array([a, b, c]))
    assert points.mean(axis=0) == pytest.approx([1, 2, 3])


def test_mujoco_s_own_variable_switches_drawing_off(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MUJOCO_GL", "Disable")
    assert renderer(World()) == "none"
