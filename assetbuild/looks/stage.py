"""The robot before the camera: the picture that stands for it, and those that explain it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from assetbuild.looks.framing import directions, ellipsoid_points, fitted, robot_points, spans
from assetbuild.robot.pose import Array
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco import Data, Model
from assetbuild.simulators.studio import LAMP, Camera, Paint, Pixels, Shot, Studio, lamp_direction

LONG, SHORT = 1600, 1200
"""Pixels of the sides of a large picture."""
TALL = 1.25
"""Height / width of the robot in the picture from which on the frame is upright."""
FRONT, BEHIND, ELEVATION = 140.0, -40.0, -14.0
"""Where the camera looks, degrees, as MuJoCo counts them."""
SIDES = (140.0, -140.0, 40.0, -40.0)
"""Azimuths among which a picture of one limb chooses the one that is nearest to it."""
HERO_SAMPLES = 3
"""Frames behind the first picture: each with the lamp a little elsewhere."""
TURN = 0.3
"""rad (or share of the range of a sliding joint) by which a joint is turned to show its sign."""
NEAR = 0.22
"""Half of the least size of what a picture of one limb shows, as a share of the robot's size."""
MOST_JOINTS = 80
"""More joints than this are not shown one by one."""
COLLISION = 3
"""The group of collision geometry."""
BODY = (2, COLLISION)
"""What stands for the robot: visual geometry, and collision geometry of bodies without any."""
HULLS = ("mjVIS_CONVEXHULL",)
"""A collision mesh that is not convex is shown as what MuJoCo collides: its hull."""
UNDRAWN = 1001
"""`mjGEOM_NONE`: a geom of this type is skipped by the renderer."""
ELLIPSOIDS = 0.8
"""How far from the robot's middle its inertia ellipsoids are shown, as a share of its size."""
Rgba = tuple[float, float, float, float]
CLEAR: Rgba = (0.0, 0.0, 0.0, 0.0)
GREY: Rgba = (0.66, 0.68, 0.71, 1.0)
MOVED: Rgba = (0.95, 0.45, 0.05, 1.0)


@dataclass(frozen=True, eq=False)
class Extent:
    """What is to be seen of a robot.

    points: (n, 3) m, of all geometry; looks: of what it looks like; size: m, diagonal of its box.
    bare: it has no geometry, and the points are those of its inertia ellipsoids.
    """

    points: Array
    looks: Array
    middle: Array
    size: float
    lowest: float
    bare: bool = False


def extent(model: Model, data: Data) -> Extent:
    """The robot at its first pose, all of its geometry."""
    groups = np.asarray(model.geom_group)
    shown = (np.asarray(model.geom_bodyid) != 0) & (groups < 4)
    points = robot_points(model, data, np.flatnonzero(shown).tolist())
    looks = robot_points(model, data, np.flatnonzero(shown & (groups == 2)).tolist())
    bare = not len(points)
    if bare:
        points = ellipsoid_points(model, data)
        if not len(points):
            points = np.array(data.subtree_com[0]) + np.array([[-0.5] * 3, [0.5] * 3])
    lower, upper = points.min(axis=0), points.max(axis=0)
    size = max(float(np.linalg.norm(upper - lower)), 1e-3)
    return Extent(
        points,
        looks if len(looks) else points,
        (lower + upper) / 2.0,
        size,
        float(lower[2]),
        bare,
    )


