"""The build behind `ours`, when there is something to do."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterable
from pathlib import Path

from assetbuild.engine import noop_build
from assetbuild.engine.digest import digest_bytes
from assetbuild.engine.execute import execute, first_error
from assetbuild.engine.graph import Ref
from assetbuild.engine.machine import cache_root
from assetbuild.engine.planner import Planner
from assetbuild.engine.session import Session
from assetbuild.engine.step import Files, Step
from assetbuild.engine.store import Store
from assetbuild.findings import Finding
from assetbuild.pipeline.publish import lies_there, new_staging, publish
from tests.benchmarks.graph import tasks

OUT = Path("out")


class Join(Step):
    """`cp`, `cat` and `head`: the inputs one after the other, the first `size` bytes of them."""

    outputs = ("out",)
    count: int = 1
    size: int = 0

    def run(self, files: Files) -> Iterable[Finding]:
        with (files.outputs / "out").open("wb") as out:
            for n in range(self.count):
                with (files.inputs / str(n)).open("rb") as source:
                    if self.size:
                        out.write(source.read(self.size))
                    else:
                        shutil.copyfileobj(source, out, 1 << 20)
        return ()


def build(record: str, robots: int) -> int:
    """0; 1 when a step failed."""
    began_ns = time.time_ns()
    with Session(Store(Path(cache_root())), build="bench") as session:
        planner = Planner(session)
        made: dict[str, Ref] = {}
        read: dict[str, str] = {}
        for task in tasks(robots):
            inputs = {}
            for n, name in enumerate(task.inputs):
                inputs[str(n)] = made.get(name) or planner.source(Path(name))
                if name not in made:
                    read[name] = session.world.digest(Path(name))
            step = Join(count=len(task.inputs), size=task.size)
            made[task.output] = planner.add(task.output, step, inputs)["out"]
        results = execute(planner.graph(), session)
        if first_error(results) is not None:
            return 1
        digests = {name.removeprefix("out/"): results[name]["out"] for name in made}
        files = dict(read)
        for folder, held in _by_robot(digests).items():
            held |= _publish(folder, held, session)
            files |= {str(folder / name): digest for name, digest in held.items()}
    noop_build.write(
        record,
        options="bench",
        files=files,
        folders=[str(OUT / f"r{robot}") for robot in range(robots)],
        exit_code=0,
        summary="",
        began_ns=began_ns,
    )
    return 0


def _by_robot(digests: dict[str, str]) -> dict[Path, dict[str, str]]:
    """A folder for each robot, as `assetbuild build` makes them."""
    folders: dict[Path, dict[str, str]] = {}
    for name, digest in digests.items():
        robot, _, file = name.partition("/")
        folders.setdefault(OUT / robot, {})[file] = digest
    return folders


def _publish(out: Path, digests: dict[str, str], session: Session) -> dict[str, str]:
    """What a bundle has besides: its manifest."""
    text = json.dumps(digests)
    own = {"manifest.json": digest_bytes(text.encode())}
    if lies_there(out, digests | own, session.world.stamps.digest):
        return own
    staging = new_staging(out)
    for name, digest in digests.items():
        session.store.restore(digest, staging / name)
    (staging / "manifest.json").write_text(text)
    before = None
    if (out / "manifest.json").is_file():
        before = json.loads((out / "manifest.json").read_bytes())
    publish(staging, out, before)
    return own
