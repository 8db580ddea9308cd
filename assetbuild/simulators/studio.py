"""A model before a camera: frames with antialiasing, soft shadows and an even background."""

from __future__ import annotations

import ctypes
import importlib
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from assetbuild.errors import StepError
from assetbuild.robot.pose import Array
from assetbuild.simulators.mujoco import Data, Model

Pixels = NDArray[np.uint8]
Paint = Callable[[Any], None]
"""Changes one mjvGeom of a scene before it is drawn. Any: MuJoCo's types have no stubs."""
BACKGROUND = 240
"""Grey level of the floor in the light and of what lies behind it."""
FLOOR = 0.55
"""Share of the floor's brightness that a shadow can take; the rest shines by itself."""
SHADOW_MAP = 1024
"""Pixels across the shadow map; the average over several lamps hides its steps."""
LAMP = 0.07
"""Radius of the lamp as seen from the robot, rad: how soft its shadows are."""
PENUMBRA = 1.0 / 130.0
"""How far shadows on the floor are blurred, as a share of the picture's width."""
BLUR_STEP = 4
"""Shadows are blurred in a picture that is so many times smaller."""
EDGE = 2
"""Pixels at the edge of the floor that hold some of what stands there: they are not blurred."""
GHOST_AHEAD = 0.006
"""How far a second state is brought before the first, which it would flicker through where both
coincide, as a share of the radius."""
GOLDEN_ANGLE = 2.399963
"""rad; points that turn by it fill a disc evenly."""


@dataclass(frozen=True, eq=False)
class Camera:
    """Where a picture is taken from. position: m; forward, up: unit vectors, all in the world.

    half_width, half_height: of the picture at a distance of 1 m, m.
    """

    position: Array
    forward: Array
    up: Array
    half_width: float
    half_height: float

    @property
    def right(self) -> Array:
        """The unit vector to the right of the picture, in the world."""
        return np.cross(self.forward, self.up)

    def project(self, points: Array) -> Array:
        """(n, 2) places in the picture, 0..1 from its upper left corner; points: (n, 3) m."""
        seen = (points - self.position) @ np.stack([self.right, self.up, self.forward]).T
        depth = np.maximum(seen[:, 2], 1e-9)
        across = seen[:, 0] / (depth * self.half_width)
        above = seen[:, 1] / (depth * self.half_height)
        return np.stack([0.5 + 0.5 * across, 0.5 - 0.5 * above], axis=1)


@dataclass(frozen=True, eq=False)
class Shot:
    """What a frame shows.

    groups: geom groups (0 floor, 2 visual, 3 collision). flags: names such as `mjVIS_JOINT`.
    ghost: a second state that is drawn into the same frame, painted by `ghost_paint`.
    samples: frames that are averaged, each shifted by a part of a pixel; `soft` moves the lamp.
    """

    camera: Camera
    width: int
    height: int
    groups: tuple[int, ...] = (0, 2)
    flags: tuple[str, ...] = ()
    samples: int = 2
    soft: bool = False
    paint: Paint | None = field(default=None)
    ghost: Data | None = field(default=None)
    ghost_paint: Paint | None = field(default=None)


