"""A strip of pictures of a robot that moves: a row for each engine, a picture for each moment."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from assetbuild.policy.terms import Seen
from assetbuild.rendering.render import Stage, directions, fitted, on_stage, staged, write
from assetbuild.rendering.studio import BACKGROUND, Pixels, Shot, Studio
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco

ACROSS = 360
"""Pixels of the longer side of each picture."""
FINER = 2
"""How much larger it is drawn before it is made smaller."""
SIDE, ELEVATION = 90.0, -8.0
"""Where the camera looks, degrees: from the right, so that a robot walks to the right."""
ROOM = 1.35
"""How much larger the frame is than the robot at its start: it swings its limbs."""
SAMPLES = 3
CAPTION, INK = 13, (70, 70, 70)
"""Pixels of the letters, and their colour."""


def draw_strip(scene: Path, rows: Mapping[str, Sequence[Seen]], file: Path, renderer: str) -> None:
    """Write a PNG of moments, a row for each engine. The camera goes along. StepError.

    PhysX's row has no distances: pictures are shown around.
    """
    stage = staged(scene, renderer)
    start = np.array(stage.data.xpos[1])

    def draw(opened: Studio) -> None:
        drawn = [_row(stage, opened, start, *row) for row in rows.items()]
        write(file, np.concatenate(drawn))

    on_stage(stage, renderer, FINER * ACROSS, ROOM * stage.size, draw)


def _row(
    stage: Stage, studio: Studio, start: Array, engine: str, moments: Sequence[Seen]
) -> Pixels:
    """start: (3,) m, where the base is in the stage's own pose."""
    pictures = _pictures(stage, studio, start, moments)
    captions = [f"{moment.time:.1f} s" for moment in moments]
    if engine != "physx":
        walked = [math.dist(moment.place[:2], moments[0].place[:2]) for moment in moments]
        captions = [f"{text}  {way:.2f} m" for text, way in zip(captions, walked, strict=True)]
    captions[0] = f"{engine}  {captions[0]}"
    with_text = [_captioned(*pair) for pair in zip(pictures, captions, strict=True)]
    return np.concatenate(with_text, axis=1)


def _pictures(
    stage: Stage, studio: Studio, start: Array, moments: Sequence[Seen]
) -> Iterator[Pixels]:
    """Each of the same size, FINER times too large, the robot's base in the same place."""
    model, data = stage.model, stage.data
    joints = mujoco.joints(model)
    _, right, up = directions(SIDE, ELEVATION)
    extent = np.ptp(stage.points @ right), np.ptp(stage.points @ up)
    width, height = (round(FINER * ACROSS * side / max(extent)) for side in extent)
    size = max(width, ACROSS), max(height, ACROSS)
    camera = fitted(stage.points, SIDE, ELEVATION, size[0] / size[1], ROOM)
    for moment in moments:
        if mujoco.floats(model):
            data.qpos[:7] = [*moment.place, *moment.quat]
        for joint, value in moment.q.items():
            if joint in joints:
                data.qpos[model.jnt_qposadr[joints[joint]]] = value
        mujoco.mj.mj_forward(model, data)
        shift = np.array([*(moment.place[:2] - start[:2]), 0.0])
        studio.middle = stage.middle + shift
        yield studio.frame(
            data,
            Shot(camera.moved(shift), *size, groups=stage.groups, samples=SAMPLES, shadow=True),
        )


def _captioned(pixels: Pixels, text: str) -> Pixels:
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(pixels).reduce(FINER)
    page = Image.new("RGB", (image.width, image.height + 2 * CAPTION), (BACKGROUND,) * 3)
    page.paste(image)
    font = ImageFont.load_default(CAPTION)
    ImageDraw.Draw(page).text((CAPTION, image.height), text, fill=INK, font=font)
    return np.asarray(page)
