"""What small experiments in MuJoCo may say of a robot."""

from __future__ import annotations

from assetbuild.findings import Rule

LOAD = Rule("trials.load", "error", "the scene does not load", "see `mjcf.load`")
LARGE = Rule(
    "trials.large",
    "info",
    "there are more than 300 degrees of freedom, so `validate` simulates nothing",
    "remove the cloth or the other robots",
)
MEMORY = Rule(
    "trials.memory",
    "error",
    "MuJoCo's own memory does not hold the contacts of the robot: it goes on without any "
    "constraint, or stops",
    "`collision.exclude.pairs` of what always touches (`trials.overlap`), fewer collision shapes, "
    "or more memory (`<size memory>` in the source's MJCF)",
)
DEAD = Rule(
    "trials.dead",
    ("error", "warning"),
    "a joint hardly moves when its drive is commanded (a warning where an MJCF's own drive does "
    "that in the source, too)",
    "is kp in other units, the effort limit too small, or kd far too large?",
)
ENERGY = Rule(
    "trials.energy",
    "warning",
    "free motion does not conserve energy at this timestep",
    "a smaller timestep; look for tiny inertias far from the others",
)
TIMESTEP = Rule(
    "trials.timestep",
    "warning",
    "the drives move differently at a quarter of the timestep",
    "a smaller `simulation.timestep`, a smaller kp, or the real armature",
)
BALANCE = Rule(
    "trials.balance",
    "warning",
    "at home the centre of mass is not above the feet",
    "move the feet of the keyframe under the centre of mass",
)
UNSTABLE = Rule(
    "trials.unstable",
    "error",
    "after a drop the simulation went to infinity",
    "a smaller timestep; look for tiny inertias and overlapping shapes",
)
RESTLESS = Rule(
    "trials.rest",
    ("warning", "info"),
    "two seconds after a drop the joints still move",
    "more kd, a smaller timestep, or the rotors' armature",
)
SUNK = Rule(
    "trials.sunk",
    ("warning", "info"),
    "two seconds after a drop a contact is too deep",
    "adjust the contact softness or the timestep",
)
DRIFT = Rule(
    "trials.drift",
    ("warning", "info"),
    "the settled base drifts",
    "a pose that stands by itself, more kd or kp, or a smaller timestep",
)
FALL = Rule(
    "trials.fall",
    "warning",
    "left alone under its drives for two seconds the robot falls, or a drive of a fixed robot does "
    "not hold its joint",
    "raise kp, move the feet under the centre of mass; `validate: {stand: {}}` makes it an error",
)
OVERLAP = Rule(
    "trials.overlap",
    "warning",
    "two bodies touch in almost all random poses, or are inside each other where the robot starts "
    "(by more than 5 mm: not ready)",
    "exclude the pair, or use smaller shapes; in the second case another pose helps, too",
    was={"stand.overlap": ("trials.overlap",)},
)
FLOOR = Rule(
    "trials.floor",
    "warning",
    "a moving body starts inside the floor of the scene (by more than 5 mm: not ready)",
    "turn or raise the keyframe `home`",
)
NOTHING_TOUCHES = Rule(
    "trials.nothing_touches",
    "warning",
    "the robot floats and none of its shapes can touch a floor, so it is not ready",
    "give it collision shapes; where it never lands, state that in `rules: "
    '{trials.nothing_touches: {severity: info, because: "..."}}`',
    blocks=True,
)
SHAKEN = Rule(
    "trials.random_targets_diverge",
    "error",
    "the random targets of an untrained policy drive the simulation to infinity",
    "a smaller `simulation.timestep`, the rotors' real armature, smaller kp, or an `effort` that "
    "is no placeholder",
)
