"""A model before a camera: frames with antialiasing, soft shadows and an even background."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from assetbuild.robot.pose import Array
from assetbuild.simulators.mujoco import Data, Model, mj

Pixels = NDArray[np.uint8]
Paint = Callable[[Any], None]
"""Changes one mjvGeom of a scene before it is drawn. Any: MuJoCo's types have no stubs."""
BACKGROUND = 240
"""Grey level of the floor in the light and of what lies behind it."""
FLOOR = 0.55
"""Share of the floor's brightness that a shadow can take; the rest shines by itself."""
SHADOW_MAP = 2048
"""Pixels across the shadow map: with half of them the steps of a shadow on the robot are seen."""
PENUMBRA = 1.0 / 160.0
"""How far shadows on the floor are blurred, as a share of the picture's width."""
EDGE = 3
"""Pixels at the edge of the floor that hold some of what stands there: they are not blurred."""


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

    def moved(self, shift: Array) -> Camera:
        """The same camera elsewhere. shift: (3,) m, in the world."""
        return replace(self, position=self.position + shift)


@dataclass(frozen=True, eq=False)
class Shot:
    """What a frame shows.

    groups: geom groups (0 floor, 2 visual, 3 collision). flags: names such as `mjVIS_JOINT`.
    samples: frames that are averaged, each shifted by a part of a pixel. shadow: the robot throws
    one, whose edge on the floor is soft.
    """

    camera: Camera
    width: int
    height: int
    groups: tuple[int, ...] = (0, 2)
    flags: tuple[str, ...] = ()
    samples: int = 2
    shadow: bool = False
    paint: Paint | None = None


@contextmanager
def studio(
    renderer: str, model: Model, size: tuple[int, int], middle: Array, radius: float, floor: float
) -> Iterator[Studio]:
    """OpenGL without a window on the named renderer, for frames up to `size` pixels.

    MuJoCo's environment variable is read once, at import, which is too early for a process that
    serves many steps: its class is taken from MuJoCo's own module.
    """
    context = importlib.import_module(f"mujoco.{renderer.partition(' ')[0]}").GLContext(*size)
    context.make_current()
    try:
        model.vis.global_.offwidth, model.vis.global_.offheight = size
        model.vis.quality.offsamples, model.vis.quality.shadowsize = 0, SHADOW_MAP
        yield Studio(model, middle, radius, floor)
    finally:
        context.free()


