"""identify(): the logs of a recipe fitted, shown, and written into it where that is asked for."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from assetbuild.engine.execute import Listener
from assetbuild.engine.planner import Planner
from assetbuild.errors import RecipeError
from assetbuild.findings import Finding
from assetbuild.identify.for_recipe import as_ranges
from assetbuild.identify.plan import excite as add_excite
from assetbuild.pipeline.opening import Opened, Task, at_work
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.robot.codec import decode
from assetbuild.robot.identify import Fit
from assetbuild.robot.model import Actuator, Control


@dataclass(frozen=True)
class Identified:
    """What came of it. fits: one for each entry of `identify`; actuators: as a build uses them."""

    loaded: LoadedRecipe
    fits: tuple[Fit, ...]
    actuators: tuple[Actuator, ...]
    findings: tuple[Finding, ...]

    @property
    def ranges(self) -> str:
        """The intervals as `randomize.joints`, YAML."""
        return as_ranges(self.fits, self.loaded.recipe.simulation.timestep)


def identify(task: Task, on_event: Listener, say: Callable[[str], None]) -> Identified:
    """Fit. Raises AssetBuildError."""
    loaded = load_recipe(task.recipe, task.variant)
    if not loaded.recipe.identify:
        raise RecipeError(
            "the recipe has no `identify`: nothing says where the logs are",
            where=loaded.where(()),
            hint="add for instance `identify: [{logs: [{file: log.csv}], recorded: {kp: 20}}]`",
        )
    with at_work(loaded, task, on_event, say) as work:
        done = work.made(work.robot)
        outline = done.outline
        fits = tuple(decode(Fit, work.read(done, node["fit.json"])) for node in outline.fits)
        control = decode(Control, work.read(done, outline.robot["control.json"]))
    of_fits = [label for label in done.results if label.startswith(("read_log", "fit_logs"))]
    findings = tuple(f for label in of_fits for f in done.results[label].findings)
    return Identified(loaded, fits, control.actuators, findings)


@dataclass(frozen=True)
class Excitation:
    """What to record. expected: rows for each parameter, as the step `Excite` writes them."""

    commands: bytes
    expected: list[dict[str, Any]]  # Any: JSON
    findings: tuple[Finding, ...] = ()


def excite(
    task: Task, seconds: float, on_event: Listener, say: Callable[[str], None]
) -> Excitation:
    """Commands that show the parameters. Raises AssetBuildError."""
    loaded = load_recipe(task.recipe, task.variant)
    with at_work(loaded, task, on_event, say) as work:
        result = work.made(lambda p: plan_excite(work, seconds, p)).results["excite"]
        commands, expected = (work.session.read(result[n]) for n in ("excite.csv", "expected.json"))
        return Excitation(commands, json.loads(expected), result.findings)


def plan_excite(work: Opened, seconds: float, p: Planner) -> None:
    """Add the node `excite` and what it needs."""
    outline = replace(work, loaded=work.loaded.but(identify=())).robot(p)
    if outline.tree is not None and outline.robot:
        with work.loaded.placing():
            add_excite(work.loaded.recipe, outline.tree, outline.robot, seconds, p)
