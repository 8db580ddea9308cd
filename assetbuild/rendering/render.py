"""Pictures: the one that stands for the robot, and those that explain it."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.mesh.native import NativeError, NativeLimits, run_apart
from assetbuild.rendering.studio import (
    BACKGROUND,
    Camera,
    Paint,
    Pixels,
    Shot,
    Studio,
    lamp_direction,
    studio,
)
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import Data, Model, mj

LONG, SHORT = 1600, 1200
"""Pixels of the sides of a picture."""
TALL = 1.25
"""Height / width of the robot in the picture from which on the frame is upright."""
FRONT, BEHIND, ELEVATION = 140.0, -40.0, -14.0
"""Where the camera looks, degrees, as MuJoCo counts them."""
FOV = 28.0
"""Field of view along the shorter side of the picture, degrees: a long lens bends little."""
MARGIN = 1.1
"""How much larger the frame is than what is shown."""
OF_A_MESH = 1500
"""Vertices of each mesh that the camera is fitted to, evenly chosen."""
VISUAL, COLLISION = 2, 3
"""Groups of geoms."""
BODY = (VISUAL, COLLISION)
"""What stands for the robot: visual geometry, and collision geometry of bodies without any."""
UNDRAWN = 1001
"""`mjGEOM_NONE`: a geom of this type is skipped by the renderer."""
ELLIPSOIDS = 0.8
"""How far from the robot's middle its inertia ellipsoids are shown, as a share of its size."""
GRID = np.array([[x, y, z] for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0) for z in (-1, 0, 1)])
AROUND = GRID[GRID.any(axis=1)] / np.linalg.norm(GRID[GRID.any(axis=1)], axis=1)[:, None]
"""(26, 3) unit vectors all around."""
Rgba = tuple[float, float, float, float]
FADED: Rgba = (0.66, 0.68, 0.71, 0.16)


