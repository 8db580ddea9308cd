"""Pictures of the robot as people look at it in a viewer: shapes, masses, axes, contacts, turns."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Iterator, Sequence
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
"""Elevation and field of view of the camera, degrees; MuJoCo's default field of view."""
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
Rgba = tuple[float, float, float, float]
CLEAR: Rgba = (0.0, 0.0, 0.0, 0.0)
GREY: Rgba = (0.72, 0.74, 0.77, 1.0)
MOVED: Rgba = (0.95, 0.50, 0.10, 1.0)

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

    outputs = ("images/", "pictures.json")
    isolated = True
    cpu_bound = True  # Mesa compiles its shaders for the CPU that it finds
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
            data = mujoco.at_key(model)
            stage = Stage(studio, model, data)
            made = [*stage.views(), *stage.turntable(self.turntable), *stage.directions()]
            return made, studio.driver()


def _write_list(files: Files, pictures: Sequence[Picture], driver: str) -> None:
    rows = [{"file": p.file, "title": p.title, "alt": p.alt} for p in pictures]
    text = json.dumps({"driver": driver, "pictures": rows}, indent=1, sort_keys=True)
    (files.outputs / "pictures.json").write_text(text + "\n", encoding="utf-8")


class Stage:
    """The robot before the camera. The camera is the same in all pictures of one robot."""

    def __init__(self, studio: Studio, model: Model, data: Data) -> None:
        self.studio, self.model, self.data = studio, model, data
        self.center, self.size, self.distance = extent(model, data)
        groups, bodies = np.asarray(model.geom_group), np.asarray(model.geom_bodyid)
        visual, pieces = bodies[groups == 2], groups == 3
        self._pieces = frozenset(np.flatnonzero(pieces).tolist())
        self._spare = frozenset(np.flatnonzero(pieces & np.isin(bodies, visual)).tolist())
        """Collision geometry of bodies that have visual geometry to be seen by."""
        self.looks = (0, 2) if len(visual) else (0, 3)
        """Groups of geoms that are drawn: without visual geometry, the collision geometry."""
        self.seen = f"the {'visual' if len(visual) else 'collision'} geometry"
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

    def tile(self, data: Data, **more: Any) -> Pixels:  # Any: the fields of View
        """One of many small pictures."""
        return self.studio.frame(data, self.view(width=TILE_WIDTH, height=TILE_HEIGHT, **more))

    def turntable(self, count: int) -> Iterator[Picture]:
        """One strip of views all around."""
        turns = [140.0 + 360.0 * n / count for n in range(count)]
        tiles = [self.tile(self.data, azimuth=turn, groups=self.looks) for turn in turns]
        if tiles:
            alt = f"{self.seen} from {count} sides"
            yield Picture("turntable.png", "Turntable", alt, sheet(tiles, [""] * count))

    def directions(self) -> Iterator[Picture]:
        """Each joint turned by -0.3 and +0.3 rad from home; what moves is orange."""
        import mujoco as mj

        hinge, slide = mj.mjtJoint.mjJNT_HINGE.value, mj.mjtJoint.mjJNT_SLIDE.value
        kinds = [int(kind) for kind in self.model.jnt_type]
        joints = [joint for joint, kind in enumerate(kinds) if kind in (hinge, slide)]
        if not joints or len(joints) > MOST_JOINTS:
            return
        tiles, texts = [], []
        for joint in joints:
            name = mujoco.name_of(self.model, "joint", joint)
            turns = kinds[joint] == hinge
            unit, travel = ("rad", TURN) if turns else ("m", self._travel(joint))
            paint = self._highlighted(self._below(int(self.model.jnt_bodyid[joint])))
            for value in (-travel, travel):
                data = mujoco.at_key(self.model)
                data.qpos[int(self.model.jnt_qposadr[joint])] += value
                mj.mj_kinematics(self.model, data)
                tiles.append(self.tile(data, groups=BODY, paint=paint))
                texts.append(caption(name, f" {value:+.2g} {unit}"))
        alt = "each joint turned to both sides of home; the part that moves is orange"
        yield Picture("directions.png", "Joint directions", alt, sheet(tiles, texts))

    def _travel(self, joint: int) -> float:
        """How far a slide is moved, m."""
        lower, upper = (float(v) for v in self.model.jnt_range[joint])
        return TURN * (upper - lower) if self.model.jnt_limited[joint] else 0.1

    def _below(self, body: int) -> frozenset[int]:
        """A body and all that hangs on it."""
        found = {body}
        for child in range(body + 1, self.model.nbody):
            if int(self.model.body_parentid[child]) in found:
                found.add(child)
        return frozenset(found)

    def _by_piece(self, alpha: float) -> offscreen.Paint:
        """A colour of its own for each collision piece; visual geometry keeps its own."""
        return self._painted(lambda geom: (*hue(geom), alpha) if geom in self._pieces else None)

    def _faded(self, alpha: float, *, spare: bool = True) -> offscreen.Paint:
        hidden = self._spare if spare else frozenset()
        return self._painted(lambda geom: (*GREY[:3], 0.0 if geom in hidden else alpha))

    def _highlighted(self, bodies: frozenset[int]) -> offscreen.Paint:
        def colour(geom: int) -> Rgba:
            moves = int(self.model.geom_bodyid[geom]) in bodies
            return CLEAR if geom in self._spare else MOVED if moves else GREY

        return self._painted(colour)

    def _painted(self, colour: Callable[[int], Rgba | None]) -> offscreen.Paint:
        """The robot's geometry, each in the colour for its number; None = as it is."""
        import mujoco as mj

        of_geom, of_joint = mj.mjtObj.mjOBJ_GEOM.value, mj.mjtObj.mjOBJ_JOINT.value
        free = mj.mjtJoint.mjJNT_FREE.value

        def paint(drawn: Any) -> None:  # Any: mjvGeom
            if drawn.objtype == of_geom and self.model.geom_bodyid[drawn.objid] != 0:
                rgba = colour(drawn.objid)
                if rgba is not None:
                    plain(drawn, rgba)
            elif drawn.objtype == of_joint and self.model.jnt_type[drawn.objid] == free:
                drawn.rgba[3] = 0.0  # a box in the middle of the robot says nothing

        return paint


def plain(geom: Any, rgba: Rgba) -> None:  # Any: mjvGeom
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


def sheet(tiles: Sequence[Pixels], texts: Sequence[str]) -> Pixels:
    """Tiles in rows of four, each with its text above."""
    from PIL import Image, ImageDraw, ImageFont

    columns, (height, width) = 4, tiles[0].shape[:2]
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
