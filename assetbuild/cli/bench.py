"""`assetbuild bench`: collision quality against simulation speed."""

from __future__ import annotations

import argparse
import csv
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from assetbuild.cli.progress import at_work
from assetbuild.collision import CollisionMethod
from assetbuild.engine.graph import Node
from assetbuild.engine.planner import Planner
from assetbuild.engine.store import OUT_OPTION, machine_errors
from assetbuild.errors import AssetBuildError, StepError, UsageError, did_you_mean
from assetbuild.pipeline.opening import Opened
from assetbuild.pipeline.publish import check_folder
from assetbuild.pipeline.recipes import collision_rule, load_recipe
from assetbuild.plan import add_target
from assetbuild.recipe.models import Collision
from assetbuild.report.tables import table, text_table
from assetbuild.robot.codec import decode
from assetbuild.robot.shapes import Mesh, Shapes


def run(arguments: argparse.Namespace) -> int:
    """Build and measure every level, print the table; a CSV lies in the folder."""
    known = ("recipe", *LEVELS)
    names = [name.strip() for name in (arguments.levels or ",".join(known)).split(",")]
    for name in names:
        if name not in known:
            raise UsageError(f"no level `{name}`", hint=did_you_mean(name, known))
    loaded = load_recipe(arguments.recipe, arguments.variant)
    out = arguments.out or Path("build") / f"{loaded.recipe.robot}-bench"
    check_folder(out)
    with at_work(loaded, arguments) as (work, shown):
        levels = list(_measured_levels(work, names, arguments.source, shown.say))
    best = _write(levels, out)
    rows = [_row(level, is_best=level.name in best) for level in levels]
    print(text_table(table("", ("level", *SHOWN.values(), *FITTED, "note"), rows)))
    print(f"* = no other level is better in both; {out / 'bench.csv'}")
    return 0


SHOWN = {
    "steps_per_s": "steps/s",
    "contacts": "contacts",
    "geoms": "geoms",
    "self_contacts": "touching at home",
    "deepest_mm": "deepest, mm",
    "creep_mm_s": "slope, mm/s",
    "held": "holds",
}
"""Figure of a simulation -> its column."""
FITTED = ("mean IoU", "outside, mm", "build, s")


def _row(level: Level, *, is_best: bool) -> tuple[object, ...]:
    figures = [(level.speed or {}).get(key) for key in SHOWN]
    note = level.error or (f"{level.fell} by another method" if level.fell else None)
    name = f"{level.name} *" if is_best else level.name
    return (name, *figures, level.iou, level.outside_mm, level.build_s, note)


SECONDS = 900
"""Wall clock of one simulation."""
LEVELS: Mapping[str, Mapping[str, Any]] = {  # Any: values of a recipe
    "mesh": {"method": "keep"},
    "hull": {"method": "hull", "max_vertices": 256},
    "hull 64": {"method": "hull", "max_vertices": 64},
    "vhacd 8": {"method": "vhacd", "max_hulls": 8},
    "vhacd 32": {"method": "vhacd", "max_hulls": 32},
    "coacd 8": {"method": "coacd", "max_hulls": 8},
    "coacd 16": {"method": "coacd", "max_hulls": 16},
    "auto": {"method": "auto"},
    "primitives": {"method": "primitive", "max_hulls": 3},
}
"""Name -> rule of the links that have meshes. `recipe` is the recipe as it is."""
Source = Literal["auto", "collision", "visual"]


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


def _measured_levels(
    work: Opened, names: Sequence[str], source: Source, say: Callable[[str], None]
) -> Iterator[Level]:
    """AssetBuildError when the recipe itself cannot be built. source: meshes to work on."""
    built = work.made(work.robot)
    shapes = decode(Shapes, work.read(built, built.outline.robot["shapes.json"]))
    for name in names:
        say(f"level {name}")
        level = work.loaded
        if name != "recipe":
            level = level.but(collision=with_level(level.recipe.collision, shapes, name, source))
        try:
            yield _measured(name, replace(work, loaded=level))
        except AssetBuildError as error:
            if name == "recipe":
                raise
            yield Level(name, error=str(error).splitlines()[0])


def with_level(collision: Collision, shapes: Shapes, level: str, source: Source) -> Collision:
    """The rules of a recipe whose links with meshes follow one level.

    shapes: of the built recipe. source: the meshes to work on. Links that hit nothing in the
    recipe hit nothing here; links without such a mesh keep their rule.
    """
    solid = {shape.link for shape in shapes.of("collision")}
    meshed = {
        shape.link
        for shape in shapes.shapes
        if isinstance(shape.geometry, Mesh) and source in ("auto", shape.role)
    }
    rule = collision_rule(**{**LEVELS[level], "from": source})
    rules = {re.escape(link): rule for link in sorted(solid & meshed)}
    return collision.model_copy(update={"links": rules | collision.links})


def _measured(name: str, work: Opened) -> Level:
    def add(p: Planner) -> tuple[Node | None, list[Node]]:
        """The MJCF, and the steps that made collision geometry."""
        robot = work.robot(p).robot
        if not robot:
            return None, []
        mjcf = add_target(work.loaded.recipe, "mjcf", robot, p)
        nodes = p.graph().nodes.values()
        return mjcf, [node for node in nodes if isinstance(node.step, CollisionMethod)]

    built = work.made(add)
    mjcf, made = built.outline
    assert mjcf is not None  # noqa: S101 # a plan without questions is whole
    fits = [built.results[node.label] for node in made]
    figures = [json.loads(work.session.read(fit["quality.json"])) for fit in fits]
    figures = [quality for quality in figures if quality is not None]
    seconds: dict[str, float] = {}
    for fit in fits:  # equal steps: once, and as the one that ran
        seconds[fit.key] = fit.cpu_seconds or seconds.get(fit.key, fit.saved_seconds)
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "mjcf"
        work.session.store.restore_tree(built.results[mjcf.label]["mjcf/"], scene)
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
        lines = done.stderr.strip().splitlines() or ["no message"]
        raise StepError(f"the simulation failed: {lines[-1]}")
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def _write(rows: Sequence[Level], out: Path) -> frozenset[str]:
    """Write a line for each level; return the names on the Pareto front of quality and speed."""
    points = {
        row.name: (row.speed["steps_per_s"], row.iou)
        for row in rows
        if row.speed is not None and row.iou is not None
    }
    best = front(points)
    flat = [
        {"level": row.name, "pareto": row.name in best}
        | {key: value for key, value in asdict(row).items() if key not in ("name", "speed")}
        | (row.speed or {})
        for row in rows
    ]
    with machine_errors(out, OUT_OPTION):
        out.mkdir(parents=True, exist_ok=True)
        with (out / "bench.csv").open("w", encoding="utf-8", newline="") as file:
            columns = dict.fromkeys(key for row in flat for key in row)
            writer = csv.DictWriter(file, columns, lineterminator="\n")
            writer.writeheader()
            writer.writerows(flat)
    return best


def front(points: Mapping[str, tuple[float, float]]) -> frozenset[str]:
    """Names that no other point beats: at least as good in both, better in one."""
    return frozenset(
        name
        for name, (x, y) in points.items()
        if not any(u >= x and v >= y and (u > x or v > y) for u, v in points.values())
    )