class Stage:
    """A robot in its first pose and what is to be seen of it.

    points: (n, 3) m, of all geometry; looks: of what it looks like. bare: it has no geometry, and
    the points are those of its inertia ellipsoids. size: m, diagonal of its box.
    """

    def __init__(self, model: Model) -> None:
        self.model, self.data = model, mujoco.at_key(model)
        self._groups, bodies = np.asarray(model.geom_group), np.asarray(model.geom_bodyid)
        shown = (bodies != 0) & (self._groups < 4)
        visual, solid = self._groups == VISUAL, self._groups == COLLISION
        self._spare = solid & np.isin(bodies, bodies[visual])
        """Collision geometry of bodies that have visual geometry to be seen by."""
        self.points = mujoco.outlines(model, self.data, np.flatnonzero(shown), OF_A_MESH)
        self.bare = not len(self.points)
        if self.bare:
            self.points = ellipsoid_points(model, self.data)
        if not len(self.points):
            self.points = np.array(self.data.subtree_com[0]) + np.array([[-0.5] * 3, [0.5] * 3])
        looks = mujoco.outlines(model, self.data, np.flatnonzero(shown & visual), OF_A_MESH)
        self.looks = looks if len(looks) else self.points
        self.groups = (0, VISUAL if visual.any() else COLLISION)
        """Groups of geoms that are drawn: without visual geometry, the collision geometry."""
        lower, upper = self.points.min(axis=0), self.points.max(axis=0)
        self.middle, self.lowest = (lower + upper) / 2.0, float(lower[2])
        self.size = max(float(np.linalg.norm(upper - lower)), 1e-3)
        _, right, up = directions(FRONT, ELEVATION)
        is_tall = np.ptp(self.points @ up) > TALL * np.ptp(self.points @ right)
        self.frame = (SHORT, LONG) if is_tall else (LONG, SHORT)
        _decorate(model, self.size)

    def hero(self, studio: Studio) -> Pixels:
        """The picture that stands for the robot; the frame holds its shadow as well."""
        if self.bare:
            return self._picture(studio, self._seen(self.looks), flags=("mjVIS_INERTIA",))
        camera = self._seen(np.concatenate([self.looks, self._shadow()]))
        return self._picture(studio, camera, groups=self.groups, samples=1, shadow=True)

    def others(self, studio: Studio) -> Iterator[tuple[str, Pixels]]:
        """(file, picture) of what one does not see of a robot that stands before one."""
        faded = self._painted(lambda geom: None if self._spare[geom] else FADED)
        axes = ("mjVIS_JOINT", "mjVIS_INERTIA") if self.bare else ("mjVIS_JOINT",)
        wide = self._seen(self.points, margin=1.3)
        yield "joints.png", self._picture(studio, wide, groups=BODY, flags=axes, paint=faded)
        if self.bare:
            return
        behind = self._seen(self.looks, BEHIND)
        yield "behind.png", self._picture(studio, behind, groups=self.groups[1:])
        inside, flags = self._seen(self._with_ellipsoids()), ("mjVIS_INERTIA", "mjVIS_COM")
        yield "inertia.png", self._picture(studio, inside, groups=BODY, flags=flags, paint=faded)
        camera = self._seen(self.points)
        for name, wanted, flag, colour in (
            # A mesh that is not convex is shown as what MuJoCo collides: its hull.
            ("collision.png", (self._groups == COLLISION).any(), "mjVIS_CONVEXHULL", _hue),
            ("contacts.png", self.data.ncon, "mjVIS_CONTACTPOINT", lambda _: FADED),
        ):
            if wanted:
                more = {"groups": (COLLISION,), "flags": (flag,), "paint": self._painted(colour)}
                yield name, self._picture(studio, camera, **more)

    def _seen(self, points: Array, azimuth: float = FRONT, margin: float = MARGIN) -> Camera:
        return fitted(points, azimuth, ELEVATION, self.frame[0] / self.frame[1], margin)

    def _picture(self, studio: Studio, camera: Camera, **more: Any) -> Pixels:  # Any: of Shot
        return studio.frame(self.data, Shot(camera, *self.frame, **more))

    def _shadow(self) -> Array:
        """(n, 3) m, how far the robot's shadow reaches on the floor."""
        forward, right, _ = directions(FRONT, ELEVATION)
        lamp = lamp_direction(forward, right)
        falls = (self.looks[:, 2:] - self.lowest) / -lamp[2]
        return np.asarray(self.looks + falls * lamp, dtype=np.float64)

    def _with_ellipsoids(self) -> Array:
        """(n, 3) m: the robot and its inertia ellipsoids, as far as they reach from it.

        A tensor that is too large by far would leave the robot a dot: what reaches out further
        than the robot's size is cut.
        """
        points = np.concatenate([self.points, ellipsoid_points(self.model, self.data)])
        reach = ELLIPSOIDS * self.size
        return np.asarray(np.clip(points, self.middle - reach, self.middle + reach))

    def _painted(self, colour: Callable[[int], Rgba | None]) -> Paint:
        """The robot's geometry, each in the colour for its number; None = not drawn at all."""
        of_geom, of_joint = mj.mjtObj.mjOBJ_GEOM.value, mj.mjtObj.mjOBJ_JOINT.value

        def paint(drawn: Any) -> None:  # Any: mjvGeom
            if drawn.objtype == of_geom and self.model.geom_bodyid[drawn.objid] != 0:
                _plain(drawn, colour(drawn.objid))
            elif drawn.objtype == of_joint and self.model.jnt_type[drawn.objid] == 0:  # mjJNT_FREE
                drawn.rgba[3] = 0.0  # a box in the middle of the robot says nothing

        return paint


def ellipsoid_points(model: Model, data: Data) -> Array:
    """(n, 3) points in the world, m, of the ellipsoids that MuJoCo draws for inertias.

    Semiaxes: sqrt(5 (I2 + I3 - I1) / (2 m)), of a uniform ellipsoid with these moments.
    """
    points = [np.zeros((0, 3))]
    for body in range(1, model.nbody):
        moments, mass = np.array(model.body_inertia[body]), float(model.body_mass[body])
        if mass > 0.0:
            axes = np.sqrt(np.maximum(2.5 * (moments.sum() - 2.0 * moments) / mass, 0.0))
            turned = np.array(data.ximat[body]).reshape(3, 3)
            points.append((AROUND * axes) @ turned.T + np.array(data.xipos[body]))
    return np.concatenate(points)


