"""identify(): the logs of a recipe fitted, shown, and written into it where that is asked for."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from assetbuild.engine.execute import Listener
from assetbuild.engine.planner import Planner, settle
from assetbuild.errors import AssetBuildError, RecipeError
from assetbuild.findings import Finding
from assetbuild.identify.as_ranges import as_ranges
from assetbuild.identify.plan import excite as add_excite
from assetbuild.lock import Lock
from assetbuild.pipeline.opening import open_session, pin, remote_cache
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.plan import Outline, plan
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.robot.codec import decode
from assetbuild.robot.identified import Fit
from assetbuild.robot.model import Actuator, Control


@dataclass(frozen=True)
class IdentifyRequest:
    """What the user asks for."""

    recipe: Path
    variant: str | None = None
    jobs: int | None = None
    remote: str = ""
    cache_write: bool = False


@dataclass(frozen=True)
class Identified:
    """What came of it. fits: one for each entry of `identify`; actuators: as a build uses them."""

    loaded: LoadedRecipe
    fits: tuple[Fit, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    findings: tuple[Finding, ...] = ()
    errors: tuple[AssetBuildError, ...] = ()

    @property
    def ranges(self) -> str:
        """The intervals as `randomize.joints`, YAML."""
        return as_ranges(self.fits, self.loaded.recipe.simulation.timestep)


def identify(
    request: IdentifyRequest, on_event: Listener, say: Callable[[str], None]
) -> Identified:
    """Fit. Raises AssetBuildError for wrong input; failed steps are in the result."""
    loaded = load_recipe(request.recipe, request.variant)
    if not loaded.recipe.identify:
        raise RecipeError(
            "the recipe has no `identify`: nothing says where the logs are",
            where=loaded.where(()),
            hint="add for instance `identify: [{logs: [{file: log.csv}], recorded: {kp: 20}}]`",
        )
    remote = remote_cache(request.remote, say, write=request.cache_write)
    lock = pin(loaded, frozen=False, say=say)
    with open_session(loaded, remote=remote) as session:
        add = functools.partial(_plan, loaded, lock)
        done = settle(add, session, jobs=request.jobs, on_event=on_event)
        if done.errors:
            return Identified(loaded, errors=done.errors)
        results, outline = done.results, done.outline
        fits = tuple(
            decode(Fit, session.read(results[node.label]["fit.json"])) for node in outline.fits
        )
        ref = outline.robot["control.json"]
        control = decode(Control, session.read(results[ref.node][ref.output]))
        of_fits = [label for label in results if label.startswith(("read_log", "fit_logs"))]
        findings = tuple(f for label in of_fits for f in results[label].findings)
        return Identified(loaded, fits, control.actuators, findings)


@dataclass(frozen=True)
class Excitation:
    """What to record. expected: rows for each parameter, as the step `Excite` writes them."""

    commands: bytes
    expected: list[dict[str, Any]]  # Any: JSON
    findings: tuple[Finding, ...] = ()


def excite(
    request: IdentifyRequest,
    seconds: float,
    on_event: Listener,
    say: Callable[[str], None],
) -> Excitation:
    """Commands that show the parameters. Raises AssetBuildError."""
    loaded = load_recipe(request.recipe, request.variant)
    remote = remote_cache(request.remote, say, write=request.cache_write)
    lock = pin(loaded, frozen=False, say=say)
    with open_session(loaded, remote=remote) as session:
        add = functools.partial(plan_excite, loaded, lock, seconds)
        done = settle(add, session, jobs=request.jobs, on_event=on_event)
        if done.errors:
            raise done.errors[0]
        result = done.results["excite"]
        expected = json.loads(session.read(result["expected.json"]))
        return Excitation(session.read(result["excite.csv"]), expected, result.findings)


def plan_excite(loaded: LoadedRecipe, lock: Lock | None, seconds: float, p: Planner) -> None:
    """Add the node `excite` and what it needs."""
    unfitted = replace(loaded, recipe=loaded.recipe.model_copy(update={"identify": ()}))
    outline = _plan(unfitted, lock, p)
    if outline.tree is not None and outline.robot:
        add_excite(loaded, outline.tree, outline.robot, seconds, p)


def _plan(loaded: LoadedRecipe, lock: Lock | None, p: Planner) -> Outline:
    """The robot and its fits, without targets, checks and pictures."""
    bare = replace(loaded, recipe=loaded.recipe.model_copy(update={"targets": ()}))
    return plan(bare, lock, p, drawn=False)