class Stage:
    """One robot with one camera for all its large pictures."""

    def __init__(self, studio: Studio, model: Model, data: Data, seen: Extent) -> None:
        self.studio, self.model, self.data, self.extent = studio, model, data, seen
        groups, bodies = np.asarray(model.geom_group), np.asarray(model.geom_bodyid)
        visual, pieces = bodies[groups == 2], groups == 3
        self._pieces = frozenset(np.flatnonzero(pieces).tolist())
        self._spare = frozenset(np.flatnonzero(pieces & np.isin(bodies, visual)).tolist())
        """Collision geometry of bodies that have visual geometry to be seen by."""
        self.looks = (0, 2) if len(visual) else (0, 3)
        """Groups of geoms that are drawn: without visual geometry, the collision geometry."""
        wide, high = spans(seen.points, FRONT, ELEVATION)
        self.size = (SHORT, LONG) if high > TALL * wide else (LONG, SHORT)
        _decorate(model, seen.size)

    def _whole(self, azimuth: float, points: Array, **more: float) -> Camera:
        return fitted(points, azimuth, ELEVATION, self.size[0] / self.size[1], **more)

    def _large(self, camera: Camera, **more: Any) -> Pixels:  # Any: the fields of Shot
        return self.studio.frame(self.data, Shot(camera, *self.size, **more))

    def hero(self) -> Pixels:
        """The picture that stands for the robot; the frame holds its shadow as well."""
        if self.extent.bare:
            return self._large(self._whole(FRONT, self.extent.looks), flags=("mjVIS_INERTIA",))
        lit = np.concatenate([self.extent.looks, self._shadow()])
        camera = self._whole(FRONT, lit)
        return self._large(camera, groups=self.looks, samples=HERO_SAMPLES, soft=True)

    def _shadow(self) -> Array:
        """(n, 3) m, how far the robot's shadow reaches on the floor; its edge is soft."""
        points = self.extent.looks
        forward, right, _ = directions(FRONT, ELEVATION)
        lamp = lamp_direction(forward, right)
        falls = (1.0 + 3.0 * LAMP) * (points[:, 2:] - self.extent.lowest) / -lamp[2]
        return np.asarray(points + falls * lamp, dtype=np.float64)

    def others(self) -> Iterator[tuple[str, Pixels]]:
        """(file, picture) of what one does not see of a robot that stands before one."""
        yield "joints.png", self._axes()
        if self.extent.bare:
            return
        behind = self._whole(BEHIND, self.extent.looks)
        yield "behind.png", self._large(behind, groups=self.looks[1:])
        inside, faded = self._whole(FRONT, self._with_ellipsoids()), self._faded(0.16)
        flags = ("mjVIS_INERTIA", "mjVIS_COM")
        yield "inertia.png", self._large(inside, groups=BODY, flags=flags, paint=faded)
        camera = self._whole(FRONT, self.extent.points)
        if self._pieces:
            paint = self._painted(lambda geom: (*hue(geom), 1.0) if geom in self._pieces else None)
            yield "collision.png", self._large(camera, groups=(3,), flags=HULLS, paint=paint)
        if self.data.ncon:
            ghost, flag = self._faded(0.16, spare=False), "mjVIS_CONTACTPOINT"
            yield "contacts.png", self._large(camera, groups=(3,), flags=(flag,), paint=ghost)
        joints = self._joints()
        for joint in joints if len(joints) <= MOST_JOINTS else ():
            yield self._direction(joint)

    def _with_ellipsoids(self) -> Array:
        """(n, 3) m: the robot and its inertia ellipsoids, as far as they reach from it.

        A tensor that is too large by far would leave the robot a dot: what reaches out further
        than the robot's size is cut.
        """
        points = np.concatenate([self.extent.points, ellipsoid_points(self.model, self.data)])
        reach, middle = ELLIPSOIDS * self.extent.size, self.extent.middle
        return np.asarray(np.clip(points, middle - reach, middle + reach), dtype=np.float64)

    def _axes(self) -> Pixels:
        """Arrows along the joints' axes."""
        camera = self._whole(FRONT, self.extent.points, margin=1.3)
        flags = ("mjVIS_JOINT", "mjVIS_INERTIA") if self.extent.bare else ("mjVIS_JOINT",)
        return self._large(camera, groups=BODY, flags=flags, paint=self._faded(0.16))

    def _direction(self, joint: int) -> tuple[str, Pixels]:
        """One joint turned from home (grey), seen from the side of its limb."""
        import mujoco as mj

        name = mujoco.name_of(self.model, "joint", joint)
        turns = int(self.model.jnt_type[joint]) == mj.mjtJoint.mjJNT_HINGE.value
        unit, travel = ("rad", TURN) if turns else ("m", self._travel(joint))
        moved = mujoco.at_key(self.model)
        moved.qpos[int(self.model.jnt_qposadr[joint])] += travel
        mj.mj_kinematics(self.model, moved)
        below = self._below(int(self.model.jnt_bodyid[joint]))
        shot = Shot(
            self._limb(joint, below, moved),
            LONG // 2,
            SHORT // 2,
            BODY,
            paint=self._coloured(below, (*GREY[:3], 0.3), GREY),
            ghost=moved,
            ghost_paint=self._coloured(below, MOVED, CLEAR),
        )
        plain_name = re.sub(r"[^\w+-]+", "_", name)  # a name may hold slashes and dots
        file = f"{joint:02} {plain_name} {travel:+.2g} {unit}.png"
        return file, self.studio.frame(self.data, shot)

    def _limb(self, joint: int, below: frozenset[int], moved: Data) -> Camera:
        """A camera on the limb's side of the robot that shows where it was and where it goes."""
        bodies = np.asarray(self.model.geom_bodyid)
        geoms = [g for g in range(self.model.ngeom) if bodies[g] in below and g not in self._spare]
        at_joint = np.array(self.data.xanchor[joint])
        both = [robot_points(self.model, data, geoms) for data in (self.data, moved)]
        points = np.concatenate([*both, at_joint[None]])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
        half = NEAR * self.extent.size
        points = np.concatenate([points, middle + half * np.eye(3), middle - half * np.eye(3)])
        away = (middle - self.extent.middle)[:2]

        def nearness(azimuth: float) -> float:
            turn = np.radians(azimuth)
            return float(round(-away @ np.array([np.cos(turn), np.sin(turn)]), 3))

        azimuth = max(SIDES, key=nearness)  # the first of equals: the side of all other pictures
        return fitted(points, azimuth, ELEVATION, LONG / SHORT)

    def _joints(self) -> list[int]:
        """Joints that turn or slide."""
        import mujoco as mj

        moving = (mj.mjtJoint.mjJNT_HINGE.value, mj.mjtJoint.mjJNT_SLIDE.value)
        return [n for n, kind in enumerate(self.model.jnt_type) if int(kind) in moving]

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

    # --- colours ------------------------------------------------------------------------------

    def _faded(self, alpha: float, *, spare: bool = True) -> Paint:
        hidden = self._spare if spare else frozenset()
        return self._painted(lambda geom: (*GREY[:3], 0.0 if geom in hidden else alpha))

    def _coloured(self, bodies: frozenset[int], inside: Rgba, outside: Rgba) -> Paint:
        """Some bodies in one colour, the others in another."""

        def colour(geom: int) -> Rgba:
            if geom in self._spare:
                return CLEAR
            return inside if int(self.model.geom_bodyid[geom]) in bodies else outside

        return self._painted(colour)

    def _painted(self, colour: Callable[[int], Rgba | None]) -> Paint:
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
    """One colour without gloss, whatever its material says; what is clear is not drawn at all."""
    if rgba[3] == 0.0:
        geom.type = UNDRAWN
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


def hue(number: int) -> tuple[float, float, float]:
    """Colours that neighbours do not share: steps of the golden ratio around the circle."""
    import colorsys

    return colorsys.hsv_to_rgb(number * 0.618033988749895 % 1.0, 0.65, 0.95)