class Studio:
    """One model in the current OpenGL context, and a floor under what stands there.

    middle: m, centre of what is shown; radius: m, half of its size; floor: its lowest point, m.
    """

    def __init__(self, model: Model, middle: Array, radius: float, floor: float) -> None:
        self.model, self.middle, self.radius, self.floor = model, middle, radius, floor
        self._plain_sky()
        self._context = mj.MjrContext(model, mj.mjtFontScale.mjFONTSCALE_50.value)
        self._context.shadowClip = 1.6 * radius
        mj.mjr_setBuffer(mj.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene = mj.MjvScene(model, maxgeom=20_000)

    def _plain_sky(self) -> None:
        """The sky in the colour of the floor: an empty studio without a horizon."""
        model = self.model
        for number in np.flatnonzero(model.tex_type == mj.mjtTexture.mjTEXTURE_SKYBOX.value):
            start = int(model.tex_adr[number])
            sizes = (model.tex_height, model.tex_width, model.tex_nchannel)
            count = math.prod(int(size[number]) for size in sizes)
            model.tex_data[start : start + count] = BACKGROUND

    def frame(self, data: Data, shot: Shot) -> Pixels:
        """(height, width, 3) colours."""
        self._arrange(data, shot)
        self._scene.flags[mj.mjtRndFlag.mjRND_SHADOW.value] = shot.shadow
        total = np.zeros((shot.height, shot.width, 3), dtype=np.uint16)
        self._light(shot)
        for number in range(shot.samples):
            self._aim(number, shot)
            total += self._drawn(shot)
        mean = (total + shot.samples // 2) // shot.samples
        if shot.shadow:
            mean = _blurred(mean, self._is_floor(shot), PENUMBRA * shot.width)
        return np.ascontiguousarray(mean[::-1], dtype=np.uint8)

    def _drawn(self, shot: Shot) -> Pixels:
        """(height, width, 3), from below."""
        rect = mj.MjrRect(0, 0, shot.width, shot.height)
        pixels = np.zeros((shot.height, shot.width, 3), dtype=np.uint8)
        mj.mjr_render(rect, self._scene, self._context)
        mj.mjr_readPixels(pixels, None, rect, self._context)
        return pixels

    def _is_floor(self, shot: Shot) -> NDArray[np.bool_]:
        """(height, width), from below: where the floor or nothing is seen, to two pixels."""
        flags = self._scene.flags
        flags[mj.mjtRndFlag.mjRND_SHADOW.value] = 0
        flags[mj.mjtRndFlag.mjRND_SEGMENT.value] = 1
        flags[mj.mjtRndFlag.mjRND_IDCOLOR.value] = 1
        half = replace(shot, width=-(-shot.width // 2), height=-(-shot.height // 2))
        red, green, blue = np.moveaxis(self._drawn(half).astype(np.uint32), 2, 0)
        geoms = self._scene.geoms[: self._scene.ngeom]
        floors = [0, *(1 + geom.segid for geom in geoms if _is_plane(geom))]
        found = np.isin(red | green << 8 | blue << 16, np.array(floors, dtype=np.uint32))
        whole: NDArray[np.bool_] = found.repeat(2, axis=0).repeat(2, axis=1)
        return whole[: shot.height, : shot.width]

    def _arrange(self, data: Data, shot: Shot) -> None:
        option = mj.MjvOption()
        option.geomgroup[:] = option.sitegroup[:] = 0
        option.geomgroup[list(shot.groups)] = 1
        for flag in shot.flags:
            option.flags[getattr(mj.mjtVisFlag, flag)] = 1
        scene, free = self._scene, mj.MjvCamera()
        everything = mj.mjtCatBit.mjCAT_ALL.value
        mj.mjv_updateScene(self.model, data, option, None, free, everything, scene)
        for name in ("REFLECTION", "HAZE", "FOG", "SEGMENT", "IDCOLOR"):
            scene.flags[getattr(mj.mjtRndFlag, f"mjRND_{name}")] = 0
        for geom in scene.geoms[: scene.ngeom]:
            if _is_plane(geom):
                self._plain_floor(geom)
            elif shot.paint is not None:
                shot.paint(geom)

    def _plain_floor(self, floor: Any) -> None:  # Any: mjvGeom
        floor.matid = -1
        floor.rgba[:] = (FLOOR, FLOOR, FLOOR, 1.0)
        floor.emission = (1.0 / FLOOR - 1.0) * BACKGROUND / 255.0
        floor.specular = floor.shininess = floor.reflectance = 0.0
        floor.pos[2] = self.floor

    def _light(self, shot: Shot) -> None:
        """A lamp over the left shoulder of the camera, which casts shadows, and a fill light."""
        forward = shot.camera.forward
        lamp = lamp_direction(forward, shot.camera.right)
        self._scene.nlight = 2
        falls = -float(lamp[2])
        slanted = max(-float(forward[2]), 0.0)
        fill, ambient, key = 0.26, 0.36, 0.58
        # A white floor in these three lights is as grey as the background.
        key = (BACKGROUND / 255.0 - ambient - fill * slanted) / falls if falls > 0.3 else key
        self._directed(0, lamp, key, 0.18, 0.0, shot.shadow)
        self._directed(1, forward, fill, 0.05, ambient, False)

    def _directed(
        self, number: int, way: Array, diffuse: float, shine: float, ambient: float, shadow: bool
    ) -> None:
        light = self._scene.lights[number]
        light.type = mj.mjtLightType.mjLIGHT_DIRECTIONAL.value
        light.texid, light.headlight, light.castshadow = -1, 0, shadow
        light.dir[:] = way
        light.pos[:] = self.middle - 3.0 * self.radius * way
        light.ambient[:], light.diffuse[:], light.specular[:] = ambient, diffuse, shine
        light.attenuation[:] = (1.0, 0.0, 0.0)
        light.cutoff, light.exponent, light.range = 180.0, 0.0, 20.0 * self.radius

    def _aim(self, number: int, shot: Shot) -> None:
        """The camera, shifted by its sample's part of a pixel."""
        camera = shot.camera
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


def lamp_direction(forward: Array, right: Array) -> Array:
    """Where the light of the lamp over the camera's left shoulder goes, a unit vector."""
    return _unit(0.55 * forward + 0.5 * right - np.array([0.0, 0.0, 1.25]))


def _is_plane(geom: Any) -> bool:  # Any: mjvGeom
    """Whether it is a floor: nothing that moves may be a plane."""
    is_geom = geom.objtype == mj.mjtObj.mjOBJ_GEOM.value
    return bool(is_geom and geom.type == mj.mjtGeom.mjGEOM_PLANE.value)


def _blurred(pixels: NDArray[Any], where: NDArray[np.bool_], radius: float) -> NDArray[Any]:
    """A Gaussian filter over the pixels of a mask, which takes nothing from outside of it."""
    from PIL import Image, ImageFilter

    share = Image.fromarray(where).convert("L").filter(ImageFilter.BoxBlur(EDGE))
    inside = np.asarray(share) == 255
    grey = np.where(inside, pixels[..., 1], 0).astype(np.uint8)
    smooth, weight = (
        np.asarray(Image.fromarray(values).filter(ImageFilter.GaussianBlur(radius)), np.float32)
        for values in (grey, np.where(inside, 255, 0).astype(np.uint8))
    )
    level = np.round(255.0 * smooth / np.maximum(weight, 1.0)).astype(pixels.dtype)
    return np.where(inside[..., None], level[..., None], pixels)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)
