"""Isaac Lab's half of a comparison: runs a bundle's measuring script where Isaac Lab is installed.

The script's readings are the answer. Isaac Lab 3 runs Newton
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


def answer(job: dict[str, str]) -> dict[str, Any]:
    """What the script read on an engine."""
    chosen = arguments(job["engine"])
    if isinstance(chosen, str):
        return {"absent": chosen}
    # Isaac Sim ends the process when the script closes it: then the readings are the answer as is.
    script, readings = Path(job["script"]), Path("answer.json").absolute()
    sys.argv = [script.name, "--output", str(readings), *chosen]
    sys.path.insert(0, str(script.parent))
    runpy.run_path(str(script), run_name="__main__")
    return dict(json.loads(readings.read_bytes()))


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
        has_sim = find_spec("isaacsim") is not None
        return ["--headless", "--physics", "isaacsim_physx"] if has_sim else "no PhysX is installed"
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
