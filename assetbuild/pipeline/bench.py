"""bench(): one robot with collision geometry of every level, its quality against its speed."""

from __future__ import annotations

import csv
import functools
import io
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from assetbuild.engine.execute import Listener
from assetbuild.engine.planner import Settled, settle
from assetbuild.engine.processes import Processes
from assetbuild.engine.session import Session
from assetbuild.engine.store import OUT_OPTION, machine_errors
from assetbuild.errors import AssetBuildError, StepError
from assetbuild.pipeline.bench_plan import LEVELS, LevelOutline, Source, plan_level, with_level
from assetbuild.pipeline.opening import open_session, pin, remote_cache
from assetbuild.pipeline.publish import check_folder
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.report.bundle import json_text
from assetbuild.robot.codec import decode
from assetbuild.robot.shapes import Shapes

SECONDS = 900
"""Wall clock of one simulation."""


@dataclass(frozen=True)
class BenchRequest:
    """What the user asks for. levels: names of LEVELS, `recipe`; source: meshes to work on."""

    recipe: Path
    out: Path | None = None
    variant: str | None = None
    levels: Sequence[str] = ("recipe", *LEVELS)
    source: Source = "auto"
    jobs: int | None = None
    remote: str = ""
    cache_write: bool = False


@dataclass(frozen=True)
class Level:
    """One row. iou: mean over the fitted meshes; outside_mm: the worst; None = nothing fitted.

    build_s: CPU seconds of the steps that made the collision geometry; of cached ones the wall
    clock when they last ran.
    fell: meshes whose library failed, so that another method made their pieces.
    error: why there are no figures.
    """

    name: str
    speed: Any = None  # Any: JSON of simulators.speed.Speed
    iou: float | None = None
    outside_mm: float | None = None
    build_s: float = 0.0
    fell: int = 0
    error: str = ""


@dataclass(frozen=True)
class Bench:
    """All rows, and the names on the Pareto front of quality and speed."""

    levels: tuple[Level, ...]
    best: frozenset[str]
    out: Path


def bench(request: BenchRequest, on_event: Listener, say: Callable[[str], None]) -> Bench:
    """Build and measure every level; AssetBuildError when the recipe itself cannot be built."""
    loaded = load_recipe(request.recipe, request.variant)
    out = request.out or Path("build") / f"{loaded.recipe.robot}-bench"
    check_folder(out)
    remote = remote_cache(request.remote, say, write=request.cache_write)
    lock = pin(loaded, frozen=False, say=say)
    rows: list[Level] = []
    with open_session(loaded, remote=remote) as session, Processes(session) as runner:

        def built(level: LoadedRecipe) -> Settled[LevelOutline]:
            add = functools.partial(plan_level, level, lock)
            done = settle(add, session, runner, jobs=request.jobs, on_event=on_event)
            if done.errors:
                raise done.errors[0]
            return done

        shapes = _shapes(built(loaded), session)
        for name in request.levels:
            say(f"level {name}")
            level = loaded if name == "recipe" else with_level(loaded, shapes, name, request.source)
            try:
                rows.append(_measured(name, built(level), session))
            except AssetBuildError as error:
                if name == "recipe":
                    raise
                rows.append(Level(name, error=str(error).splitlines()[0]))
    return _written(loaded.recipe.robot, rows, out)


def _shapes(built: Settled[LevelOutline], session: Session) -> Shapes:
    ref = built.outline.shapes
    assert ref is not None  # noqa: S101 # a plan without questions is whole
    return decode(Shapes, session.read(built.results[ref.node][ref.output]))


def _measured(name: str, built: Settled[LevelOutline], session: Session) -> Level:
    fits = [built.results[node.label] for node in built.outline.fits]
    figures = [json.loads(session.read(fit["quality.json"])) for fit in fits]
    figures = [quality for quality in figures if quality is not None]
    seconds: dict[str, float] = {}
    for fit in fits:  # equal steps: once, and as the one that ran
        seconds[fit.key] = fit.cpu_seconds or seconds.get(fit.key, fit.saved_seconds)
    assert built.outline.mjcf is not None  # noqa: S101 # as in `_shapes`
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "mjcf"
        session.store.restore_tree(built.results[built.outline.mjcf.label]["mjcf/"], scene)
        speed = _simulated(scene / "scene.xml")
    return Level(
        name,
        speed,
        iou=sum(q["iou"] for q in figures) / len(figures) if figures else None,
        outside_mm=1e3 * max(q["max_outside_m"] for q in figures) if figures else None,
        build_s=sum(seconds.values()),
        fell=sum(any(f.rule == "collision.library_failed" for f in fit.findings) for fit in fits),
    )


def _simulated(scene: Path) -> dict[str, Any]:  # Any: JSON
    command = [sys.executable, "-m", "assetbuild.simulators.speed", str(scene)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
    except subprocess.TimeoutExpired:
        raise StepError(f"the simulation took more than {SECONDS} s") from None
    if done.returncode != 0:
        said = done.stderr.strip().splitlines() or ["no message"]
        raise StepError(f"the simulation failed: {said[-1]}")
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def _written(robot: str, rows: Sequence[Level], out: Path) -> Bench:
    points = {
        row.name: (row.speed["steps_per_s"], row.iou)
        for row in rows
        if row.speed is not None and row.iou is not None
    }
    best = front(points)
    data = {"robot": robot, "levels": [asdict(row) for row in rows], "pareto": sorted(best)}
    with machine_errors(out, OUT_OPTION):
        out.mkdir(parents=True, exist_ok=True)
        (out / "bench.json").write_text(json_text(data), encoding="utf-8")
        (out / "bench.csv").write_text(_csv(rows, best), encoding="utf-8")
    return Bench(tuple(rows), best, out)


def front(points: Mapping[str, tuple[float, float]]) -> frozenset[str]:
    """Names that no other point beats: at least as good in both, better in one."""
    return frozenset(
        name
        for name, (x, y) in points.items()
        if not any(u >= x and v >= y and (u > x or v > y) for u, v in points.values())
    )


def _csv(rows: Sequence[Level], best: frozenset[str]) -> str:
    """A line for each level, for spreadsheets and plots."""
    flat = [
        {"level": row.name, "pareto": row.name in best}
        | {key: value for key, value in asdict(row).items() if key not in ("name", "speed")}
        | (row.speed or {})
        for row in rows
    ]
    text = io.StringIO()
    columns = list(dict.fromkeys(key for row in flat for key in row))
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(flat)
    return text.getvalue()