class Studio:
    """An OpenGL context with one model in it, and a floor under what stands there.

    middle: m, centre of what is shown; radius: m, half of its size; floor: its lowest point, m.
    """

    def __init__(self, model: Model, middle: Array, radius: float, floor: float) -> None:
        import mujoco

        self.model, self.middle, self.radius, self.floor = model, middle, radius, floor
        self._plain_sky()
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50.value)
        self._context.shadowClip = 1.6 * radius
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene = mujoco.MjvScene(model, maxgeom=20_000)

    def _plain_sky(self) -> None:
        """The sky in the colour of the floor: an empty studio without a horizon."""
        import mujoco

        model = self.model
        for number in np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX.value):
            start = int(model.tex_adr[number])
            sizes = (model.tex_height, model.tex_width, model.tex_nchannel)
            count = math.prod(int(size[number]) for size in sizes)
            model.tex_data[start : start + count] = BACKGROUND

    def driver(self) -> str:
        """OpenGL's own name for what draws, such as `llvmpipe (LLVM 15.0.6, 256 bits)`."""
        from OpenGL.raw.GL.VERSION.GL_1_0 import GL_RENDERER, glGetString

        return ctypes.string_at(glGetString(GL_RENDERER)).decode("utf-8", "replace")

    def frame(self, data: Data, shot: Shot) -> Pixels:
        """(height, width, 3) colours."""
        import mujoco

        self._arrange(data, shot)
        scene, camera = self._scene, shot.camera
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW.value] = shot.soft
        rect = mujoco.MjrRect(0, 0, shot.width, shot.height)
        pixels = np.zeros((shot.height, shot.width, 3), dtype=np.uint8)
        total = np.zeros(pixels.shape, dtype=np.uint16)
        for number in range(shot.samples):
            self._light(camera, number, shot)
            self._aim(camera, number, shot)
            mujoco.mjr_render(rect, scene, self._context)
            mujoco.mjr_readPixels(pixels, None, rect, self._context)
            total += pixels
        mean = (total + shot.samples // 2) // shot.samples
        if shot.soft:
            mean = _blurred(mean, self._is_floor(shot), max(1, int(PENUMBRA * shot.width)))
        return np.ascontiguousarray(mean[::-1], dtype=np.uint8)

    def _is_floor(self, shot: Shot) -> NDArray[np.bool_]:
        """(height, width), from below: where the floor or nothing is seen."""
        import mujoco

        flags = self._scene.flags
        flags[mujoco.mjtRndFlag.mjRND_SHADOW.value] = 0
        numbered = (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR)
        flags[[flag.value for flag in numbered]] = 1
        rect = mujoco.MjrRect(0, 0, shot.width, shot.height)
        pixels = np.zeros((shot.height, shot.width, 3), dtype=np.uint8)
        mujoco.mjr_render(rect, self._scene, self._context)
        mujoco.mjr_readPixels(pixels, None, rect, self._context)
        flags[[flag.value for flag in numbered]] = 0
        geoms = self._scene.geoms[: self._scene.ngeom]
        red, green, blue = (pixels[..., channel].astype(np.uint32) for channel in range(3))
        number = red | green << 8 | blue << 16
        floors = [0, *(1 + geom.segid for geom in geoms if _is_plane(geom))]
        return np.asarray(np.isin(number, np.array(floors, dtype=np.uint32)), dtype=np.bool_)

    def _arrange(self, data: Data, shot: Shot) -> None:
        import mujoco

        option = mujoco.MjvOption()
        option.geomgroup[:] = option.sitegroup[:] = 0
        option.geomgroup[list(shot.groups)] = 1
        for flag in shot.flags:
            option.flags[getattr(mujoco.mjtVisFlag, flag)] = 1
        scene, free = self._scene, mujoco.MjvCamera()
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self.model, data, option, None, free, everything, scene)
        for name in ("mjRND_REFLECTION", "mjRND_HAZE", "mjRND_FOG"):
            scene.flags[getattr(mujoco.mjtRndFlag, name)] = 0
        shown = scene.ngeom
        self._paint(scene.geoms[:shown], shot.paint)
        if shot.ghost is not None:
            robot = mujoco.mjtCatBit.mjCAT_DYNAMIC.value
            mujoco.mjv_addGeoms(self.model, shot.ghost, option, mujoco.MjvPerturb(), robot, scene)
            self._paint(scene.geoms[shown : scene.ngeom], shot.ghost_paint)
            for geom in scene.geoms[shown : scene.ngeom]:
                geom.pos[:] -= GHOST_AHEAD * self.radius * shot.camera.forward

    def _paint(self, geoms: Any, paint: Paint | None) -> None:  # Any: mjvGeom
        for geom in geoms:
            if _is_plane(geom):
                self._plain_floor(geom)
            elif paint is not None:
                paint(geom)

    def _plain_floor(self, floor: Any) -> None:  # Any: mjvGeom
        floor.matid = -1
        floor.rgba[:] = (FLOOR, FLOOR, FLOOR, 1.0)
        floor.emission = (1.0 / FLOOR - 1.0) * BACKGROUND / 255.0
        floor.specular = floor.shininess = floor.reflectance = 0.0
        floor.pos[2] = self.floor

    def _light(self, camera: Camera, number: int, shot: Shot) -> None:
        """A lamp over the left shoulder of the camera, which casts shadows, and a fill light."""
        lamp = lamp_direction(camera.forward, camera.right)
        if shot.soft:
            out = LAMP * math.sqrt((number + 0.5) / shot.samples)
            side = _unit(np.cross(lamp, camera.right))
            angle = number * GOLDEN_ANGLE
            lamp = _unit(
                lamp + out * (math.cos(angle) * side + math.sin(angle) * np.cross(lamp, side))
            )
        self._scene.nlight = 2
        falls = -float(lamp[2])
        slanted = max(-float(camera.forward[2]), 0.0)
        fill, ambient, key = 0.26, 0.36, 0.58
        # A white floor in these three lights is as grey as the background.
        key = (BACKGROUND / 255.0 - ambient - fill * slanted) / falls if falls > 0.3 else key
        self._directed(0, lamp, key, 0.18, 0.0, shot.soft)
        self._directed(1, camera.forward, fill, 0.05, ambient, False)

    def _directed(
        self, number: int, way: Array, diffuse: float, shine: float, ambient: float, shadow: bool
    ) -> None:
        import mujoco

        light = self._scene.lights[number]
        light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL.value
        light.texid, light.headlight, light.castshadow = -1, 0, shadow
        light.dir[:] = way
        light.pos[:] = self.middle - 3.0 * self.radius * way
        light.ambient[:], light.diffuse[:], light.specular[:] = ambient, diffuse, shine
        light.attenuation[:] = (1.0, 0.0, 0.0)
        light.cutoff, light.exponent, light.range = 180.0, 0.0, 20.0 * self.radius

    def _aim(self, camera: Camera, number: int, shot: Shot) -> None:
        """The camera, shifted by its sample's part of a pixel."""
        right = (number + 0.5) / shot.samples - 0.5
        above = (number * 0.618034 + 0.5) % 1.0 - 0.5
        distance = float(np.linalg.norm(self.middle - camera.position))
        near = max(0.02 * distance, distance - 6.0 * self.radius)
        high, wide = camera.half_height * near, camera.half_width * near
        for eye in self._scene.camera:
            eye.pos[:], eye.forward[:], eye.up[:] = camera.position, camera.forward, camera.up
            eye.orthographic = 0
            eye.frustum_near, eye.frustum_far = near, distance + 40.0 * self.radius
            eye.frustum_width = wide
            eye.frustum_center = 2.0 * wide * right / shot.width
            eye.frustum_top = high + 2.0 * high * above / shot.height
            eye.frustum_bottom = -high + 2.0 * high * above / shot.height

    def free(self) -> None:
        """Give the context's memory back before the context goes."""
        self._context.free()


