"""Isaac Lab's half of a comparison: runs a bundle's measuring script where Isaac Lab is installed.

`python _isaaclab_child.py job.json`: the script's readings are the answer. Isaac Lab 3 runs Newton
and PhysX without Isaac Sim; Isaac Lab 2 needs it, and the authors of assetbuild have no machine
that runs that.
"""

from __future__ import annotations

import json
import runpy
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any


def main(path: Path) -> None:
    """Run the job; an exception is the answer of a robot that Isaac Lab does not take."""
    job = json.loads(path.read_text(encoding="utf-8"))
    answer = path.with_name("answer.json")
    chosen = arguments(job["engine"])
    if isinstance(chosen, str):
        answer.write_text(json.dumps({"absent": chosen}), encoding="utf-8")
        return
    script = Path(job["script"])
    sys.argv = [script.name, "--output", str(answer), *chosen]
    sys.path.insert(0, str(script.parent))
    runpy.run_path(str(script), run_name="__main__")


def arguments(engine: str) -> list[str] | str:
    """What the script is called with, or why this engine is not here."""
    if not find_spec("isaaclab_physx"):  # versions of 2.x count from 0.4
        return ["--headless"] if engine == "physx" else "Isaac Lab 2 has PhysX alone"
    import torch
    import warp

    device = "cuda:0" if torch.cuda.is_available() else "cpu"
    if engine == "newton":
        return ["--physics", "newton_mjwarp", "--device", device]
    if not find_spec("ovphysx"):
        found = find_spec("isaacsim") is not None
        return ["--headless", "--physics", "isaacsim_physx"] if found else "no PhysX is installed"
    if device == "cpu":
        # Isaac Lab asks for pinned memory, which Warp cannot have where CUDA is missing.
        for name in ("zeros", "empty"):
            setattr(warp, name, unpinned(getattr(warp, name)))
    return ["--physics", "ovphysx", "--device", device]


def unpinned(make: Any) -> Any:
    """Return the function that makes the same array in ordinary memory."""

    def made(*args: Any, **named: Any) -> Any:
        return make(*args, **{**named, "pinned": False})

    return made


if __name__ == "__main__":
    main(Path(sys.argv[1]))
