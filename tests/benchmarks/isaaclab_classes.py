"""Which classes of Isaac Lab's own packages a bundle's module really makes, and where imports stop.

    python -m tests.benchmarks.isaaclab_classes BUNDLE PYTHON

PYTHON: an interpreter that has Isaac Lab, 2.x or 3.x. Nothing stands in for what is missing there.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

PACKAGES = (
    "isaaclab.utils",
    "isaaclab.actuators",
    "isaaclab.sim",
    "isaaclab.assets",
    "isaaclab.managers",
    "isaaclab.envs.mdp",
    "isaaclab_physx.sim.schemas",
    "isaaclab_newton.sim.schemas",
)
CHILD = r"""
import importlib, importlib.metadata, importlib.util, json, sys, traceback

folder, stem, packages = sys.argv[1], sys.argv[2], sys.argv[3:]
sys.path.insert(0, folder)

def stop(error):
    frames = [f for f in traceback.extract_tb(error.__traceback__) if "isaaclab" in f.filename]
    place = ""
    if frames:
        name = frames[-1].filename.replace("\\", "/").rpartition("/isaaclab")[2]
        place = f" (isaaclab{name}:{frames[-1].lineno})"
    return f"{type(error).__name__}: {str(error).splitlines()[0]}{place}"

def tried(name):
    try:
        return importlib.import_module(name), ""
    except Exception as error:
        return None, stop(error)

def parts(value):
    if isinstance(value, dict):
        return list(value.values())
    return list(value) if isinstance(value, (list, tuple)) else []

def walk(value, made):
    kind = type(value)
    if kind.__module__.startswith("isaaclab"):
        made.add(f"{kind.__module__.split('.')[0]}: {kind.__qualname__}")
        for inner in getattr(value, "__dict__", {}).values():
            walk(inner, made)
    for inner in parts(value):
        walk(inner, made)

told = {"packages": {}, "made": [], "terms": 0}
told["version"] = importlib.metadata.version("isaaclab")
generation = 3 if importlib.util.find_spec("isaaclab_physx") else 2
if generation == 2:  # the wheel's own __init__ starts Isaac Sim; the package lies below it
    outer = importlib.util.find_spec("isaaclab").submodule_search_locations[0]
    sys.path.insert(0, outer + "/source/isaaclab")
    importlib.invalidate_caches()
for name in packages:
    if generation == 3 or not name.startswith(("isaaclab_physx", "isaaclab_newton")):
        told["packages"][name] = tried(name)[1] or "imported"
module, why = tried(f"{stem}_{generation}")
told["module"] = why or "imported"
made = set()
for name, value in vars(module).items() if module else ():
    if isinstance(value, type):
        if value.__module__ == module.__name__:
            events = value()
            told["terms"] = len(vars(events))
            walk(list(vars(events).values()), made)
    elif not name.startswith("__"):
        walk(value, made)
        if name.endswith("_CFG"):
            placed = {"prim_path": "/World/robot"} if hasattr(value, "spawn") else {}
            value.replace(**placed).validate()
told["made"] = sorted(one for one in made if "Cfg" in one)
print("ANSWER" + json.dumps(told))
"""


def main(bundle: str, python: str) -> None:
    (file,) = (Path(bundle) / "python").glob("*_isaaclab_2.py")
    stem = file.stem.removesuffix("_2")
    command = [python, "-c", CHILD, str(file.parent.resolve()), stem, *PACKAGES]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    answers = [line for line in done.stdout.splitlines() if line.startswith("ANSWER")]
    if not answers:
        sys.exit(done.stderr)
    told = json.loads(answers[0].removeprefix("ANSWER"))
    print(f"isaaclab {told['version']}\n")
    print("| package | |\n| --- | --- |")
    for name, what in told["packages"].items():
        print(f"| `{name}` | {what} |")
    print(f"| the bundle's module | {told['module']} |")
    print(f"\n{len(told['made'])} classes, {told['terms']} event terms\n")
    print("\n".join(f"- `{one}`" for one in told["made"]))


if __name__ == "__main__":
    main(*sys.argv[1:])