def fitted(
    points: Array, azimuth: float, elevation: float, aspect: float, margin: float = MARGIN
) -> Camera:
    """The nearest camera, looking one way, whose picture holds all points.

    points: (n, 3) m in the world; azimuth, elevation: degrees, as MuJoCo's cameras count them;
    aspect: width / height. A point p = (x right, y up, z ahead) is inside when |x| <= w (z + d),
    so the largest x - w z and the largest -x - w z decide where the camera stands across, and
    how far away; the same holds upwards.
    """
    forward, right, up = directions(azimuth, elevation)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    x, y, z = np.stack([right, up, forward]) @ (points - middle).T
    tangent = math.tan(math.radians(FOV / 2.0)) * math.sqrt(max(aspect, 1.0 / aspect))
    wide, high = tangent * min(aspect, 1.0), tangent / max(aspect, 1.0)
    wide, high = wide / margin, high / margin
    left, low = float(np.max(-x - wide * z)), float(np.max(-y - high * z))
    far_right, far_up = float(np.max(x - wide * z)), float(np.max(y - high * z))
    across, above = (far_right - left) / 2.0, (far_up - low) / 2.0
    distance = max((far_right + left) / (2.0 * wide), (far_up + low) / (2.0 * high), 1e-3)
    position = middle + across * right + above * up - distance * forward
    return Camera(position, forward, up, wide * margin, high * margin)


def directions(azimuth: float, elevation: float) -> tuple[Array, Array, Array]:
    """(forward, right, up), unit vectors in the world."""
    turn, tilt = math.radians(azimuth), math.radians(elevation)
    level = math.cos(tilt)
    forward = np.array([level * math.cos(turn), level * math.sin(turn), math.sin(tilt)])
    right = np.array([math.sin(turn), -math.cos(turn), 0.0])
    return forward, right, np.cross(right, forward)


def _plain(geom: Any, rgba: Rgba | None) -> None:  # Any: mjvGeom
    """One colour without gloss, whatever its material says; what has none is not drawn at all."""
    if rgba is None:
        geom.type = UNDRAWN
        return
    geom.rgba[:] = rgba
    geom.matid = -1
    geom.specular = geom.shininess = geom.reflectance = 0.0
    geom.emission = 0.1
    geom.transparent = int(rgba[3] < 1.0)


def _decorate(model: Model, size: float) -> None:
    """Arrows, dots and ellipsoids in units of the robot, whose mean size a small head decides."""
    scale, unit = model.vis.scale, size / float(model.stat.meansize)
    scale.com, scale.jointlength, scale.jointwidth = 0.02 * unit, 0.17 * unit, 0.006 * unit
    scale.contactwidth, scale.contactheight = 0.04 * unit, 0.009 * unit
    model.vis.global_.ellipsoidinertia = 1
    model.vis.rgba.inertia[:] = (0.9, 0.35, 0.25, 0.5)
    model.vis.rgba.joint[:] = (0.1, 0.45, 0.9, 1.0)
    model.vis.rgba.contactpoint[:] = (0.95, 0.2, 0.1, 1.0)


def _hue(number: int) -> Rgba:
    """Colours that neighbours do not share: steps of the golden ratio around the circle."""
    return (*colorsys.hsv_to_rgb(number * 0.618033988749895 % 1.0, 0.65, 0.95), 1.0)


DRAWING = NativeLimits(cpu_s=60.0, memory_mb=1 << 20)
"""Drivers crash and hang: that costs only the pictures. They map more memory than they use."""
LEAST_MATTER = 1e-6
"""kg and kg m2, of bodies that have none, in a model that is drawn and never moves."""
HERO, THUMBNAIL = "hero.png", "thumbnail.png"
SMALL = 256
"""Pixels along a side of the thumbnail."""
HINT = "`assetbuild doctor` says what to install"
NO_PICTURES = Rule(
    "pictures.none",
    "info",
    "the report has no picture: OpenGL cannot draw without a window here, or the MJCF does not "
    "load",
    "`assetbuild doctor`",
)


