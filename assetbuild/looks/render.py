"""Pictures of the robot as people look at it in a viewer: shapes, masses, axes, contacts, turns."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from assetbuild.engine.step import Files, Limits, Step
from assetbuild.errors import StepError
from assetbuild.findings import Finding, Rule
from assetbuild.robot.pose import Vec3, vec3
from assetbuild.simulators import mujoco, offscreen
from assetbuild.simulators.mujoco import Data, Model
from assetbuild.simulators.offscreen import Pixels, Studio, View

WIDTH, HEIGHT = 640, 480
TILE_WIDTH, TILE_HEIGHT = 200, 150
ELEVATION, FOV = -18.0, 45.0
"""Of the camera, degrees; the field of view is MuJoCo's default."""
TURN = 0.3
"""rad (or share of the range of a sliding joint) by which a joint is turned to show its sign."""
DRAWING_S = 150.0
"""Wall clock for all pictures; a driver that hangs costs only them."""
MOST_JOINTS = 80
"""More joints than this are not shown one by one."""
CAPTION = 34
"""Characters above a tile of that width."""
BODY = (2, 3)
"""What stands for the robot: visual geometry, and collision geometry of bodies without any."""
HULLS = ("mjVIS_CONVEXHULL",)
"""A collision mesh that is not convex is shown as what MuJoCo collides: its hull."""
GREY = (0.72, 0.74, 0.77, 1.0)
MOVED = (0.95, 0.50, 0.10, 1.0)

NO_PICTURES = Rule(
    "pictures.none",
    "info",
    "the report has no pictures: OpenGL cannot draw without a window here, or the MJCF does not "
    "load",
    "`assetbuild doctor`",
)


@dataclass(frozen=True)
class Picture:
    """One file: its name, a title, and what there is to see for those who cannot."""

    file: str
    title: str
    alt: str
    pixels: Pixels


class Render(Step):
    """`mjcf/scene.xml` -> `images/*.png` and `pictures.json`, which says what each one shows.

    A machine without OpenGL, or with a driver that crashes, writes no picture and leaves a finding;
    the renderer is part of the key, so a later driver makes them.
    """

    version = "5"
    tools = ("mujoco", "pillow")
    outputs = ("images/", "pictures.json")
    isolated = True
    preload = ("mujoco",)
    limits: ClassVar[Limits] = Limits(wall_s=180.0)

    renderer: str
    """From `offscreen.renderer`: the same robot looks a little different on another driver."""
    turntable: int = 8
    """Views all around."""

    def run(self, files: Files) -> Iterator[Finding]:
        """Reads the folder `mjcf/`."""
        (files.outputs / "images").mkdir()
        problem = offscreen.run_apart(lambda: self._write(files), DRAWING_S)
        if problem:
            for half in (files.outputs / "images").iterdir():
                half.unlink()
            _write_list(files, [], "")
            yield NO_PICTURES(
                "robot", f"no pictures: {problem}", hint="`assetbuild doctor` says what to install"
            )

    def _write(self, files: Files) -> None:
        pictures, driver = self._pictures(files.inputs / "mjcf" / "scene.xml")
        for picture in pictures:
            (files.outputs / "images" / picture.file).write_bytes(png(picture.pixels))
        _write_list(files, pictures, driver)

    def _pictures(self, scene: Path) -> tuple[list[Picture], str]:
        if self.renderer == "none":
            raise StepError(
                "no OpenGL without a window (EGL or OSMesa) here, or `MUJOCO_GL` says so"
            )
        model = mujoco.load(scene).model
        with offscreen.studio(model, self.renderer, WIDTH, HEIGHT) as studio:
            data = at_home(model)
            stage = Stage(studio, model, data)
            made = [*stage.views(), *stage.turntable(self.turntable), *stage.directions()]
            return made, studio.driver()


