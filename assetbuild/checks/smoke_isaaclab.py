"""Does Isaac Lab hold the robot that the recipe means, on Newton and on PhysX?

Isaac Lab 3 comes from PyPI and runs both engines without Isaac Sim, on a CPU as well. Whoever has
an installation, of 2.x in Isaac Sim too, names it by an environment variable.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

from assetbuild.engine.step import Files
from assetbuild.facts.compare import Difference, differences, equality_findings
from assetbuild.facts.held import NEWTON
from assetbuild.facts.readings import readings_table
from assetbuild.facts.reference import Reference, robot_table
from assetbuild.facts.table import Key, Table
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.robot.files import RobotFiles
from assetbuild.robot.mjcf_only import as_drives
from assetbuild.robot.model import Control, Tree
from assetbuild.simulators import consumers
from assetbuild.simulators.readings import FALL, HEIGHT, fall_m

BEYOND_IMPORTS = ("assetbuild.simulators.isaaclab_child",)
ENGINES = {"newton": "Newton", "physx": "PhysX"}
FALLS = Rule(
    "smoke.fall",
    "error",
    "a robot that nothing holds falls by more or less than gravity says",
    "look at the gravity of the scene, and at what the robot touches",
)
ALWAYS = {
    "body": ("mass", "centre of mass", "inertia"),
    "joint": ("lower", "upper", "armature", "friction", "damping"),
    "simulation": ("timestep", "gravity"),
}
OF_DRIVES = ("kp", "kd", "effort")
"""Quantities that each body, joint and drive must be read back with; others may be read."""
FALL_SLACK = 0.05
"""Relative, as in `alignment`: the engines do not start their first step alike."""


class SmokeIsaacLab(consumers.ConsumerCheck):
    """Runs `python/<robot>_isaaclab_measure.py` on each engine and compares what it reads back."""

    needs: ClassVar[tuple[str, ...]] = ("isaaclab", "usd")
    reads: ClassVar[tuple[str, ...]] = ("tree.json", "control.json")
    sections: ClassVar[Mapping[str, str]] = {"validate.smoke_bounds": "bounds"}
    home: ClassVar[consumers.Environment] = consumers.Environment(
        "isaaclab",
        ("isaaclab[ovphysx]==3.0.0",),
        (3, 12),
        size="about 10 GB on disk",
        variable="ASSETBUILD_ISAACLAB",
    )

    bounds: consumers.SmokeBounds = consumers.SmokeBounds()

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures: by engine, what was compared and what became of the robot."""
        robot = RobotFiles(files.inputs)
        (script,) = (files.inputs / "isaaclab").glob("*_isaaclab_measure.py")
        figures: dict[str, object] = {}
        summaries = []
        for engine, name in ENGINES.items():
            # Not resolved: the inputs are links into the store, and the script looks beside itself.
            job: dict[str, object] = {"script": str(script.absolute()), "engine": engine}
            answer, failure = self.answer("isaaclab_child.py", job)
            if answer is None:
                yield consumers.FAILED(
                    "robot", f"Isaac Lab on {name} does not take the bundle: {failure}"
                )
                figures[engine] = {"failure": failure}
                summaries.append(f"{name}: refused")
            elif "absent" in answer:
                summaries.append(f"{name}: not tried ({answer['absent']})")
            else:
                findings = list(evaluate(answer, robot.tree, robot.control, self.bounds, engine))
                yield from findings
                figures[engine], words = summed_up(answer, findings)
                summaries.append(f"{name}: {words}")
        write_figures(files, figures | {"summary": f"read back: {', '.join(summaries)}"})