class Render(Step):
    """`mjcf/scene.xml` -> `images/hero.png` and the same, small, for the USD.

    A machine without OpenGL, or with a driver that crashes, writes no picture and leaves a finding;
    the renderer is part of the key, so a later driver makes them.
    """

    usual_s = 2.0
    outputs = ("images/",)
    isolated = True
    cpu_bound = True  # Mesa compiles its shaders for the CPU that it finds
    preload = ("mujoco",)
    limits: ClassVar[Limits] = Limits(wall_s=900.0)

    renderer: str
    """From `offscreen.renderer`: the same robot looks a little different on another driver."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the folder `mjcf/`."""
        folder = files.outputs / "images"
        folder.mkdir()
        try:
            draw(files.inputs / "mjcf" / "scene.xml", folder, self.renderer)
        except StepError as error:
            for half in folder.iterdir():
                half.unlink()
            yield NO_PICTURES("robot", f"no picture: {error.message}", hint=HINT)


def draw_all(scene: Path, folder: Path, renderer: str) -> None:
    """Write all pictures of a robot's `scene.xml` into a folder, which is made. StepError."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        draw(scene, folder, renderer, explained=True)
    except StepError as error:
        raise StepError(f"no pictures: {error.message}", hint=HINT) from None


def draw(scene: Path, folder: Path, renderer: str, *, explained: bool = False) -> None:
    """Write the picture of a robot with a small one, or those that explain it as well. StepError.

    In a process of its own.
    """
    stage = staged(scene, renderer, repaired=not explained)

    def work(opened: Studio) -> None:
        hero = stage.hero(opened)
        write(folder / HERO, hero)
        if not explained:
            write(folder / THUMBNAIL, _thumbnail(hero))
            return
        for name, pixels in stage.others(opened):
            write(folder / name, pixels)

    on_stage(stage, renderer, LONG, stage.size / 2.0, work)


def staged(scene: Path, renderer: str, *, repaired: bool = False) -> Stage:
    """The robot of a scene. StepError where nothing can be drawn.

    Without its contacts where they are too many for MuJoCo's memory. repaired: a robot whose mass
    or inertia MuJoCo refuses is seen all the same.
    """
    if renderer == "none":
        raise StepError("no OpenGL without a window (EGL or OSMesa) here, or `MUJOCO_GL` says so")
    try:
        model = mujoco.load(scene).model
    except StepError:
        if not repaired:
            raise
        model = mujoco.load(scene, change=_repair_inertia).model
    try:
        with mujoco.caught_warnings():
            return Stage(model)
    except mujoco.ArenaFullError:
        return Stage(mujoco.without(model, "CONTACT"))


def on_stage(
    stage: Stage, renderer: str, side: int, radius: float, draw: Callable[[Studio], None]
) -> None:
    """Draw in a process of its own. StepError where a driver fails.

    side: the most pixels along one of a frame; radius: m, half of the size of what is shown.
    """

    def work() -> tuple[()]:
        around = stage.middle, radius, stage.lowest
        with studio(renderer, stage.model, (side, side), *around) as opened:
            draw(opened)
        return ()

    try:
        run_apart(work, DRAWING)
    except NativeError as error:
        raise StepError(f"OpenGL by {renderer.partition(' ')[0]}: {error}") from None


def _repair_inertia(spec: Any) -> None:  # Any: MuJoCo's MjSpec
    spec.compiler.balanceinertia = True
    spec.compiler.boundmass = spec.compiler.boundinertia = LEAST_MATTER


def write(path: Path, pixels: Pixels) -> None:
    """Save a PNG."""
    from PIL import Image

    Image.fromarray(pixels).save(path, "PNG", compress_level=4)


def _thumbnail(pixels: Pixels) -> Pixels:
    """The picture on a square of 256 pixels."""
    from PIL import Image, ImageOps

    paper = (BACKGROUND,) * 3
    return np.asarray(ImageOps.pad(Image.fromarray(pixels), (SMALL, SMALL), color=paper))