def _write_list(files: Files, pictures: Sequence[Picture], driver: str) -> None:
    rows = [{"file": p.file, "title": p.title, "alt": p.alt} for p in pictures]
    text = json.dumps({"driver": driver, "pictures": rows}, indent=1, sort_keys=True)
    (files.outputs / "pictures.json").write_text(text + "\n", encoding="utf-8")


def at_home(model: Model) -> Data:
    """The first keyframe, or zero."""
    import mujoco as mj

    data = mj.MjData(model)
    if model.nkey:
        mj.mj_resetDataKeyframe(model, data, 0)
    mj.mj_forward(model, data)
    return data


class Stage:
    """The robot before the camera. The camera is the same in all pictures of one robot."""

    def __init__(self, studio: Studio, model: Model, data: Data) -> None:
        self.studio, self.model, self.data = studio, model, data
        self.center, self.size, self.distance = extent(model, data)
        visual = np.flatnonzero(np.asarray(model.geom_group) == 2)
        self._with_visual = frozenset(int(model.geom_bodyid[geom]) for geom in visual)
        self.looks = (0, 2) if self._with_visual else (0, 3)
        """Of a robot without any visual geometry one sees what collides, not an empty floor."""
        self.seen = f"the {'visual' if self._with_visual else 'collision'} geometry"
        scale = model.vis.scale
        # MuJoCo draws decorations in units of the model's mean size, which a small head decides.
        unit = self.size / float(model.stat.meansize)
        scale.com, scale.jointlength, scale.jointwidth = 0.03 * unit, 0.16 * unit, 0.012 * unit
        scale.contactwidth, scale.contactheight = 0.05 * unit, 0.012 * unit
        model.vis.global_.ellipsoidinertia = 1
        model.vis.rgba.inertia[:] = (0.9, 0.35, 0.25, 0.5)
        model.vis.rgba.joint[:] = (0.1, 0.45, 0.9, 1.0)
        model.vis.rgba.contactpoint[:] = (0.95, 0.2, 0.1, 1.0)

    def view(self, **more: Any) -> View:  # Any: the fields of View
        """The common camera."""
        return View(self.center, self.distance, elevation=ELEVATION, **more)

    def views(self) -> Iterator[Picture]:
        """Six large pictures."""
        colours = self._by_piece(1.0)
        clear, faint = self._by_piece(0.45), self._faded(0.18)
        ghost = self._faded(0.18, spare=False)
        shots: tuple[tuple[str, str, str, dict[str, Any]], ...] = (  # Any: the fields of View
            ("visual", "Visual", f"{self.seen} at home", {"groups": self.looks}),
            ("collision", "Collision", "the collision geometry, a colour for each piece",
             {"groups": (0, 3), "flags": HULLS, "paint": colours}),
            ("overlay", "Both", "collision geometry laid over the visual geometry",
             {"groups": (2, 3), "flags": HULLS, "paint": clear}),
            ("inertia", "Inertia", "equivalent inertia ellipsoids and centres of mass",
             {"groups": BODY, "flags": ("mjVIS_INERTIA", "mjVIS_COM"), "paint": faint}),
            ("joints", "Joint axes", "an arrow along the axis of each joint",
             {"groups": BODY, "flags": ("mjVIS_JOINT",), "paint": faint}),
            ("contacts", "Contacts", f"where it touches at home: {self.data.ncon} points",
             {"groups": (0, 3), "flags": ("mjVIS_CONTACTPOINT",), "paint": ghost}),
        )  # fmt: skip
        for name, title, alt, more in shots:
            if name == "contacts" and not self.data.ncon:
                continue
            pixels = self.studio.frame(self.data, self.view(**more))
            yield Picture(f"{name}.png", title, alt, pixels)

    def turntable(self, count: int) -> Iterator[Picture]:
        """One strip of views all around."""
        tiles = [
            self.studio.frame(
                self.data,
                self.view(
                    azimuth=140.0 + 360.0 * n / count,
                    width=TILE_WIDTH,
                    height=TILE_HEIGHT,
                    groups=self.looks,
                ),
            )
            for n in range(count)
        ]
        if tiles:
            alt = f"{self.seen} from {count} sides"
            yield Picture("turntable.png", "Turntable", alt, sheet(tiles, [""] * count, 4))

    def directions(self) -> Iterator[Picture]:
        """Each joint turned by -0.3 and +0.3 rad from home; what moves is orange."""
        import mujoco as mj

        turning = (mj.mjtJoint.mjJNT_HINGE.value, mj.mjtJoint.mjJNT_SLIDE.value)
        joints = [j for j in range(self.model.njnt) if int(self.model.jnt_type[j]) in turning]
        if not joints or len(joints) > MOST_JOINTS:
            return
        tiles, texts = [], []
        for joint in joints:
            paint = self._highlighted(self._below(int(self.model.jnt_bodyid[joint])))
            for value in self._offsets(joint):
                tiles.append(self._turned(joint, value, paint))
                unit = "rad" if int(self.model.jnt_type[joint]) == turning[0] else "m"
                name = mujoco.name_of(self.model, "joint", joint)
                texts.append(caption(name, f" {value:+.2g} {unit}"))
        alt = "each joint turned to both sides of home; the part that moves is orange"
        yield Picture("directions.png", "Joint directions", alt, sheet(tiles, texts, 4))

    def _offsets(self, joint: int) -> tuple[float, float]:
        import mujoco as mj

        if int(self.model.jnt_type[joint]) == mj.mjtJoint.mjJNT_HINGE.value:
            return (-TURN, TURN)
        lower, upper = (float(v) for v in self.model.jnt_range[joint])
        travel = TURN * (upper - lower) if self.model.jnt_limited[joint] else 0.1
        return (-travel, travel)

    def _turned(self, joint: int, value: float, paint: offscreen.Paint) -> Pixels:
        import mujoco as mj

        data = at_home(self.model)
        data.qpos[int(self.model.jnt_qposadr[joint])] += value
        mj.mj_kinematics(self.model, data)
        view = self.view(groups=BODY, width=TILE_WIDTH, height=TILE_HEIGHT, paint=paint)
        return self.studio.frame(data, view)

    def _below(self, body: int) -> frozenset[int]:
        """A body and all that hangs on it."""
        found = {body}
        for child in range(body + 1, self.model.nbody):
            if int(self.model.body_parentid[child]) in found:
                found.add(child)
        return frozenset(found)

    def _is_robot(self, geom: Any) -> bool:  # Any: mjvGeom
        import mujoco as mj

        is_geom = geom.objtype == mj.mjtObj.mjOBJ_GEOM.value
        return bool(is_geom and self.model.geom_bodyid[geom.objid] != 0)

    def _is_spare(self, geom: Any) -> bool:  # Any: mjvGeom
        """Collision geometry of a body that has visual geometry to be seen by."""
        is_collision = int(self.model.geom_group[geom.objid]) == 3
        return is_collision and int(self.model.geom_bodyid[geom.objid]) in self._with_visual

    def _is_free_joint(self, geom: Any) -> bool:  # Any: mjvGeom
        import mujoco as mj

        is_joint = geom.objtype == mj.mjtObj.mjOBJ_JOINT.value
        return bool(is_joint and self.model.jnt_type[geom.objid] == mj.mjtJoint.mjJNT_FREE.value)

    def _by_piece(self, alpha: float) -> offscreen.Paint:
        """A colour of its own for each collision piece; visual geometry keeps its own."""

        def paint(geom: Any) -> None:  # Any: mjvGeom
            if self._is_robot(geom) and int(self.model.geom_group[geom.objid]) == 3:
                plain(geom, (*hue(geom.objid), alpha))

        return paint

    def _faded(self, alpha: float, *, spare: bool = True) -> offscreen.Paint:
        def paint(geom: Any) -> None:  # Any: mjvGeom
            if self._is_robot(geom):
                plain(geom, (*GREY[:3], 0.0 if spare and self._is_spare(geom) else alpha))
            elif self._is_free_joint(geom):
                geom.rgba[3] = 0.0  # a box in the middle of the robot says nothing

        return paint

    def _highlighted(self, bodies: frozenset[int]) -> offscreen.Paint:
        def paint(geom: Any) -> None:  # Any: mjvGeom
            if self._is_robot(geom):
                if self._is_spare(geom):
                    plain(geom, (0.0, 0.0, 0.0, 0.0))
                    return
                moves = int(self.model.geom_bodyid[geom.objid]) in bodies
                plain(geom, MOVED if moves else GREY)

        return paint