def lamp_direction(forward: Array, right: Array) -> Array:
    """Where the light of the lamp over the camera's left shoulder goes, a unit vector."""
    return _unit(0.55 * forward + 0.5 * right - np.array([0.0, 0.0, 1.25]))


def _is_plane(geom: Any) -> bool:  # Any: mjvGeom
    """Whether it is a floor: nothing that moves may be a plane."""
    import mujoco

    return _is_geom(geom) and bool(geom.type == mujoco.mjtGeom.mjGEOM_PLANE.value)


def _is_geom(geom: Any) -> bool:  # Any: mjvGeom
    import mujoco

    return bool(geom.objtype == mujoco.mjtObj.mjOBJ_GEOM.value)


def _blurred(pixels: NDArray[Any], where: NDArray[np.bool_], radius: int) -> NDArray[Any]:
    """Two box filters over the pixels of a mask, which take nothing from outside of it."""
    from PIL import Image

    inside = _shrunk(where, EDGE)
    size = (where.shape[1] // BLUR_STEP, where.shape[0] // BLUR_STEP)

    def smooth(values: NDArray[Any]) -> NDArray[np.float32]:
        image = Image.fromarray(values.astype(np.float32))
        small = np.asarray(image.resize(size, Image.Resampling.BOX))
        for _ in range(2):
            small = _box_mean(_box_mean(small, radius // BLUR_STEP).T, radius // BLUR_STEP).T
        blurred = Image.fromarray(np.ascontiguousarray(small))
        return np.asarray(blurred.resize(image.size, Image.Resampling.BILINEAR))

    grey = smooth(np.where(inside, pixels[..., 1], 0.0))
    weight = smooth(inside)
    level = np.round(grey / np.maximum(weight, 1e-6)).astype(pixels.dtype)
    return np.where(inside[..., None], level[..., None], pixels)


def _shrunk(where: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    """The mask without what lies within so many pixels of its edge."""
    kept = where.copy()
    for before, after in ((where, kept), (kept.copy().T, kept.T)):
        for shift in range(1, pixels + 1):
            after[shift:] &= before[:-shift]
            after[:-shift] &= before[shift:]
    return kept


def _box_mean(rows: NDArray[np.float32], radius: int) -> NDArray[np.float32]:
    """The mean of each value and its neighbours in its column, up to `radius` rows away."""
    padded = np.pad(rows, ((radius + 1, radius), (0, 0)), mode="edge")
    sums = np.cumsum(padded, axis=0, dtype=np.float64)
    width = 2 * radius + 1
    return np.asarray((sums[width:] - sums[:-width]) / width, dtype=np.float32)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)


@contextmanager
def opengl(renderer: str, size: tuple[int, int]) -> Iterator[None]:
    """OpenGL without a window, on the named renderer; StepError where there is none.

    One context for all studios: it compiles its shaders once. Its class is taken from MuJoCo's own
    module: MuJoCo's environment variable is read once, at import, which is too early for a process
    that serves many steps.
    """
    kind = renderer.partition(" ")[0]
    try:
        context = importlib.import_module(f"mujoco.{kind}").GLContext(*size)
        context.make_current()
    except Exception as error:  # whatever a driver throws: there is no picture then
        text = " ".join(str(error).split())[:200]
        raise StepError(f"OpenGL by {kind} does not start: {text}") from error
    try:
        yield
    finally:
        context.free()


@contextmanager
def studio(
    model: Model, size: tuple[int, int], middle: Array, radius: float, floor: float
) -> Iterator[Studio]:
    """A studio in the current OpenGL context for frames up to `size` pixels."""
    model.vis.global_.offwidth, model.vis.global_.offheight = size
    model.vis.quality.offsamples, model.vis.quality.shadowsize = 0, SHADOW_MAP
    opened = Studio(model, middle, radius, floor)
    try:
        yield opened
    finally:
        opened.free()
