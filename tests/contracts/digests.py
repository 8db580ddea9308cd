"""The table of output digests: what each step makes of tiny robots, by its key.

`python -m tests.contracts.digests` renews it; it refuses where a step makes other bytes under the
same key: then its `version` must be raised first.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from assetbuild.engine.planner import settle
from assetbuild.engine.resolver import Resolver
from assetbuild.engine.session import Session
from assetbuild.engine.store import Store
from assetbuild.pipeline.recipes import load_recipe
from assetbuild.plan import plan

ROBOTS = Path(__file__).parents[1] / "robots"
TABLE = Path(__file__).parents[1] / "golden" / "digests.json"
RECIPE = """\
schema: assetbuild/v1
robot: four_legs
source: {path: ., urdf: four_legs.urdf, license: MIT}
base: floating
collision: {default: {method: keep}}
actuators:
  - {joints: ".*", model: pd, kp: 20, kd: 1, effort: 10, velocity: 20}
keyframes:
  home: {base: on_ground, joints: {".*_hip_joint": 0, ".*_thigh_joint": 0.3, ".*_calf_joint": -1}}
targets: [urdf, mjcf, usd]
"""
UNTOLD = frozenset({"pictures", "check gains", "check mass", "check trials"})
"""Labels of steps whose bytes depend on this machine's graphics library or CPU as well."""


def build(folder: Path) -> dict[str, dict[str, Any]]:  # Any: JSON
    """Label -> key, platform, tools and output digests of every step of the robot."""
    shutil.copyfile(ROBOTS / "four_legs.urdf", folder / "four_legs.urdf")
    (folder / "legs.yaml").write_text(RECIPE)
    loaded = load_recipe(folder / "legs.yaml")
    with Session(Store(folder / "store")) as session:
        done = settle(lambda planner: plan(loaded, None, planner), session)
        resolver = Resolver(done.graph.nodes, session)
        found = {}
        for label, result in done.results.items():
            action = resolver.action(label)
            if label in UNTOLD or action is None or result.outputs is None:
                continue
            found[label] = {
                "key": action.key,
                "tools": action.parts["tools"],
                "platform": action.parts["platform"],
                "outputs": result.outputs,
            }
        return found


def read_table() -> dict[str, dict[str, Any]]:  # Any: JSON
    """The committed table; empty when there is none."""
    return json.loads(TABLE.read_text()) if TABLE.is_file() else {}


def unraised(
    table: dict[str, dict[str, Any]],  # Any: JSON
    now: dict[str, dict[str, Any]],  # Any: JSON
) -> list[str]:
    """Steps that make other bytes than the table says, under the very same key."""
    return [
        label
        for label, row in now.items()
        if label in table
        and row["key"] == table[label]["key"]
        and row["outputs"] != table[label]["outputs"]
    ]


def outdated(
    table: dict[str, dict[str, Any]],  # Any: JSON
    now: dict[str, dict[str, Any]],  # Any: JSON
) -> list[str]:
    """Steps that the table does not know as they are, though libraries and platform are its own."""
    same = ("tools", "platform")
    return [
        label
        for label, row in now.items()
        if label not in table
        or (row["key"] != table[label]["key"] and all(row[p] == table[label][p] for p in same))
    ]


def main() -> int:
    with tempfile.TemporaryDirectory() as name:
        now = build(Path(name))
    wrong = unraised(read_table(), now)
    if wrong:
        print(f"raise the `version` of: {', '.join(wrong)}", file=sys.stderr)
        return 1
    TABLE.parent.mkdir(exist_ok=True)
    TABLE.write_text(json.dumps(now, indent=1, sort_keys=True) + "\n")
    print(f"{TABLE}: {len(now)} steps")
    return 0


if __name__ == "__main__":
    sys.exit(main())
