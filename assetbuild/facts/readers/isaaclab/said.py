"""Isaac Lab's words in both generations; see docs/reference/isaaclab.md."""

from __future__ import annotations

from typing import Literal

from assetbuild.facts.table import Key, Writer

FORM = "isaaclab"
Generation = Literal[2, 3]
GENERATIONS: tuple[Generation, ...] = (2, 3)

READ = ("USD", "DT", "DECIMATION", "GRAVITY", "SIMULATION_CFG", "NEWTON_CFG", "EventCfg")
"""Names of a module whose values are facts; the configuration of the robot is one more."""
IMPLICIT = "ImplicitActuatorCfg"
LIMITS: dict[tuple[int, bool], tuple[str, tuple[str, ...]]] = {
    (2, True): ("effort_limit_sim", ("velocity_limit_sim",)),
    (2, False): ("effort_limit", ("velocity_limit", "velocity_limit_sim")),
    (3, True): ("joint_effort_limit", ("joint_velocity_limit",)),
    (3, False): ("actuator_effort_limit", ("actuator_velocity_limit", "joint_velocity_limit")),
}
"""(generation, whether the simulator integrates the drive) -> (effort, velocities): the first
velocity is the drive's own, the second the simulator's."""
SPAWN = {
    2: {
        "rigid": "sim_utils.RigidBodyPropertiesCfg",
        "articulation": "sim_utils.ArticulationRootPropertiesCfg",
    },
    3: {"rigid": "PhysxRigidBodyCfg", "articulation": "PhysxArticulationCfg"},
}
SELF_COLLISIONS = "enabled_self_collisions"
PROPERTIES = {
    SELF_COLLISIONS: "self_collisions",
    "solver_position_iteration_count": "solver_position_iterations",
    "solver_velocity_iteration_count": "solver_velocity_iterations",
    "sleep_threshold": "sleep_threshold",
    "stabilization_threshold": "stabilization_threshold",
}
"""Isaac Lab's articulation properties -> keys of the recipe's `usd.articulation`."""
BODY_PROPERTIES = (
    "linear_damping", "angular_damping", "max_linear_velocity", "max_angular_velocity",
    "max_depenetration_velocity",
)  # fmt: skip
"""The same in the recipe's `usd.rigid_body`; `max_angular_velocity` is in deg/s here."""
KNOWN = {
    "usd_path", "variants", "Physics", "activate_contact_sensors", "rigid_props",
    "articulation_props", "self_collision_enabled", *PROPERTIES, *BODY_PROPERTIES,
}  # fmt: skip
"""Fields of the spawner that have an expectation."""


def model_of(kind: str, kp: object, kd: object) -> str:
    """The model of the table: a drive without gains makes the effort that it is told, or none."""
    if kind == "DCMotorCfg":
        return "dc_motor"
    if kind in ("IdealPDActuatorCfg", "DelayedPDActuatorCfg"):
        return "ideal_pd" if kp or kd else "motor"
    if kind == IMPLICIT:
        return "pd" if kp else "velocity" if kd else "passive"
    return kind


def said_by(generation: Generation, own: Writer, book: Writer) -> None:
    """Facts of one module; the later generation's are words, because they stand there again."""
    for key, value in own.facts.items():
        name = key.quantity
        if generation != GENERATIONS[0]:
            name = f"{FORM} {generation}:{name.rpartition(':')[2]}"
        book.facts[Key(key.kind, key.name, name)] = value
    book.unread += own.unread
    book.places |= {at: where for at, where in own.places.items() if at[0] == "code"}