def summed_up(
    answer: Mapping[str, Any],  # Any: JSON of the script
    findings: Sequence[Finding],
) -> tuple[dict[str, object], str]:
    """How many readings differ and what the robot did: figures, and words."""
    table, simulator = readings_table(answer)
    different = sum(f.rule.startswith("equal.") for f in findings)
    moved = sorted({f.rule for f in findings if not f.rule.startswith("equal.")})
    shown: dict[str, object] = {
        "simulator": simulator,
        "compared": len(table.facts),
        "differences": different,
        "moved": moved,
    }
    height = table.facts.get(Key("robot", "", HEIGHT))
    if isinstance(height, float) and math.isfinite(height):
        shown |= {"start_m": round(answer["start_m"], 3), "height_m": round(height, 3)}
    did = "".join(f" and `{rule}`" for rule in moved)
    return shown, f"{different} difference{'s' if different != 1 else ''}{did}"


def evaluate(
    answer: Mapping[str, Any],  # Any: JSON of the script
    tree: Tree,
    control: Control,
    bounds: consumers.SmokeBounds,
    engine: str,
) -> Iterator[Finding]:
    """What is wrong with an answer; separate, to be tried on bad ones."""
    held, name = readings_table(answer)[0], f"Isaac Lab on {ENGINES[engine]}"
    table = _as_held(robot_table(Reference(tree, tree, control=control)), control)
    # Of a body without mass the engine makes one up, which `usd.mass_missing` reports.
    light = {b.name for b in tree.bodies if not table.facts[Key("body", b.name, "mass")]}
    robot_names = {
        "body": {b.name for b in tree.bodies},
        "joint": {j.name for j in tree.moving_joints},
    }
    mismatches = []
    for kind, names in robot_names.items():
        read = set(held.names(kind))
        for what, some in (("missing", names - read), ("extra", read - names)):
            mismatches += [Difference(Key(kind, n, ""), None, None, what) for n in sorted(some)]
    driven = {a.joint for a in control.actuators if a.model != "passive"}

    def is_read(key: Key) -> bool:
        if key.name in light or (key.kind in robot_names and key.name not in held.names(key.kind)):
            return False
        of_drive = key.name in driven and key.quantity in OF_DRIVES
        return key in held.facts or of_drive or key.quantity in ALWAYS.get(key.kind, ())

    expected = table.only(is_read)
    mismatches += differences(expected, held.only(lambda key: key in expected.facts), NEWTON)
    yield from equality_findings(mismatches, f"isaaclab_{engine}", name, {})
    yield from _motion(held, float(answer["start_m"]), tree, control, bounds.low, name)


def _as_held(table: Table, control: Control) -> Table:
    """Return the table in Isaac Lab's terms.

    A spring is the stiffness of its joint's group; no effort limits a joint without a drive.
    """
    springs, facts = as_drives(control), Table()
    for name in table.names("joint"):
        if table.facts.get(Key("joint", name, "model"), "passive") == "passive":
            spring = springs.get(name)
            facts.put("joint", name, {"kp": spring.stiffness if spring else 0.0})
    loose = set(facts.names("joint"))
    return table.only(lambda key: key.quantity != "effort" or key.name not in loose) | facts


def _motion(
    held: Table, start: float, tree: Tree, control: Control, low: float, name: str
) -> Iterator[Finding]:
    fall, height = (held.facts.get(Key("robot", "", word)) for word in (FALL, HEIGHT))
    if tree.base != "floating" or not isinstance(fall, float) or not isinstance(height, float):
        return
    if not math.isfinite(fall) or not math.isfinite(height):
        message = (
            f"{name}: the root's position is not finite (fall {fall:g} m, height {height:g} m)"
        )
        hint = "a smaller timestep, or armature on the joints of light bodies"
        yield consumers.NOT_FINITE("robot", message, hint)
        return
    simulation = control.simulation
    wanted = fall_m(math.dist(simulation.gravity, (0.0, 0.0, 0.0)), simulation.timestep)
    if abs(fall - wanted) > FALL_SLACK * wanted:
        yield FALLS("robot", f"{name}: it falls {fall:.4g} m, {wanted:.4g} m are due to gravity")
    if height < low * start:
        message = f"{name}: the root sinks from {start:.3f} to {height:.3f} m"
        yield consumers.SINKS("robot", message, "see the checks of this engine")
