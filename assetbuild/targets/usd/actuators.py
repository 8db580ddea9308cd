"""Drives whose effort is computed outside of the solver, as Newton's `NewtonActuator` prims.

PhysX and Isaac Lab take these efforts from a controller of their own. Newton builds one from each
of these prims, and a program that steps `model.actuators` needs no other. Units are SI and radians,
unlike those of UsdPhysics' drives. Source: newton-usd-schemas 0.6.
"""

from __future__ import annotations

import math

from pxr import Usd, UsdGeom

from assetbuild.robot.model import Actuator, Control
from assetbuild.simulators.usd_names import ACTUATORS
from assetbuild.targets.usd.layers import apply_foreign, label
from assetbuild.targets.usd.names import PrimPaths

EXPLICIT = ("ideal_pd", "dc_motor", "motor")


def define_actuators(stage: Usd.Stage, names: PrimPaths, control: Control) -> None:
    """A `NewtonActuator` for each joint that an explicit model drives."""
    explicit = [row for row in control.actuators if row.model in EXPLICIT]
    if explicit:
        UsdGeom.Scope.Define(stage, f"/{names.root}/{ACTUATORS}")
    for row in explicit:
        joint = names.joint(row.joint)
        name = joint.rsplit("/", 1)[-1]
        prim = stage.DefinePrim(f"/{names.root}/{ACTUATORS}/{name}", "NewtonActuator")
        label(prim, row.joint)
        prim.CreateRelationship("newton:targets", custom=False).SetTargets([joint])
        _apply_law(prim, row)


def _apply_law(prim: Usd.Prim, row: Actuator) -> None:
    """The PD law (a `motor` adds the command alone), and what limits its effort."""
    apply_foreign(prim, "NewtonPDControlAPI", "newton", {"kp": row.kp, "kd": row.kd})
    effort = _or_infinite(row.effort)
    if row.model == "dc_motor":
        curve = {
            "maxMotorEffort": effort,
            "saturationEffort": _or_infinite(row.saturation),
            "velocityLimit": _or_infinite(row.velocity),
        }
        apply_foreign(prim, "NewtonDCMotorClampingAPI", "newton", curve)
    else:
        apply_foreign(prim, "NewtonMaxEffortClampingAPI", "newton", {"maxEffort": effort})


def _or_infinite(value: float | None) -> float:
    return math.inf if value is None else value