def plain(geom: Any, rgba: tuple[float, float, float, float]) -> None:  # Any: mjvGeom
    """One colour without gloss, whatever its material says."""
    geom.rgba[:] = rgba
    geom.matid = -1
    geom.specular = geom.shininess = geom.reflectance = 0.0
    geom.emission = 0.25
    geom.transparent = int(rgba[3] < 1.0)


def extent(model: Model, data: Data) -> tuple[Vec3, float, float]:
    """Middle of the robot's box, its size (m), and how far away the camera sees all of it (m)."""
    robot = np.flatnonzero(
        (np.asarray(model.geom_bodyid) != 0) & (np.asarray(model.geom_group) < 4)
    )
    if not len(robot):
        return vec3(data.subtree_com[0]), 1.0, 2.0
    turned = np.array(data.geom_xmat).reshape(-1, 3, 3)[robot]
    box = np.array(model.geom_aabb)[robot]
    middles = np.array(data.geom_xpos)[robot] + np.einsum("nij,nj->ni", turned, box[:, :3])
    halves = np.einsum("nij,nj->ni", np.abs(turned), box[:, 3:])
    lower, upper = (middles - halves).min(axis=0), (middles + halves).max(axis=0)
    across = math.hypot(*(upper - lower)[:2])
    tall = float(upper[2] - lower[2]) + abs(math.sin(math.radians(ELEVATION))) * across
    fits = max(tall, across * HEIGHT / WIDTH) / (2.0 * math.tan(math.radians(FOV / 2.0)))
    size = max(float(np.linalg.norm(upper - lower)), 1e-3)
    return vec3((lower + upper) / 2.0), size, max(1.1 * fits + across / 3.0, 1e-3)


