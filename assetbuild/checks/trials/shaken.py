"""Does the robot bear what an untrained policy asks of it?"""

from __future__ import annotations

from collections.abc import Iterator

from assetbuild.findings import Finding, Rule
from assetbuild.robot.action import Action
from assetbuild.simulators import mujoco
from assetbuild.simulators.mujoco.policy import shake
from assetbuild.simulators.mujoco.trials import FINER

SHAKEN = Rule(
    "trials.shaken",
    "error",
    "the random targets of an untrained policy drive the simulation to infinity",
    "a smaller timestep, armature, smaller kp",
)


def shaken(model: mujoco.Model, action: Action, figures: dict[str, object]) -> Iterator[Finding]:
    """Shake it; where that fails, again in finer steps."""
    found = shake(model, action)
    if found is None:
        return
    figures["shake"] = {
        "seconds": found.seconds,
        "joint": found.joint,
        "fastest_joint": found.fastest if found.seconds is None else None,
    }
    if found.seconds is None:
        return
    calmer = shake(model, action, finer=FINER)
    hasty = calmer is not None and calmer.seconds is None
    yield SHAKEN(
        f"joint {found.joint}",
        "an untrained policy's random targets drive the simulation to infinity after "
        f"{found.seconds:.2g} s, this joint foremost"
        + (f"; at 1/{FINER} of the timestep they do not" if hasty else ""),
        hint="a smaller `simulation.timestep`, or the rotors' real armature"
        if hasty
        else "smaller kp, the rotors' real armature, or an `effort` that is no placeholder",
        data={"seconds": found.seconds, "timestep": hasty},
    )
