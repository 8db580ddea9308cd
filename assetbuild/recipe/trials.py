"""What a robot is tried with beside the stand: `validate.trials`, `validate.mass` in a recipe."""

from __future__ import annotations

from pydantic import Field

from assetbuild.quantities import Model, Positive


class TotalMass(Model):
    """Masses against what is known of the robot and of matter."""

    total_kg: Positive | None = Field(
        None, description="kg, of the whole robot from its datasheet; null = not known"
    )
    tolerance: Positive = Field(
        0.03, description="relative, of the total mass; a warning, five times more is an error"
    )
    density: tuple[Positive, Positive] = Field(
        (30.0, 5000.0),
        description="kg/m3: least and most of a body's mass over the volume of its hull, warning",
    )


class InertiaBounds(Model):
    """Where the rules `inertia.*` draw the line."""

    triangle_slack: Positive = Field(
        0.01, description="share of C by which A + B >= C may fail before it is an error"
    )
    radius: Positive = Field(
        0.5, description="m: radius of the ball with this mass and moment, warning above"
    )
    density: Positive = Field(
        25_000.0, description="kg/m3: a body of less inertia than this matter has is told"
    )
    small_mass: Positive = Field(1e-3, description="kg: a moving body below it is told")


class DriveBounds(Model):
    """Where the rules `gains.*` draw the line."""

    torque: Positive = Field(
        0.8, description="share of the effort limit that holding the pose may need, warning"
    )
    sag: Positive = Field(0.25, description="rad or m off the target by its own weight, warning")
    margin: Positive = Field(
        2.0, description="times stiffer before the drive diverges at this timestep, warning below"
    )
    damping_ratio: tuple[Positive, Positive] = Field(
        (0.1, 10.0), description="least and most, warning"
    )


class Alignment(Model):
    """Where MuJoCo and PhysX may part on a floor: a warning, and an error."""

    stand_height: tuple[Positive, Positive] = Field(
        (0.005, 0.01), description="m, between the roots after standing"
    )
    landing: tuple[Positive, Positive] = Field(
        (0.03, 0.1), description="share of the time that a fall from 1 m takes, of either engine"
    )


class SmokeBounds(Model):
    """What a robot may do under zero actions in a trainer."""

    low: Positive = Field(0.7, lt=1, description="share of the starting height, warning below")
    fallen: Positive = Field(0.25, lt=1, description="share of environments that fall, warning")


class Mirror(Model):
    """What left and right parts may differ by; more is information, a slip a warning."""

    place: Positive = Field(
        0.005, description="m: parts whose places mirror each other so closely are compared"
    )
    mass: Positive = Field(0.02, description="relative difference of mass")
    center: Positive = Field(0.005, description="m, of the centre of mass")
    inertia: Positive = Field(0.1, description="relative difference of inertia")
    axis: Positive = Field(0.02, description="rad, between an axis and its mirror image")
    limits: Positive = Field(0.005, description="rad or m, of either end of a range")
    home: Positive = Field(0.001, description="rad or m, at the first keyframe")
    gains: Positive = Field(
        0.01, description="relative, of kp, kd, damping, friction, armature, effort, velocity"
    )


class Trials(Model):
    """Small experiments in MuJoCo, and the limits beyond which they warn."""

    drift: Positive = Field(
        0.01, description="m: how far a settled base may wander in 1000 steps, warning"
    )
    drop: Positive = Field(0.05, description="m: height that the robot is dropped from")
    speed: Positive = Field(
        0.05, description="rad/s or m/s: fastest joint after two seconds on the floor, warning"
    )
    penetration: Positive = Field(
        0.005, description="m: deepest contact after two seconds on the floor, warning"
    )
    support: float = Field(
        0.0,
        allow_inf_nan=False,
        description="m: least distance of the centre of mass inside the feet, warning",
    )
    energy: Positive = Field(
        0.05, description="relative change of energy in 1 s of free motion, warning"
    )
    timestep: Positive = Field(
        0.02, description="rad or m: difference to a quarter of the timestep, warning"
    )
    dead: Positive = Field(
        0.01, description="rad or m: a joint that moves less when its drive is told to, error"
    )
    poses: int = Field(200, ge=1, le=100_000, description="random poses for self-collision")
    always: Positive = Field(
        0.9, description="share of random poses in which a pair touches that should be excluded"
    )
