"""The source beside our MJCF, for eyes: `python -m tests.corpus.pictures -o FOLDER [NAME ...]`.

Left: the source's URDF, read by yourdfpy and trimesh, drawn by pyrender. Right: the MJCF that we
built, drawn by MuJoCo. Both at zero joint angles, from the same two sides. Only the MJCF is ours;
where the two differ, look who is wrong: trimesh mixes up some colours. pyrender takes colours as
linear light, so that dark greys come out lighter on the left.

Needs `pip install pyrender` (which is not a dependency) and EGL (`apt install libegl1
libgl1-mesa-dri`). Robots are built with `init`, targets: [mjcf]; `--work` keeps the bundles.
"""

from __future__ import annotations

import argparse
import functools
import math
import os
import re
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
os.environ.setdefault("MUJOCO_GL", "egl")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from corpus.lists import data_root
from corpus.one import run, with_hulls

ROBOTS = {
    "panda": "panda_description/urdf/panda.urdf",
    "talos": "talos_data/robots/talos_full_v2.urdf",
    "icub": "icub_description/robots/icub.urdf",
    "pr2": "pr2_description/urdf/pr2.urdf",
    "go2": "go2_description/urdf/go2.urdf",
    "anymal_c": "anymal_c_simple_description/urdf/anymal.urdf",
    "anymal_b": "anymal_b_simple_description/robots/anymal.urdf",
    "tiago": "tiago_description/robots/tiago.urdf",
}
VIEWS = ((145.0, -20.0), (-35.0, -20.0))
"""(azimuth, elevation) in degrees, as MuJoCo counts them."""
WIDTH, HEIGHT, FOVY = 640, 480, 45.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", default=["panda", "talos", "icub", "pr2", "go2"])
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--work", type=Path, help="keep recipes and bundles here")
    options = parser.parse_args()
    root = data_root(options.data)
    options.out.mkdir(parents=True, exist_ok=True)
    # Each scene in a fresh process: the two renderers would fight for the display.
    one_each = ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1)
    with one_each as child, tempfile.TemporaryDirectory(prefix="pictures-") as scratch:
        for name in options.names:
            urdf = root / "robots" / ROBOTS[name]
            mjcf = built(urdf, (options.work or Path(scratch)) / name)
            path = options.out / f"{name}.png"
            left, right = child.submit(of_source, urdf), child.submit(of_mjcf, mjcf)
            side_by_side(left.result(), right.result(), path)
            print(path, flush=True)
    return 0


def built(urdf: Path, folder: Path) -> Path:
    """The MJCF of a robot, through `init` and `build`; also one that is not ready."""
    folder.mkdir(parents=True, exist_ok=True)
    recipe = folder / "recipe.yaml"
    done = run("init", str(urdf), "-o", str(recipe), "--force")
    if done.returncode == 0:
        text = re.sub(r"(?m)^targets:.*", "targets: [mjcf]", recipe.read_text())
        recipe.write_text(text)
        with_hulls(recipe)  # nobody sees collision here
        done = run("build", str(recipe), "-o", str(folder / "bundle"))
    for bundle in (folder / "bundle", folder / "bundle.failed"):
        found = [path for path in (bundle / "mjcf").glob("*.xml") if path.name != "scene.xml"]
        if found:
            return found[0]
    sys.exit(done.stderr + done.stdout)


def of_source(urdf: Path) -> list[np.ndarray]:
    """One (h, w, 3) picture per view of the URDF's visuals."""
    import pyrender
    import yourdfpy

    find = functools.partial(yourdfpy.filename_handler_magic, dir=str(urdf.parent))
    robot = yourdfpy.URDF.load(str(urdf), filename_handler=find)
    scene = pyrender.Scene(ambient_light=[0.2] * 3, bg_color=[0.8, 0.85, 0.9, 1.0])
    for node in robot.scene.graph.nodes_geometry:
        pose, name = robot.scene.graph[node]
        mesh = robot.scene.geometry[name]
        if len(getattr(mesh, "faces", ())):
            scene.add(pyrender.Mesh.from_trimesh(mesh, smooth=False), pose=pose)
    lower, upper = robot.scene.bounds
    renderer = pyrender.OffscreenRenderer(WIDTH, HEIGHT)
    pictures = []
    for azimuth, elevation in VIEWS:
        pose = camera_pose(lower, upper, azimuth, elevation)
        lens = pyrender.PerspectiveCamera(math.radians(FOVY), znear=0.01, zfar=100.0)
        camera = scene.add(lens, pose=pose)
        light = scene.add(pyrender.DirectionalLight(intensity=2.0), pose=pose)
        pictures.append(renderer.render(scene)[0])
        scene.remove_node(camera)
        scene.remove_node(light)
    renderer.delete()
    return pictures


def of_mjcf(path: Path) -> list[np.ndarray]:
    """One (h, w, 3) picture per view; collision shapes are not drawn."""
    import mujoco

    spec = mujoco.MjSpec.from_file(str(path))
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.35] * 3, [0.6] * 3
    sky = spec.add_texture(name="sky of the picture", width=8, height=48)
    sky.type, sky.builtin = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_FLAT
    sky.rgb1, sky.rgb2 = [0.8, 0.85, 0.9], [0.8, 0.85, 0.9]
    # A picture needs no physics: robots whose inertia is refused are looked at too.
    spec.compiler.balanceinertia = True
    spec.compiler.boundmass = spec.compiler.boundinertia = 1e-6
    model = spec.compile()
    data = mujoco.MjData(model)
    if model.njnt and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        data.qpos[:7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    lower, upper = visual_bounds(model, data)
    lens = mujoco.MjvCamera()
    options = mujoco.MjvOption()
    options.geomgroup[:] = [0, 0, 1, 0, 0, 0]
    pictures = []
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        for azimuth, elevation in VIEWS:
            lens.lookat[:] = (lower + upper) / 2.0
            lens.distance = distance(lower, upper)
            lens.azimuth, lens.elevation = azimuth, elevation
            renderer.update_scene(data, lens, options)
            pictures.append(renderer.render())
    return pictures


def visual_bounds(model, data) -> tuple[np.ndarray, np.ndarray]:
    """(lower, upper) corners of all visual geoms, m."""
    corners = []
    for geom in np.flatnonzero(model.geom_group == 2):
        middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
        box = middle + signs * half
        corners.append(box @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    points = np.concatenate(corners)
    return points.min(axis=0), points.max(axis=0)


def distance(lower: np.ndarray, upper: np.ndarray) -> float:
    return float(0.56 * np.linalg.norm(upper - lower) / math.tan(math.radians(FOVY / 2)))


def camera_pose(lower: np.ndarray, upper: np.ndarray, azimuth: float, elevation: float):
    """(4, 4) pose of a camera that looks down its own -z, where MuJoCo's free camera stands."""
    az, el = math.radians(azimuth), math.radians(elevation)
    forward = np.array([math.cos(el) * math.cos(az), math.cos(el) * math.sin(az), math.sin(el)])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, np.cross(right, forward), -forward
    pose[:3, 3] = (lower + upper) / 2.0 - distance(lower, upper) * forward
    return pose


def side_by_side(left: list[np.ndarray], right: list[np.ndarray], path: Path) -> None:
    from PIL import Image

    rows = [np.concatenate(pair, axis=1) for pair in zip(left, right, strict=True)]
    Image.fromarray(np.concatenate(rows)).save(path)


if __name__ == "__main__":
    sys.exit(main())
