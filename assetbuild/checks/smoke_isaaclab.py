"""Does an installed Isaac Lab spawn the module's articulation and hold its initial pose?

Only where the user has Isaac Lab; pip cannot make its environment without Isaac Sim.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.kinds import write_figures
from assetbuild.simulators.consumers import FAILED, NOT_FINITE, SINKS, ConsumerCheck, SmokeBounds
from assetbuild.simulators.environments import Environment

if TYPE_CHECKING:
    from assetbuild.engine.world import World

BEYOND_IMPORTS = ("assetbuild.simulators._isaaclab_child",)
VARIABLE = "ASSETBUILD_ISAACLAB"


class Installed(Environment):
    """The user's own installation, by an environment variable."""

    def python(self, world: World) -> Path | None:
        """None where the variable is unset or names nothing."""
        named = world.variable(VARIABLE)
        return Path(named) if named and world.is_file(Path(named)) else None


class SmokeIsaacLab(ConsumerCheck):
    """Spawns `python/<robot>_isaaclab_<2|3>.py`, steps it, looks at heights and numbers."""

    needs: ClassVar[tuple[str, ...]] = ("isaaclab", "usd")
    reads: ClassVar[tuple[str, ...]] = ()
    sections: ClassVar[Mapping[str, str]] = {"validate.smoke_bounds": "bounds"}
    consumer: ClassVar[str] = "isaaclab"
    home: ClassVar[Environment] = Installed("isaaclab", ())

    told: ClassVar[Mapping[str, str]] = {"base": "base"}

    steps: int = 400
    base: str = "fixed"
    bounds: SmokeBounds = SmokeBounds()

    @classmethod
    def absent(cls) -> str:
        """How to name the installation."""
        return f"install Isaac Lab and set {VARIABLE} to its Python interpreter"

    def run(self, files: Files) -> Iterator[Finding]:
        """The modules look for the USD beside their folder, as in the bundle."""
        (module,) = (files.inputs / "isaaclab").glob("*_isaaclab_2.py")
        job: dict[str, object] = {
            "modules": str(module.parent.absolute()),
            "stem": module.stem.removesuffix("_2"),
            "steps": self.steps,
        }
        answer, failure = self.answer("_isaaclab_child.py", job)
        if answer is None:
            write_figures(files, {"failure": failure})
            yield _finding(FAILED, f"does not take the bundle: {failure}")
            return
        shown = {name: answer[name] for name in ("generation", "finite")}
        start, end = (round(float(str(answer[name])), 3) for name in ("start_m", "height_m"))
        summary = f"the root went from {start} m to {end} m in {self.steps} steps"
        write_figures(files, shown | {"height_m": end, "summary": summary})
        yield from judged(answer, self.base, self.bounds)


def judged(
    answer: Mapping[str, Any],  # Any: the child's JSON
    base: str,
    bounds: SmokeBounds,
) -> Iterator[Finding]:
    """What is wrong with an answer."""
    if not answer["finite"]:
        yield _finding(NOT_FINITE, "positions are not finite")
    elif base == "floating" and answer["height_m"] < bounds.low * answer["start_m"]:
        message = f"the root sinks from {answer['start_m']:.3f} to {answer['height_m']:.3f} m"
        yield _finding(SINKS, message)


def _finding(rule: Rule, message: str) -> Finding:
    return rule("robot", f"Isaac Lab: {message}", "see the checks of PhysX")
