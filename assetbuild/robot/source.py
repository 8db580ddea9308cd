"""What a source says beyond links and shapes: drives, poses, sensors, surfaces."""

from __future__ import annotations

from dataclasses import dataclass, field

from assetbuild.robot.model import Contact, Control


@dataclass(frozen=True)
class SourceControl:
    """`source_control.json`, which `steps.control` joins with the recipe.

    control: in the names of the source's links and shapes, before merging and assembling;
        each moving joint has an actuator, passive where the source drives it otherwise.
    bodies: links that are bodies of the source with mass; the others only name places.
    ctrl: (keyframe, command by actuator) where the source states any.
    surfaces: of a composite, by the prefix of each part, the surface that most of its shapes
        have; `control.contact` is the base's.
    """

    control: Control = field(default_factory=Control)
    bodies: tuple[str, ...] = ()
    ctrl: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    surfaces: tuple[tuple[str, Contact], ...] = ()