def hue(number: int) -> tuple[float, float, float]:
    """Colours that neighbours do not share: steps of the golden ratio around the circle."""
    import colorsys

    return colorsys.hsv_to_rgb(number * 0.618033988749895 % 1.0, 0.65, 0.95)


def caption(name: str, tail: str) -> str:
    """Name and tail as wide as a tile; of a long name both ends: `FR_` tells legs apart."""
    room = CAPTION - len(tail)
    if len(name) > room:
        head = (room - 3) // 2
        name = f"{name[:head]}...{name[head + 3 - room :]}"
    return name + tail


def sheet(tiles: Sequence[Pixels], texts: Sequence[str], columns: int) -> Pixels:
    """Tiles in rows, each with its text above."""
    from PIL import Image, ImageDraw, ImageFont

    height, width = tiles[0].shape[:2]
    band = 16 if any(texts) else 0
    rows = -(-len(tiles) // columns)
    page = Image.new("RGB", (columns * width, rows * (height + band)), (250, 250, 250))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(11)
    for number, (tile, text) in enumerate(zip(tiles, texts, strict=True)):
        x, y = number % columns * width, number // columns * (height + band)
        page.paste(Image.fromarray(tile), (x, y + band))
        if text:
            draw.text((x + 4, y + 1), text, fill=(20, 20, 20), font=font)
    return np.asarray(page)


def png(pixels: Pixels) -> bytes:
    """A PNG of 128 colours: a quarter of the size, and no picture here needs more."""
    from PIL import Image

    image = Image.fromarray(pixels).quantize(128, method=Image.Quantize.MEDIANCUT)
    out = io.BytesIO()
    image.save(out, "PNG", optimize=True)
    return out.getvalue()
