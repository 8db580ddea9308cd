"""Does mjlab take the bundle: build its environment, stand, train for a moment?

In mjlab's own environment (MuJoCo 3.11). Says that training runs, not that a policy learns.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from assetbuild.engine.step import Files
from assetbuild.findings import Finding, Rule
from assetbuild.plugin_types import write_figures
from assetbuild.simulators import consumers

FELL = Rule(
    "smoke.fell",
    "warning",
    "more than a quarter of the robots fall while they should stand",
    "see the checks `stand` and `gains`",
)
EFFORT = Rule(
    "smoke.effort", "error", "a drive exceeds its effort limit", "report it: this is a bug"
)
WEIGHTS = Rule("smoke.weights", "error", "training changes no weight", "check the rewards")
INERTIA = Rule(
    "smoke.inertia", "error", "no real body can have a randomized inertia", "narrow `randomize`"
)
BEYOND_IMPORTS = ("assetbuild.simulators.mjlab_child",)


class SmokeMjlab(consumers.ConsumerCheck):
    """Loads `python/<robot>_mjlab.py`, stands for a second, trains two iterations (GPU: 200)."""

    needs: ClassVar[tuple[str, ...]] = ("mjlab",)
    reads: ClassVar[tuple[str, ...]] = ()
    sections: ClassVar[Mapping[str, str]] = {"validate.smoke_bounds": "bounds"}
    derived: ClassVar = {
        "effort_factor": lambda recipe: max(
            (row.effort[1] for row in (recipe.value("randomize.joints") or {}).values()),
            default=1.0,
        )
    }
    home: ClassVar[consumers.Environment] = consumers.Environment(
        "mjlab", ("mjlab==1.6.0",), size="3.4 GB to download, 6.7 GB on disk"
    )

    envs: int = 8
    envs_gpu: int = 4096
    stand_steps: int = 50
    """Control steps under zero actions."""
    iterations: int = 2
    iterations_gpu: int = 200
    rollout: int = 8
    """Control steps of each environment per iteration, on a CPU."""
    effort_factor: float = 1.0
    """The largest factor by which the recipe's `randomize` raises an effort limit."""
    bounds: consumers.SmokeBounds = consumers.SmokeBounds()

    def run(self, files: Files) -> Iterator[Finding]:
        """Figures without times, which differ from machine to machine."""
        fields = ("envs", "envs_gpu", "stand_steps", "iterations", "iterations_gpu", "rollout")
        job: dict[str, object] = {name: getattr(self, name) for name in fields}
        (module,) = (files.inputs / "mjlab" / "python").glob("*_mjlab.py")
        # Not resolved: the inputs are links into the store, and the module looks beside itself.
        job |= {"modules": str(module.parent.absolute()), "module": module.stem}
        answer, failure = self.answer("mjlab_child.py", job)
        if answer is None:
            write_figures(files, {"failure": failure})
            yield consumers.FAILED(
                "robot",
                f"mjlab does not take the bundle: {failure}",
                hint="the message is mjlab's; `<bundle>/python/*_mjlab.py` is what it read",
            )
            return
        write_figures(files, _rounded_figures(answer))
        yield from evaluate(answer, self.bounds, self.effort_factor)


def _rounded_figures(answer: Mapping[str, Any]) -> dict[str, object]:  # Any: the child's JSON
    """Rounded, so that the last bits of a machine's sums are not in the report."""
    kept = ("envs", "fell", "finite", "walks", "gpu", "iterations", "weights_finite")
    digits = {"height_m": 3, "start_m": 3, "effort_share": 2}
    figures: dict[str, object] = {name: answer[name] for name in kept}
    figures |= {name: round(answer[name], count) for name, count in digits.items()}
    figures["weights_changed"] = answer["weights_moved"] > 0.0
    went = f", the root went from {answer['start_m']:.3f} m to {answer['height_m']:.3f} m"
    still = abs(answer["height_m"] - answer["start_m"]) < 1e-9  # a fixed base
    figures["summary"] = (
        f"{answer['fell']} of {answer['envs']} robots fell under zero actions"
        f"{'' if still else went}; then trained for "
        f"{answer['iterations']} iterations on a {'GPU' if answer['gpu'] else 'CPU'}"
    )
    if "drawn" in answer:
        figures["randomized_bodies"] = answer["drawn"]
        figures["randomized_inconsistent"] = answer["inconsistent"]
        figures["mass_ratio"] = [round(ratio, 2) for ratio in answer["mass_ratio"]]
    return figures


def evaluate(
    answer: Mapping[str, Any],  # Any: the child's JSON
    bounds: consumers.SmokeBounds,
    effort_factor: float = 1.0,
) -> Iterator[Finding]:
    """What is wrong with an answer; separate, so that it can be tried on bad ones."""
    fell, start, height = answer["fell"], answer["start_m"], answer["height_m"]
    falls, share = fell > bounds.fallen * answer["envs"], answer["effort_share"]
    sinks = not falls and answer["walks"] and height < bounds.low * start
    inconsistent = answer.get("inconsistent", 0)
    for rule, is_wrong, message in (
        (consumers.NOT_FINITE, not answer["finite"], "observations or rewards are not finite"),
        (consumers.NOT_FINITE, not answer["weights_finite"], "the policy's weights are not finite"),
        (FELL, falls, f"{fell} of {answer['envs']} robots fall under zero actions"),
        (consumers.SINKS, sinks, f"the root sinks from {start:.3f} to {height:.3f} m"),
        (
            EFFORT,
            share > effort_factor * 1.001,
            f"a drive makes {share:.2f} times its effort limit",
        ),
        (WEIGHTS, answer["weights_moved"] <= 0.0, "training changes no weight"),
        (INERTIA, inconsistent > 0, f"{inconsistent} random inertias are no matter's"),
    ):
        if is_wrong:
            yield rule("robot", f"mjlab: {message}")
