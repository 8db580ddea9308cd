"""sample(): robots that could exist, as MJCF beside the figures of the draws."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from assetbuild.engine.execute import Listener
from assetbuild.engine.planner import Settled, settle
from assetbuild.engine.session import Session
from assetbuild.errors import AssetBuildError
from assetbuild.findings import Finding
from assetbuild.pipeline.bundling import publish_bundle
from assetbuild.pipeline.opening import open_session, pin, remote_cache
from assetbuild.pipeline.publish import check_replaceable
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.pipeline.sampling_plan import SamplesOutline, plan_samples
from assetbuild.recipe.loader import LoadedRecipe
from assetbuild.report.bundle import BundleFile, json_text, manifest


@dataclass(frozen=True)
class SampleRequest:
    """What the user asks for. keep: MJCF files; judge: draws for the statistics."""

    recipe: Path
    out: Path | None = None
    variant: str | None = None
    keep: int = 16
    judge: int = 10_000
    seed: int | None = None
    jobs: int | None = None
    remote: str = ""
    cache_write: bool = False


@dataclass(frozen=True)
class Sampled:
    """What came of it. statistics: as `draw_samples` wrote them; out: None when a step failed."""

    out: Path | None
    statistics: dict[str, Any]  # Any: JSON
    findings: tuple[Finding, ...] = ()
    errors: tuple[AssetBuildError, ...] = ()


def sample(request: SampleRequest, on_event: Listener, say: Callable[[str], None]) -> Sampled:
    """Draw and write. Raises AssetBuildError for wrong input; failed steps are in the result."""
    loaded = load_recipe(request.recipe, request.variant)
    out = request.out or Path("build") / f"{loaded.recipe.robot}-samples"
    check_replaceable(out)
    remote = remote_cache(request.remote, say, write=request.cache_write)
    lock = pin(loaded, frozen=False, say=say)
    with open_session(loaded, remote=remote) as session:
        add = functools.partial(
            plan_samples, loaded, lock, keep=request.keep, judge=request.judge, seed=request.seed
        )
        done = settle(add, session, jobs=request.jobs, on_event=on_event)
        if done.errors:
            return Sampled(None, {}, errors=done.errors)
        return _publish(loaded, done, session, out)


def _publish(
    loaded: LoadedRecipe, done: Settled[SamplesOutline], session: Session, out: Path
) -> Sampled:
    outline, results = done.outline, done.results
    assert outline.draws is not None  # noqa: S101 # a plan without questions is whole
    drawn = results[outline.draws.label]
    statistics = json.loads(session.read(drawn["statistics.json"]))
    files = [
        BundleFile.of_bytes("samples.json", "samples", session.read(drawn["samples.json"])),
        BundleFile.of_text("statistics.json", "report", json_text(statistics)),
    ]
    main = f"{loaded.recipe.robot}.xml"
    for index, node in enumerate(outline.variants):
        tree = session.tree(results[node.label]["mjcf/"])
        digest, size = tree[main]
        files.append(BundleFile(f"{loaded.recipe.robot}_{index:03}.xml", "mjcf", digest, size))
        if index == 0:  # a draw changes no mesh
            files += [
                BundleFile(path, "mjcf", digest, size)
                for path, (digest, size) in sorted(tree.items())
                if path.startswith("assets/")
            ]
    files.append(manifest(loaded.recipe.robot, files))
    publish_bundle(files, out, session)
    labels = ("enclose", "draw_samples")
    findings = tuple(finding for label in labels for finding in results[label].findings)
    return Sampled(out, statistics, findings)
